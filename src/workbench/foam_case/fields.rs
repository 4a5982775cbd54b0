//! Cell fields in the folder that a run starts from.

use super::FoamCase;
use crate::generate::openfoam::absolute;
use m4gn_base::{Error, Result};
use serde_json::json;
use std::path::PathBuf;

/// Who wrote a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stored {
    /// There is no such field.
    Nowhere,
    /// The note in its header begins with the mark that was asked for.
    Marked,
    /// Somebody else.
    Foreign,
}

impl FoamCase {
    /// Folder that a run starts from, and that [`Self::write_fields`] writes to.
    pub fn start_folder(&self) -> PathBuf {
        PathBuf::from(&self.description.path).join(&self.description.start)
    }

    /// Whether a field is stored in the folder of the start time (compressed or not), and by whom.
    ///
    /// # Errors
    /// OpenFOAM's message for a file that cannot be read.
    pub fn stored(&mut self, name: &str, mark: &str) -> Result<Stored> {
        let found = self.handle.query(&json!({ "query": "start_field", "name": name, "mark": mark }))?;
        Ok(match found[..] {
            [0.0] => Stored::Nowhere,
            [1.0] => Stored::Marked,
            _ => Stored::Foreign,
        })
    }

    /// Writes volScalarFields without dimensions, a value a cell, zeroGradient on patches, in the case's own
    /// `writeFormat` and `writeCompression`, into the folder of the start time: all of them or none. Afterwards the
    /// fields `remove` are removed from there. `note` stands in the headers; `segment_record` is stored with the segments.
    ///
    /// # Errors
    /// [`Error::Input`] for a wrong number of values; OpenFOAM's message when a file cannot be written.
    pub fn write_fields(
        &mut self,
        fields: &[(String, Vec<f64>)],
        note: &str,
        remove: &[String],
        segment_record: &str,
    ) -> Result<()> {
        let cells = self.description.cells;
        if let Some((name, values)) = fields.iter().find(|(_, v)| v.len() != cells) {
            return Err(Error::Input(format!("field {name}: {} values for {cells} cells", values.len())));
        }
        let names: Vec<&str> = fields.iter().map(|(name, _)| name.as_str()).collect();
        let values: Vec<f64> = fields.iter().flat_map(|(_, v)| v).copied().collect();
        let request =
            json!({ "fields": names, "note": note, "remove": remove, "segment_record": segment_record });
        self.handle.write(&request, &values)
    }

    /// Takes the cells' values of the fields in the folder of the start time from `sources`, time folders of cases of the same mesh: the sum of
    /// theirs by the weights. Boundary conditions stay. Fields that have neither mass nor temperature in their dimensions are scaled by the
    /// ratio of each source to the power that the second has in them, a velocity's by the first and a kinematic pressure's by the second
    /// power. Returns how many fields were taken: those that all sources have.
    ///
    /// # Errors
    /// OpenFOAM's message for fields of other sizes or dimensions, and files that cannot be read or written.
    pub fn take_start(&mut self, sources: &[Source]) -> Result<usize> {
        let of = |f: fn(&Source) -> f64| sources.iter().map(f).collect::<Vec<f64>>();
        let (weights, ratios) = (of(|s| s.weight), of(|s| s.ratio));
        let sources = sources.iter().map(|s| absolute(&s.folder)).collect::<Result<Vec<_>>>()?;
        let request =
            json!({ "query": "take_start", "sources": sources, "weights": weights, "ratios": ratios });
        Ok(self.handle.query(&request)?[0] as usize)
    }

    /// Integrals of the products of the vector fields in time folders with those in the others, of all fields that the folder of the start time
    /// has: a row a folder.
    ///
    /// # Errors
    /// OpenFOAM's message for fields of other sizes, and files that cannot be read.
    pub fn products(&mut self, folders: &[PathBuf]) -> Result<Vec<Vec<f64>>> {
        let all = folders.iter().map(|f| absolute(f)).collect::<Result<Vec<_>>>()?;
        let all = self.handle.query(&json!({ "query": "products", "folders": all }))?;
        Ok(all.chunks_exact(folders.len().max(1)).map(<[f64]>::to_vec).collect())
    }
}

/// A time folder that a start is taken from.
#[derive(Clone, Debug)]
pub struct Source {
    /// The folder.
    pub folder: PathBuf,
    /// Its share.
    pub weight: f64,
    /// Own velocity over that of its run.
    pub ratio: f64,
}
