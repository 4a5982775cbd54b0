//! Cell values as points with values: VTK's XML format for unstructured grids (*.vtu), which ParaView opens.

use crate::{Error, Result};
use base64::{Engine, engine::general_purpose::STANDARD};
use std::fmt::Write;

/// Points and values on them.
#[derive(Clone, Copy, Debug)]
pub struct PointCloud<'a> {
    /// Positions, m.
    pub points: &'a [[f64; 3]],
    /// Names and a value a point.
    pub fields: &'a [(String, Vec<f64>)],
}

impl PointCloud<'_> {
    /// The file's text. Numbers are in base64, without loss.
    ///
    /// # Errors
    /// [`Error::Internal`] for a field of another length.
    pub fn vtu(&self) -> Result<String> {
        let n = self.points.len();
        if let Some((name, values)) = self.fields.iter().find(|(_, v)| v.len() != n) {
            return Err(Error::Internal(format!(
                "field {name} has {} values for {n} points",
                values.len()
            )));
        }
        let mut text = format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" \
             header_type=\"UInt64\">\n<UnstructuredGrid>\n<Piece NumberOfPoints=\"{n}\" NumberOfCells=\"{n}\">\n<PointData>\n"
        );
        for (name, values) in self.fields {
            array(
                &mut text,
                "Float64",
                &super::page::escape(name),
                1,
                bytes(values.iter().map(|v| v.to_le_bytes())),
            );
        }
        text += "</PointData>\n<Points>\n";
        let flat = self.points.iter().flatten().map(|v| v.to_le_bytes());
        array(&mut text, "Float64", "Points", 3, bytes(flat));
        // A vertex a point: without cells ParaView draws nothing.
        text += "</Points>\n<Cells>\n";
        array(
            &mut text,
            "Int64",
            "connectivity",
            1,
            bytes((0..n as i64).map(i64::to_le_bytes)),
        );
        array(
            &mut text,
            "Int64",
            "offsets",
            1,
            bytes((1..=n as i64).map(i64::to_le_bytes)),
        );
        array(&mut text, "UInt8", "types", 1, vec![1; n]);
        text += "</Cells>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n";
        Ok(text)
    }
}

fn bytes<const N: usize>(values: impl Iterator<Item = [u8; N]>) -> Vec<u8> {
    values.flatten().collect()
}

/// An array as VTK's inline "binary": its length in bytes, then the bytes, together in base64.
fn array(text: &mut String, kind: &str, name: &str, components: usize, data: Vec<u8>) {
    let mut all = (data.len() as u64).to_le_bytes().to_vec();
    all.extend(data);
    // Writing to a String does not fail.
    let _ = writeln!(
        text,
        "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"binary\">\n{}\n</DataArray>",
        STANDARD.encode(&all)
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_points_on_paper() {
        let cloud = PointCloud {
            points: &[[0.0; 3], [1.0, 0.0, 0.0]],
            fields: &[("m4gnSegment".into(), vec![0.0, 1.0])],
        };
        let text = cloud.vtu().unwrap();
        let after = text.split("Name=\"m4gnSegment\"").nth(1).unwrap();
        let data = STANDARD.decode(after.lines().nth(1).unwrap()).unwrap();
        assert_eq!(data[..8], 16u64.to_le_bytes());
        assert_eq!(data[8..16], 0f64.to_le_bytes());
        assert_eq!(data[16..], 1f64.to_le_bytes());
        assert!(text.contains("NumberOfPoints=\"2\" NumberOfCells=\"2\""));
        assert_eq!(
            text.matches("<DataArray").count(),
            text.matches("</DataArray>").count()
        );
        let short = PointCloud {
            points: cloud.points,
            fields: &[("a".into(), vec![1.0])],
        };
        assert!(short.vtu().is_err());
    }
}
