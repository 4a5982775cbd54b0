//! Several bodies that deform and touch one another, such as two beams, one upon the other: parts of a body that share no point.

use m4gn_mesh::body::Body;
use m4gn_mesh::vector::Vector;

/// The skins of all parts of a body, whole on all ranks.
#[derive(Clone, Debug, PartialEq)]
pub struct Skins {
    /// Points on a skin, as numbers of the whole body, ascending.
    pub points: Vec<u32>,
    /// The rank of each.
    pub ranks: Vec<i32>,
    /// The part of each.
    pub parts: Vec<u32>,
    /// Their positions at rest, m.
    pub rest: Vec<Vector>,
    /// Triangles of each part's skin, as places in `points`, normals outward; quadrilaterals are cut in two.
    pub triangles: Vec<Vec<[i32; 3]>>,
}

impl Skins {
    /// Those of a body of several parts; none of a body in one, which touches nothing but the obstacle. `ranks` are those of its points.
    pub fn new(body: &Body, ranks: &[i32]) -> Option<Self> {
        let n = body.positions.len();
        let part = body.elements.parts(n);
        let count = part.iter().max().map_or(0, |&last| last as usize + 1);
        if count < 2 {
            return None;
        }
        let faces = body.elements.skin();
        let mut points: Vec<u32> = faces.iter().flatten().map(|&p| p as u32).collect();
        points.sort_unstable();
        points.dedup();
        let place = |p: i32| points.binary_search(&(p as u32)).unwrap_or_default() as i32;
        let mut triangles = vec![Vec::new(); count];
        for face in &faces {
            let corners: Vec<i32> = face.iter().map(|&p| place(p)).collect();
            let fan = corners[1..].windows(2).map(|pair| [corners[0], pair[0], pair[1]]);
            triangles[part[face[0] as usize] as usize].extend(fan);
        }
        // In an order of their own, whatever the order of the elements' faces is.
        triangles.iter_mut().for_each(|t| t.sort_unstable());
        Some(Skins {
            ranks: points.iter().map(|&p| ranks[p as usize]).collect(),
            parts: points.iter().map(|&p| part[p as usize]).collect(),
            rest: points.iter().map(|&p| body.positions[p as usize]).collect(),
            points,
            triangles,
        })
    }

    /// The same skins reflected in y.
    pub(crate) fn reflect(&mut self) {
        self.rest.iter_mut().for_each(|x| x[1] = -x[1]);
        // So that normals still leave the parts.
        self.triangles.iter_mut().flatten().for_each(|t| t.swap(1, 2));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_mesh::surface::Surface;
    use m4gn_samples::bodies as sample;

    #[test]
    fn a_body_in_one_part_has_none() {
        let body = sample::block([3, 1, 1], [3.0, 1.0, 1.0]);
        assert_eq!(Skins::new(&body, &[0; 16]), None);
    }

    #[test]
    fn skins_are_closed_and_know_their_part() {
        let body = sample::stack([3, 2, 2], [3.0, 1.0, 1.0], 0.25);
        let ranks: Vec<i32> = (0..body.positions.len() as i32).map(|p| p % 2).collect();
        let skins = Skins::new(&body, &ranks).unwrap();
        // 36 points each, of which two are inside.
        assert_eq!((skins.points.len(), skins.triangles.len()), (68, 2));
        for (part, triangles) in skins.triangles.iter().enumerate() {
            let surface = Surface::new(&skins.rest, triangles).unwrap();
            let (inside, above) = ([1.5, 0.5, 0.5 + 1.25 * part as f64], [1.5, 0.5, 3.0]);
            assert!((surface.distance(inside) + 0.5).abs() < 1e-12);
            assert!(surface.distance(above) > 0.0);
        }
        for (i, &p) in skins.points.iter().enumerate() {
            assert_eq!(skins.ranks[i], p as i32 % 2);
            assert_eq!(skins.parts[i], u32::from(p >= 36));
        }
    }
}
