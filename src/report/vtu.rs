//! VTK's XML formats, which ParaView opens: unstructured grids (*.vtu) and series of them (*.pvd).

use base64::{Engine, engine::general_purpose::STANDARD};
use m4gn_base::{Error, Result};
use m4gn_mesh::elements::{ElementKind, Elements};
use std::fmt::Write;

/// Cells as VTK counts their points.
#[derive(Clone, Debug, Default)]
pub struct Grid {
    points: Vec<i64>,
    ends: Vec<i64>,
    kinds: Vec<u8>,
}

impl Grid {
    /// `kind`: VTK's code.
    fn add(&mut self, kind: i32, points: impl IntoIterator<Item = i32>) {
        self.points.extend(points.into_iter().map(i64::from));
        self.ends.push(self.points.len() as i64);
        self.kinds.push(kind as u8);
    }

    /// Of elements.
    pub fn of_elements(elements: &Elements) -> Self {
        let mut grid = Grid::default();
        for e in 0..elements.len() {
            let (kind, p) = (elements.kind[e], elements.points_of(e));
            match kind {
                // VTK's wedges have the normal of their first triangle outward.
                ElementKind::Wedge => grid.add(kind as i32, [0, 2, 1, 3, 5, 4].map(|i| p[i])),
                _ => grid.add(kind as i32, p.iter().copied()),
            }
        }
        grid
    }

    /// Of triangles.
    pub fn of_triangles(triangles: &[[i32; 3]]) -> Self {
        let mut grid = Grid::default();
        triangles.iter().for_each(|t| grid.add(5, *t));
        grid
    }

    /// A vertex for each of so many points: without cells ParaView draws nothing.
    pub fn of_points(n: usize) -> Self {
        let mut grid = Grid::default();
        (0..n as i32).for_each(|p| grid.add(1, [p]));
        grid
    }

    /// The file's text with the points at `points` `[N]`, m, and fields there, in single precision: name, components (1 or 3), values
    /// `[N x components]`.
    ///
    /// # Errors
    /// [`Error::Internal`] for a field of another length.
    pub fn vtu(&self, points: &[[f64; 3]], fields: &[(&str, usize, &[f64])]) -> Result<String> {
        let (n, c) = (points.len(), self.kinds.len());
        if let Some((name, width, values)) =
            fields.iter().find(|(_, width, values)| values.len() / width != n)
        {
            let found = values.len() / width;
            return Err(Error::Internal(format!("field {name} has {found} values for {n} points")));
        }
        let mut text = format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" \
             header_type=\"UInt64\">\n<UnstructuredGrid>\n<Piece NumberOfPoints=\"{n}\" NumberOfCells=\"{c}\">\n<PointData>\n"
        );
        for (name, components, values) in fields {
            let data = bytes(values.iter().map(|x| (*x as f32).to_le_bytes()));
            array(&mut text, "Float32", &super::page::escape(name), *components, &data);
        }
        text += "</PointData>\n<Points>\n";
        let flat = points.iter().flatten().map(|v| v.to_le_bytes());
        array(&mut text, "Float64", "Points", 3, &bytes(flat));
        text += "</Points>\n<Cells>\n";
        for (name, values) in [("connectivity", &self.points), ("offsets", &self.ends)] {
            let data = bytes(values.iter().map(|v| v.to_le_bytes()));
            array(&mut text, "Int64", name, 1, &data);
        }
        array(&mut text, "UInt8", "types", 1, &self.kinds);
        text += "</Cells>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n";
        Ok(text)
    }
}

/// The text of a series: times in s and the files, as seen from where the series lies.
pub fn pvd(files: &[(f64, String)]) -> String {
    let mut text = String::from(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n<Collection>\n",
    );
    for (time, file) in files {
        // Writing to a String does not fail.
        let _ = writeln!(text, "<DataSet timestep=\"{time}\" file=\"{}\"/>", super::page::escape(file));
    }
    text + "</Collection>\n</VTKFile>\n"
}

fn bytes<const N: usize>(values: impl Iterator<Item = [u8; N]>) -> Vec<u8> {
    values.flatten().collect()
}

/// An array as VTK's inline "binary": its length in bytes, then the bytes, together in base64.
fn array(text: &mut String, kind: &str, name: &str, components: usize, data: &[u8]) {
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
        let points = [[0.0; 3], [1.0, 0.0, 0.0]];
        let text = Grid::of_points(2).vtu(&points, &[("m4gnSegment", 1, &[0.0, 1.0])]).unwrap();
        let after = text.split("Name=\"m4gnSegment\"").nth(1).unwrap();
        let data = STANDARD.decode(after.lines().nth(1).unwrap()).unwrap();
        assert_eq!(data, [&8u64.to_le_bytes()[..], &0f32.to_le_bytes(), &1f32.to_le_bytes()].concat());
        assert!(text.contains("NumberOfPoints=\"2\" NumberOfCells=\"2\""));
        assert_eq!(text.matches("<DataArray").count(), text.matches("</DataArray>").count());
        assert!(Grid::of_points(2).vtu(&points, &[("a", 1, &[1.0])]).is_err());
    }

    #[test]
    fn a_wedge_and_a_series() {
        let wedge = Elements::of_kind(ElementKind::Wedge, (0..6).collect());
        let points = [[0.0; 3]; 6];
        let text = Grid::of_elements(&wedge).vtu(&points, &[("D", 3, points.as_flattened())]).unwrap();
        let after = text.split("Name=\"connectivity\"").nth(1).unwrap();
        let data = STANDARD.decode(after.lines().nth(1).unwrap()).unwrap();
        let numbers: Vec<u8> = data[8..].iter().step_by(8).copied().collect();
        assert_eq!(numbers, [0, 2, 1, 3, 5, 4]);
        assert!(text.contains("Name=\"D\" NumberOfComponents=\"3\"") && text.contains("NumberOfCells=\"1\""));
        assert!(
            Grid::of_triangles(&[[0, 1, 2]]).vtu(&points, &[("D", 3, points[1..].as_flattened())]).is_err()
        );
        let series = pvd(&[(0.5, "a_0.vtu".into()), (1.0, "a_1.vtu".into())]);
        assert!(
            series.contains("timestep=\"0.5\" file=\"a_0.vtu\"") && series.matches("<DataSet").count() == 2
        );
    }
}
