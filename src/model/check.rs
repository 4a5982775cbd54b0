//! What a model's description must satisfy before anything is made from it.

use super::{Architecture, Kind, MacroSpec, ModelSpec, NodeSums, Output, Precision, WorldEdges};
use m4gn_base::{Error, Result};

/// Version of the header schema that this library reads and writes.
const FORMAT: u32 = 1;

/// Largest width and layer count accepted: far beyond any sensible network, small enough that no product of two
/// overflows and a damaged header cannot ask for more memory than there is.
const MAX_WIDTH: usize = 1 << 14;
const MAX_LAYERS: usize = 1 << 10;
/// A walk of n steps is as much work as there are nodes within n / 2 steps of each.
const MAX_WALK: usize = 64;
/// A coarser graph has half the nodes: 65,536 nodes become one.
const MAX_LEVELS: usize = 16;

/// What to do where a table was left in from another configuration.
const WITHOUT_CONTACT: &str =
    "for fields at cells, or a body that nothing touches, delete the table [contact]";

/// What is wrong, with the key that it is about.
type Verdict = std::result::Result<(), String>;

impl ModelSpec {
    /// Checks that the description is one that a network can be made of.
    ///
    /// # Errors
    /// [`Error::Model`] naming the entry, what was expected and what was found.
    pub fn check(&self) -> Result<()> {
        self.verify().map_err(|e| Error::Model(format!("model description: {e}")))
    }

    /// The same, for a caller that knows where the description stands: the one check of model files, training
    /// configurations and networks.
    ///
    /// # Errors
    /// The entry, what was expected and what was found.
    pub fn verify(&self) -> Verdict {
        expect(self.format == FORMAT, || {
            format!("format: expected {FORMAT}, found {}: written by another version of m4gn", self.format)
        })?;
        expect(matches!(self.dim, 2 | 3), || format!("dim: expected 2 or 3, found {}", self.dim))?;
        expect(self.stride.is_finite() && self.stride > 0.0, || {
            format!("stride: expected a positive time in s, found {}", self.stride)
        })?;
        // Before each of them is looked for among all others.
        expect(self.fields.len() <= MAX_LAYERS, || {
            format!("fields: expected at most {MAX_LAYERS}, found {}", self.fields.len())
        })?;
        self.check_contact()?;
        self.check_resolution()?;
        self.check_calibration()?;
        self.check_fields()?;
        self.check_node_types()?;
        self.architecture.verify()?;
        expect(!self.architecture.needs().whole || self.precision == Precision::Fp32, || {
            format!(
                "precision: kind {} keeps the nodes of the largest scores, and rounding to bf16 would keep others; use \"fp32\"",
                self.architecture.name().name()
            )
        })?;
        let together = self.architecture.micro.world_edges == WorldEdges::Together;
        expect(together || self.contact.is_some(), || {
            "world_edges: \"apart\" is of bodies at points, whose table [contact] gives them world edges; there is none"
                .into()
        })?;
        expect(together || self.architecture.passes_messages(), || {
            format!(
                "world_edges: kind {} has no encoders of edges, of which \"apart\" gives world edges one of their own; use \"together\"",
                self.architecture.name().name()
            )
        })?;
        self.segments.check().map_err(|e| e.to_string())
    }

    fn check_resolution(&self) -> Verdict {
        let Some(length) = self.resolution else {
            return Ok(());
        };
        expect(length.is_finite() && length > 0.0, || {
            format!("resolution: expected a positive length in m, found {length}")
        })
    }

    fn check_calibration(&self) -> Verdict {
        let Some(calibration) = &self.calibration else {
            return Ok(());
        };
        if let Some(fault) = calibration.fault() {
            return Err(format!("calibration.{fault}"));
        }
        let predicts = |name: &str| self.fields.iter().any(|f| f.name == name && f.output != Output::None);
        for (i, growth) in calibration.growth.iter().enumerate() {
            let again = calibration.growth[..i].iter().any(|g| g.field == growth.field);
            expect(predicts(&growth.field) && !again, || {
                format!(
                    "calibration.growth: expected fields that are predicted, each once, found {}",
                    growth.field
                )
            })?;
        }
        Ok(())
    }

    fn check_fields(&self) -> Verdict {
        for (i, field) in self.fields.iter().enumerate() {
            let name = &field.name;
            expect(!name.is_empty() && !name.contains('\0'), || {
                format!("fields[{i}].name: expected the name of a field, found {name:?}")
            })?;
            expect(self.fields[..i].iter().all(|f| f.name != *name), || {
                format!("field '{name}' appears twice")
            })?;
            expect(field.input || field.output != Output::None, || {
                format!("field '{name}' is neither an input nor an output")
            })?;
            let carried = self.nodes().carried && i == 0;
            expect(field.input || field.output != Output::Delta || carried, || {
                format!(
                    "field '{name}': a change can only be added to a field that is an input; use \"value\""
                )
            })?;
            let floor = field.floor.unwrap_or(1.0);
            expect(floor.is_finite() && floor > 0.0, || {
                format!(
                    "field '{name}': floor: expected a positive number in the field's unit, found {floor}"
                )
            })?;
            expect(field.floor.is_none() || !(field.vector || field.has_level()), || {
                format!(
                    "field '{name}': floor is of scalars that are positive (k, omega, T), which no vector is, and no kinematic pressure"
                )
            })?;
        }
        expect(self.n_outputs() > 0, || "fields: no field is an output".into())?;
        expect(self.n_field_inputs() > 0, || "fields: no field is an input".into())
    }

    fn check_contact(&self) -> Verdict {
        let Some(contact) = &self.contact else {
            return Ok(());
        };
        expect(contact.radius.is_finite() && contact.radius > 0.0, || {
            format!("contact.radius: expected a positive length in m, found {}", contact.radius)
        })?;
        expect(self.resolution.is_none(), || {
            "resolution beside contact: the points of a body that moves cannot be agglomerated; leave one of the two out".into()
        })?;
        expect(self.dim == 3, || {
            format!("contact: bodies are three-dimensional, found {} directions; {WITHOUT_CONTACT}", self.dim)
        })?;
        // Where no edges are read, the nodes tell where they are.
        let input = !self.architecture.needs().edges;
        let first = self.fields.first();
        let carries =
            first.is_some_and(|f| f.name == "D" && f.vector && f.input == input && f.output == Output::Delta);
        expect(carries && self.fields.len() == 1, || {
            let found: Vec<String> =
                self.fields.iter().map(|f| format!("{} (input = {})", f.name, f.input)).collect();
            format!(
                "fields: with [contact] and kind {} expected one, {{ name = \"D\", input = {input}, output = \"delta\" }}, the displacement: \
                 a vector that the {} carry; found {}; {WITHOUT_CONTACT}",
                self.architecture.name().name(),
                if input { "nodes" } else { "edges" },
                found.join(", ")
            )
        })
    }

    fn check_node_types(&self) -> Verdict {
        let nodes = self.nodes();
        expect(self.node_types.contains(&nodes.predicted), || {
            format!("node_types: '{}' ({}) is missing", nodes.predicted.name(), nodes.name)
        })?;
        for (i, kind) in self.node_types.iter().enumerate() {
            expect(!self.node_types[..i].contains(kind), || {
                format!("node type '{}' appears twice", kind.name())
            })?;
        }
        Ok(())
    }
}

impl Architecture {
    fn verify(&self) -> Verdict {
        let within = |name: &str, value: usize, low: usize, high: usize| {
            expect((low..=high).contains(&value), || {
                format!("{name}: expected {low} to {high}, found {value}")
            })
        };
        within("width", self.width, 1, MAX_WIDTH)?;
        within("hidden_layers", self.hidden_layers, 1, 16)?;
        within("node_rwse_steps", self.micro.node_rwse_steps, 0, MAX_WALK)?;
        let name = self.name().name();
        expect(self.passes_messages() || self.micro.node_sums == NodeSums::After, || {
            format!(
                "node_sums: kind {name} has no layers that pass messages along edges with latents (eq. 2 to 4); \"before\" is of kinds \
                 m4gn, mesh-graph-net and eagle"
            )
        })?;
        match &self.kind {
            Kind::MeshGraphNet { layers } | Kind::Gcn { layers } => within("layers", *layers, 0, MAX_LAYERS),
            Kind::BsmsGnn { levels } | Kind::GUNet { levels } => within("levels", *levels, 1, MAX_LEVELS),
            Kind::M4gn(m) | Kind::Eagle(m) => {
                let MacroSpec { layers, heads, ffn_width, rwse_steps, .. } = &m.segment_transformer;
                within("layers_before", m.layers_before, 0, MAX_LAYERS)?;
                // What a decoder does not read of the segments, layers have to.
                let least = usize::from(!self.decodes_segments());
                within("layers_after", m.layers_after, least, MAX_LAYERS)?;
                within("macro stage, layers", *layers, 0, MAX_LAYERS)?;
                within("macro stage, heads", *heads, 1, self.width)?;
                within("macro stage, ffn_width", *ffn_width, 1, 4 * MAX_WIDTH)?;
                within("macro stage, rwse_steps", *rwse_steps, 0, MAX_LAYERS)?;
                expect(self.width.is_multiple_of(*heads), || {
                    format!("macro stage, heads: {heads} does not divide the width {}", self.width)
                })
            }
        }
    }
}

/// This message unless `ok`.
fn expect(ok: bool, message: impl FnOnce() -> String) -> Verdict {
    match ok {
        true => Ok(()),
        false => Err(message()),
    }
}

#[cfg(test)]
mod tests {
    use crate::sample::{bodies, spec};
    use crate::{Calibration, ContactSpec, Growth, Kind, MacroSpec, NodeSums, Output, Precision, WorldEdges};
    use m4gn_mesh::NodeType;

    fn grows(fields: &[&str]) -> Option<Calibration> {
        let growth = fields.iter().map(|f| Growth { field: (*f).into(), factors: vec![1.0] });
        Some(Calibration { growth: growth.collect(), ..Calibration::default() })
    }

    #[test]
    fn refuses_what_no_network_can_be_made_of() {
        assert!(spec().check().is_ok());
        type Change = fn(&mut crate::ModelSpec);
        let broken: [(&str, Change); 26] = [
            ("format", |s| s.format = 2),
            ("dim", |s| s.dim = 1),
            ("stride", |s| s.stride = f64::NAN),
            ("fields: expected at most 1024", |s| s.fields = vec![s.fields[0].clone(); 1025]),
            ("twice", |s| s.fields[1].name = "U".into()),
            ("floor: expected a positive", |s| s.fields[1].floor = Some(0.0)),
            ("which no vector is", |s| s.fields[0].floor = Some(1.0)),
            ("no kinematic pressure", |s| s.fields[1].floor = Some(1.0)),
            ("no field is an output", |s| s.fields.truncate(0)),
            ("can only be added", |s| {
                s.fields[1].output = Output::Delta;
                s.fields[1].input = false;
            }),
            ("fluid", |s| s.node_types.retain(|t| *t != NodeType::Fluid)),
            ("heads", |s| s.architecture.m4gn_mut().unwrap().segment_transformer.heads = 3),
            ("layers: expected", |s| s.architecture.kind = Kind::Gcn { layers: 1025 }),
            ("levels: expected", |s| s.architecture.kind = Kind::BsmsGnn { levels: 17 }),
            ("layers_after: expected 1 to", |s| {
                let mut stage = s.architecture.m4gn().unwrap().clone();
                stage.layers_after = 0;
                s.architecture.kind = Kind::Eagle(stage);
            }),
            ("kind g-u-net keeps", |s| {
                (s.precision, s.architecture.kind) = (Precision::Bf16, Kind::GUNet { levels: 1 });
            }),
            ("hidden_layers", |s| s.architecture.hidden_layers = 0),
            ("no field is an input", |s| {
                s.fields.truncate(1);
                (s.fields[0].input, s.fields[0].output) = (false, Output::Value);
            }),
            ("width", |s| s.architecture.width = 0),
            ("world_edges: \"apart\"", |s| s.architecture.micro.world_edges = WorldEdges::Apart),
            ("world_edges: kind g-u-net has no", |s| {
                *s = bodies();
                s.architecture.micro.world_edges = WorldEdges::Apart;
                s.architecture.kind = Kind::GUNet { levels: 1 };
            }),
            ("node_rwse_steps: expected 0 to 64", |s| s.architecture.micro.node_rwse_steps = 65),
            ("node_sums: kind gcn has no", |s| {
                s.architecture.kind = Kind::Gcn { layers: 1 };
                s.architecture.micro.node_sums = NodeSums::Before;
            }),
            ("each once, found T", |s| s.calibration = grows(&["T"])),
            ("each once, found U", |s| s.calibration = grows(&["U", "U"])),
            ("segments.count", |s| s.segments.count = 0),
        ];
        for (word, change) in broken {
            let mut s = spec();
            change(&mut s);
            let message = s.check().expect_err(word).to_string();
            assert!(message.contains(word), "{message} does not mention {word}");
        }
        let contact = |radius, input| {
            let mut s = bodies();
            s.fields[0].input = input;
            s.contact = Some(ContactSpec { radius });
            s
        };
        assert!(contact(0.01, false).check().is_ok());
        for (word, s) in [
            ("radius", contact(0.0, false)),
            ("edges carry", contact(0.01, true)),
            ("nodes carry", {
                let mut s = bodies();
                s.architecture.kind = Kind::Gcn { layers: 1 };
                s
            }),
        ] {
            let message = s.check().unwrap_err().to_string();
            assert!(message.contains(word), "{message}");
            let remedy = message.contains("delete the table [contact]");
            assert_eq!(remedy, word != "radius", "{message}");
        }
        let mut s = spec();
        s.architecture.m4gn_mut().unwrap().segment_transformer =
            MacroSpec { layers: 0, heads: 1, ffn_width: 1, rwse_steps: 0, centroids: false, offsets: false };
        assert!(s.check().is_ok());
    }
}
