//! A body at points and the obstacle that may touch it, as they are found in a file.

use super::source::Source;
use m4gn_base::Result;
use m4gn_mesh::NodeType;
use m4gn_mesh::body::{Body, Material, Obstacle};
use m4gn_mesh::elements::{ElementKind, Elements};

impl Source<'_> {
    /// The body at rest; none where the fields are at cells.
    pub(super) fn body(&self, file: &hdf5::File) -> Result<Option<Body>> {
        if !file.link_exists("elements") {
            return Ok(None);
        }
        let positions = self.points(file, "mesh/cell_centres")?;
        let types_at = "mesh/point_type";
        let types: Vec<i32> = self.values(file, types_at, &[Some(positions.len())])?;
        let types = types.iter().enumerate().map(|(i, &t)| match t {
            6 => Ok(NodeType::Body),
            7 => Ok(NodeType::Handle),
            _ => Err(self.damaged(format!("/{types_at}[{i}] is {t}, expected 6 (body) or 7 (handle)"))),
        });
        let types = types.collect::<Result<_>>()?;
        let elements = self.elements(file, positions.len())?;
        let n = elements.len();
        let value = |name: &str| -> Result<Vec<f64>> {
            let path = format!("elements/{name}");
            let values: Vec<f64> = self.values(file, &path, &[Some(n)])?;
            self.check_finite(&path, &values)?;
            Ok(values)
        };
        let (young, poisson, density) = (value("young")?, value("poisson")?, value("density")?);
        let material = (0..n).map(|e| Material { young: young[e], poisson: poisson[e], density: density[e] });
        let body = Body { types, material: material.collect(), edges: elements.edges(), positions, elements };
        body.check().map_err(|e| self.wrong("/elements", &e))?;
        Ok(Some(body))
    }

    fn elements(&self, file: &hdf5::File, n_points: usize) -> Result<Elements> {
        let kind: Vec<i32> = self.values(file, "elements/kind", &[None])?;
        let kind = kind.iter().enumerate().map(|(i, &k)| {
            ElementKind::from_code(k).map_err(|e| self.damaged(format!("/elements/kind[{i}]: {e}")))
        });
        let kind: Vec<ElementKind> = kind.collect::<Result<_>>()?;
        let mut start = vec![0];
        start.extend(kind.iter().scan(0, |end, k| {
            *end += k.n_points();
            Some(*end)
        }));
        let points = self.labels(file, "elements/points", start.last().copied(), n_points)?;
        let elements = Elements { kind, start, points };
        for e in 0..elements.len() {
            let corners = elements.points_of(e);
            if let Some(i) = (1..corners.len()).find(|&i| corners[..i].contains(&corners[i])) {
                return Err(self.damaged(format!("element {e} has the point {} twice", corners[i])));
            }
        }
        Ok(elements)
    }

    /// The closed surface of the obstacle beside the body, where there is one.
    pub(super) fn obstacle(&self, file: &hdf5::File, body: &Body) -> Result<Option<Obstacle>> {
        if !file.link_exists("obstacle") {
            return Ok(None);
        }
        let positions = self.points(file, "obstacle/positions")?;
        let triangles = self.label_rows(file, "obstacle/triangles", positions.len())?;
        let obstacle = Obstacle { positions, triangles };
        let checked = obstacle.check(body);
        checked.map_err(|e| self.wrong("/obstacle", &e))?;
        Ok(Some(obstacle))
    }

    /// Finite positions, m.
    fn points(&self, file: &hdf5::File, name: &str) -> Result<Vec<[f64; 3]>> {
        let positions = self.vectors(file, name, None)?;
        self.check_finite(name, positions.as_flattened())?;
        Ok(positions)
    }
}
