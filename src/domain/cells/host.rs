//! Fields by name into states, and the network's outputs into fields.

use super::groups::OnGroups;
use super::{Cells, Levels};
use crate::boundary::{Boundary, faces_seen_as_their_cells};
use crate::field::expect_shape;
use crate::host::{Host, HostOptions, Hosted, Predict};
use crate::{Components, Domain, Field};
use m4gn_base::{Error, Result};
use m4gn_mesh::Mesh;
use m4gn_model::{FieldSpec, ModelSpec, Output, SegmentSpec, cell_size};
use m4gn_parallel::Comm;
use m4gn_structure::coarse::Coarse;
use m4gn_structure::{Record, Structure};

/// The fields at a host's cells and boundary faces.
pub struct CellsHost {
    domain: Cells,
    spec: ModelSpec,
    directions: Vec<usize>,
    n_cells: usize,
    n_boundary: usize,
    /// Boundary faces whose vectors are read from their cells, and these cells.
    read_from_cells: Vec<(usize, usize)>,
    /// The way to the groups that the network lives on, where these are not the cells.
    groups: Option<OnGroups>,
    levels: Levels,
    /// What of the boundary is prescribed.
    rule: Boundary,
    /// Of each output the boundary faces at points that have it prescribed, and these points.
    held: Vec<Vec<(usize, usize)>>,
    /// All components of the fields `[(n_cells + n_boundary) x components]`; zero where the model does not read them.
    state: Vec<f32>,
}

impl CellsHost {
    /// As [`crate::open`].
    pub(crate) fn open(mesh: &Mesh, spec: &ModelSpec, options: &HostOptions, comm: &Comm) -> Result<Hosted> {
        let groups = OnGroups::new(mesh, options.resolution, spec, comm)?;
        let nodes = groups.as_ref().map_or(mesh, |groups| &groups.coarse.mesh);
        let needs = spec.architecture.needs();
        let labels = match needs.segments {
            true => on_all_ranks(options.labels, mesh.n_cells(), comm),
            false => None,
        };
        if groups.is_some() && needs.segments && labels.is_none() {
            enough(mesh, nodes, options.segments, comm)?;
        }
        let of_groups = match (&groups, labels) {
            (Some(groups), Some(labels)) => Some(groups.labels(mesh, labels, comm)?),
            _ => None,
        };
        let labels = of_groups.as_deref().or(labels);
        let structure = Structure::new(nodes, spec, options.segments, options.modes, labels, comm)?;
        let node_segment = structure.segments.as_ref().map_or(Vec::new(), |found| {
            let labels = &found.node_segment[..nodes.n_cells()];
            match &groups {
                Some(groups) => groups.coarse.labels_of_cells(labels, comm),
                None => labels.to_vec(),
            }
        });
        let handed_in = comm.any(options.labels.is_some());
        let segment_record = match &structure.segments {
            Some(_) if !handed_in => Record::new(mesh, options.segments, &node_segment, comm)?.text()?,
            _ => String::new(),
        };
        let domain = Cells::new(nodes, spec);
        let rule = Boundary::new(mesh, &spec.fields, spec.dim);
        let held = held(&rule, domain.components());
        let size = mesh.n_nodes() * domain.components().count;
        Ok(Hosted {
            n_segments: structure.n_segments(),
            cell_size: cell_size(nodes, comm),
            host: Box::new(CellsHost {
                domain,
                spec: spec.clone(),
                directions: mesh.directions.clone(),
                n_cells: mesh.n_cells(),
                n_boundary: mesh.boundary.len(),
                read_from_cells: faces_seen_as_their_cells(mesh),
                groups,
                rule,
                held,
                levels: Levels::new(mesh, spec, comm),
                state: vec![0.0; size],
            }),
            structure,
            node_segment,
            segment_record,
        })
    }

    /// Components of a vector or a scalar in a host's rows.
    fn directions(&self, vector: bool) -> &[usize] {
        if vector { &self.directions } else { &[0] }
    }

    /// The state from fields.
    fn gather(&mut self, fields: &[Field]) -> Result<()> {
        let width = self.domain.components().count;
        let mut state = std::mem::take(&mut self.state);
        let mut column = 0;
        let done = self.spec.fields.iter().try_for_each(|spec| {
            let columns = column..column + self.directions(spec.vector).len();
            column = columns.end;
            if spec.input { self.read(spec, fields, &mut state, (width, columns)) } else { Ok(()) }
        });
        self.state = state;
        done
    }

    /// One field into its columns.
    fn read(
        &self,
        spec: &FieldSpec,
        fields: &[Field],
        state: &mut [f32],
        (width, columns): (usize, std::ops::Range<usize>),
    ) -> Result<()> {
        let (name, vector) = (spec.name.as_str(), spec.vector);
        let field = fields.iter().find(|f| f.name == name).ok_or_else(|| {
            let read = self.spec.fields.iter().filter(|f| f.input);
            let names: Vec<&str> = read.map(|f| f.name.as_str()).collect();
            Error::Input(format!("input field '{name}' is missing; the model reads {}", names.join(", ")))
        })?;
        let c = field.components;
        expect_shape(name, "cell", vector, c, field.cells.len(), self.n_cells)?;
        expect_shape(name, "boundary", vector, c, field.boundary.len(), self.n_boundary)?;
        let rows = field.cells.chunks_exact(c).chain(field.boundary.chunks_exact(c));
        for (node, (to, from)) in state.chunks_exact_mut(width).zip(rows).enumerate() {
            for (to, &d) in to[columns.clone()].iter_mut().zip(self.directions(vector)) {
                if !from[d].is_finite() {
                    let place = place(node, self.n_cells);
                    return Err(Error::Numerical(format!("input field '{name}' is {} at {place}", from[d])));
                }
                *to = spec.seen(from[d]) as f32;
            }
        }
        for &(face, cell) in self.read_from_cells.iter().filter(|_| vector) {
            let (from, to) = (cell * width, (self.n_cells + face) * width);
            state.copy_within(from + columns.start..from + columns.end, to + columns.start);
        }
        Ok(())
    }

    /// Fields at the new time from the network's outputs and the fields of now.
    fn scatter(&self, outputs: &[f32], fields: &[Field], result: &mut [f64]) -> Result<()> {
        let m = self.spec.n_outputs();
        let mut column = 0;
        for spec in self.spec.fields.iter().filter(|f| f.output != Output::None) {
            let directions = self.directions(spec.vector);
            let old = match spec.output {
                Output::Delta => fields.iter().find(|f| f.name == spec.name),
                _ => None,
            };
            let level = match spec.output {
                Output::Value => self.levels.of(&spec.name),
                _ => 0.0,
            };
            for (i, &d) in directions.iter().enumerate() {
                let rows = result.chunks_exact_mut(m).zip(outputs.chunks_exact(m));
                for (cell, (result, output)) in rows.enumerate() {
                    let before = old.map_or(level, |f| spec.seen(f.cells[cell * f.components + d]));
                    let after = spec.physical(before + f64::from(output[column + i]));
                    if !after.is_finite() {
                        return Err(Error::Numerical(format!(
                            "the model's '{}' is {after} at {}: the state has left what it was trained on; hand \
                             back to the solver sooner",
                            spec.name,
                            place(cell, self.n_cells)
                        )));
                    }
                    result[column + i] = after;
                }
                // Of the new time the host knows what it prescribes better: it sets that afterwards.
                if let Some(f) = fields.iter().find(|f| f.name == spec.name) {
                    for (face, point) in &self.held[column + i] {
                        result[point * m + column + i] = f.boundary[face * f.components + d];
                    }
                }
            }
            column += directions.len();
        }
        Ok(())
    }
}

impl Host for CellsHost {
    fn domain(&self) -> &dyn Domain {
        &self.domain
    }

    fn step(
        &mut self,
        comm: &Comm,
        network: &mut dyn Predict,
        fields: &[Field],
        checked: Result<()>,
        result: &mut [f64],
    ) -> Result<()> {
        let gathered = checked.and_then(|()| self.gather(fields));
        comm.agree(gathered)?;
        self.levels.take_off(fields, &mut self.state, comm);
        let done = match &mut self.groups {
            Some(groups) => groups
                .predict(comm, network, &self.domain, &self.state)
                .and_then(|outputs| self.scatter(&outputs, fields, result)),
            None => network
                .predict(comm, &self.domain, &mut self.state, &[])
                .and_then(|outputs| self.scatter(outputs, fields, result)),
        };
        comm.agree(done)
    }

    fn see(&mut self, fields: &[Field]) {
        if self.held.iter().all(Vec::is_empty) {
            return;
        }
        for (k, spec) in self.spec.fields.iter().enumerate().filter(|(_, spec)| spec.vector) {
            let Some(field) = fields.iter().find(|f| f.name == spec.name) else { continue };
            let rows = field.boundary.chunks_exact(field.components);
            let solved = rows.flat_map(|row| self.directions.iter().map(|&d| row[d] as f32));
            self.rule.see_field(k, &[], &solved.collect::<Vec<f32>>());
        }
        self.rule.settle();
        self.held = held(&self.rule, self.domain.components());
    }

    fn groups(&self) -> Option<&Coarse> {
        self.groups.as_ref().map(|groups| &groups.coarse)
    }

    fn seen(&self) -> &[f32] {
        &self.state
    }
}

/// Of each output the boundary faces at points that have it prescribed, and these points.
fn held(rule: &Boundary, components: &Components) -> Vec<Vec<(usize, usize)>> {
    components.outputs.iter().map(|&c| rule.held_points(c).collect()).collect()
}

fn place(node: usize, n_cells: usize) -> String {
    match node.checked_sub(n_cells) {
        None => format!("cell {node}"),
        Some(face) => format!("boundary face {face}"),
    }
}

/// Whether there are as many groups as segments: there are fewer in a case that is far smaller than those of the training.
fn enough(mesh: &Mesh, groups: &Mesh, segments: &SegmentSpec, comm: &Comm) -> Result<()> {
    let mut total = [mesh.n_cells() as i64, groups.n_cells() as i64];
    comm.sum_i64(&mut total);
    let [cells, nodes] = total;
    if segments.count as i64 <= nodes {
        return Ok(());
    }
    Err(Error::Input(format!(
        "the {cells} cells of this case are {nodes} nodes at the network's resolution, and it has {} segments: the case is \
         far smaller than those that the model was trained on; if it shall be tried all the same, set resolution (off, or \
         a shorter length in m) or segments {{ count }} in the dictionary",
        segments.count
    )))
}

/// The labels handed in. A rank without cells has labels, none, exactly if another rank has some. Collective.
fn on_all_ranks<'a>(labels: Option<&'a [i32]>, n_cells: usize, comm: &Comm) -> Option<&'a [i32]> {
    let any = comm.any(labels.is_some());
    if n_cells > 0 { labels } else { any.then_some(&[]) }
}
