//! What a model's description must satisfy before anything is made from it.

use super::{MacroSpec, ModelSpec, Output};
use crate::mesh::NodeType;
use crate::{Error, Result};

/// Version of the header schema that this library reads and writes.
const FORMAT: u32 = 1;

/// Largest width and layer count accepted: far beyond any sensible network, small enough that no product of two
/// overflows and a damaged header cannot ask for more memory than there is.
const MAX_WIDTH: usize = 1 << 14;
const MAX_LAYERS: usize = 1 << 10;

impl ModelSpec {
    /// Checks that the description is one that a network can be made of.
    ///
    /// # Errors
    /// [`Error::Model`] naming the entry, what was expected and what was found.
    pub fn check(&self) -> Result<()> {
        expect(self.format == FORMAT, || {
            format!(
                "format: expected {FORMAT}, found {}: written by another version of m4gn",
                self.format
            )
        })?;
        expect(matches!(self.dim, 2 | 3), || {
            format!("dim: expected 2 or 3, found {}", self.dim)
        })?;
        expect(self.stride.is_finite() && self.stride > 0.0, || {
            format!("stride: expected a positive time in s, found {}", self.stride)
        })?;
        self.check_fields()?;
        self.check_contact()?;
        self.check_node_types()?;
        self.check_architecture()?;
        self.check_segments()
    }

    fn check_fields(&self) -> Result<()> {
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
            let carried = self.contact.is_some() && i == 0;
            expect(field.input || field.output != Output::Delta || carried, || {
                format!(
                    "field '{name}': a change can only be added to a field that is an input; use \"value\""
                )
            })?;
        }
        expect(self.fields.len() <= MAX_LAYERS, || {
            format!("fields: {} are too many", self.fields.len())
        })?;
        expect(self.n_outputs() > 0, || "fields: no field is an output".into())
    }

    fn check_contact(&self) -> Result<()> {
        let Some(contact) = &self.contact else {
            return Ok(());
        };
        expect(contact.radius.is_finite() && contact.radius > 0.0, || {
            format!(
                "contact.radius: expected a positive length in m, found {}",
                contact.radius
            )
        })?;
        expect(self.dim == 3, || {
            format!("contact: bodies are three-dimensional, found dim {}", self.dim)
        })?;
        let first = self.fields.first();
        let carries = first.is_some_and(|f| f.vector && !f.input && f.output == Output::Delta);
        expect(carries && self.fields.len() == 1, || {
            "contact: expected one field, the displacement: a vector, no input (edges carry it), output \"delta\"".into()
        })
    }

    fn check_node_types(&self) -> Result<()> {
        let unknown = match self.contact {
            Some(_) => NodeType::Body,
            None => NodeType::Fluid,
        };
        expect(self.node_types.contains(&unknown), || {
            let of = if self.contact.is_some() { "points" } else { "cells" };
            format!("node_types: '{}' ({of}) is missing", unknown.name())
        })?;
        for (i, kind) in self.node_types.iter().enumerate() {
            expect(!self.node_types[..i].contains(kind), || {
                format!("node type '{}' appears twice", kind.name())
            })?;
        }
        Ok(())
    }

    fn check_architecture(&self) -> Result<()> {
        let a = &self.architecture;
        let within = |name: &str, value: usize, low: usize, high: usize| {
            expect((low..=high).contains(&value), || {
                format!("{name}: expected {low} to {high}, found {value}")
            })
        };
        within("architecture.width", a.width, 1, MAX_WIDTH)?;
        within("architecture.hidden_layers", a.hidden_layers, 0, 16)?;
        within("architecture.layers_before", a.layers_before, 0, MAX_LAYERS)?;
        within("architecture.layers_after", a.layers_after, 0, MAX_LAYERS)?;
        match &a.segment_transformer {
            Some(MacroSpec {
                layers,
                heads,
                ffn_width,
                rwse_steps,
                ..
            }) => {
                within("segment_transformer.layers", *layers, 0, MAX_LAYERS)?;
                within("segment_transformer.heads", *heads, 1, a.width)?;
                within("segment_transformer.ffn_width", *ffn_width, 1, 4 * MAX_WIDTH)?;
                within("segment_transformer.rwse_steps", *rwse_steps, 0, MAX_LAYERS)?;
                expect(a.width.is_multiple_of(*heads), || {
                    format!(
                        "segment_transformer.heads: {heads} does not divide the width {}",
                        a.width
                    )
                })
            }
            None => expect(a.layers_after == 0, || {
                "layers_after: there is no segment_transformer that layers could come after; use layers_before".into()
            }),
        }
    }

    fn check_segments(&self) -> Result<()> {
        let s = &self.segments;
        expect((1..=1 << 20).contains(&s.count), || {
            format!("segments.count: expected 1 to {}, found {}", 1 << 20, s.count)
        })?;
        s.check()
            .map_err(|e| Error::Model(format!("model description: {e}")))
    }
}

/// An [`Error::Model`] with this message unless `ok`.
fn expect(ok: bool, message: impl FnOnce() -> String) -> Result<()> {
    if ok {
        Ok(())
    } else {
        Err(Error::Model(format!("model description: {}", message())))
    }
}

#[cfg(test)]
mod tests {
    use crate::mesh::NodeType;
    use crate::model::tests::{bodies, spec};
    use crate::model::{ContactSpec, MacroSpec, Output};

    #[test]
    fn refuses_what_no_network_can_be_made_of() {
        assert!(spec().check().is_ok());
        type Change = fn(&mut crate::model::ModelSpec);
        let broken: [(&str, Change); 11] = [
            ("format", |s| s.format = 2),
            ("dim", |s| s.dim = 1),
            ("stride", |s| s.stride = f64::NAN),
            ("twice", |s| s.fields[1].name = "U".into()),
            ("no field is an output", |s| s.fields.truncate(0)),
            ("can only be added", |s| {
                s.fields[1].output = Output::Delta;
                s.fields[1].input = false;
            }),
            ("fluid", |s| s.node_types.retain(|t| *t != NodeType::Fluid)),
            ("heads", |s| {
                s.architecture.segment_transformer.as_mut().unwrap().heads = 3
            }),
            ("layers_after", |s| s.architecture.segment_transformer = None),
            ("width", |s| s.architecture.width = 0),
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
        ] {
            assert!(s.check().unwrap_err().to_string().contains(word));
        }
        let mut s = spec();
        s.architecture.segment_transformer = Some(MacroSpec {
            layers: 0,
            heads: 1,
            ffn_width: 1,
            rwse_steps: 0,
            centroids: false,
            offsets: false,
        });
        assert!(s.check().is_ok());
    }
}
