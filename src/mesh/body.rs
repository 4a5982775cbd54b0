//! A body that deforms, by its points, and a rigid obstacle that may touch it.

use crate::elements::{ElementKind, Elements};
use crate::surface::Surface;
use crate::vector::{Vector, cross, moved, norm, sub};
use crate::{Mesh, NodeType};
use m4gn_base::{Error, Result, refuse, refuse_any};
use m4gn_parallel::{Comm, everywhere};

/// Isotropic material of an element.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Material {
    /// Young's modulus, Pa.
    pub young: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Density at rest, kg/m^3.
    pub density: f64,
}

impl Material {
    /// Whether a body can be of it: of the element or cell of this name and number.
    ///
    /// # Errors
    /// Of this kind, naming the value.
    pub fn check(&self, (of, number): (&str, usize), kind: fn(String) -> Error) -> Result<()> {
        for (name, value, unit) in
            [("Young's modulus", self.young, "Pa"), ("density", self.density, "kg/m^3")]
        {
            refuse(!(value.is_finite() && value > 0.0), kind, || {
                format!("{name} of {of} {number} is {value} {unit}: expected a positive finite number")
            })?;
        }
        let nu = self.poisson;
        refuse(!(nu > -1.0 && nu < 0.5), kind, || {
            format!(
                "Poisson's ratio of {of} {number} is {nu}: expected a value above -1 and below 0.5; for a material that keeps \
                 its volume set 0.4999"
            )
        })?;
        // The bulk modulus divides by 1 - 2 nu.
        refuse(nu > 0.5 - 1e-7, kind, || {
            format!(
                "Poisson's ratio of {of} {number} is within 1e-7 of 0.5: the stiffness matrix would be singular to rounding; set \
                 0.4999"
            )
        })
    }
}

/// A body at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Points `[N]`, m.
    pub positions: Vec<[f64; 3]>,
    /// What they are `[N]`: [`NodeType::Body`], free to move, or [`NodeType::Handle`], held.
    pub types: Vec<NodeType>,
    /// Elements over them.
    pub elements: Elements,
    /// Material of each element.
    pub material: Vec<Material>,
    /// Edges of the mesh, each once, smaller point first, sorted.
    pub edges: Vec<[i32; 2]>,
}

/// The closed surface of a rigid obstacle.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstacle {
    /// Points `[Q]` where its displacement is 0, m.
    pub positions: Vec<[f64; 3]>,
    /// Triangles, normals outward.
    pub triangles: Vec<[i32; 3]>,
}

/// This rank's share of a body whose points are the cells of a [`Mesh`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BodyShare {
    /// What this rank's points are: [`NodeType::Body`] or [`NodeType::Handle`].
    pub types: Vec<NodeType>,
    /// Kinds of this rank's elements: each element of the body belongs to one rank.
    pub kind: Vec<ElementKind>,
    /// Points of the elements, one after the other, by their numbers among all ranks ([`Mesh::cell_global`]).
    pub points: Vec<i64>,
    /// Material of each element.
    pub material: Vec<Material>,
}

impl Body {
    /// Checks types, materials, volumes at rest, that the edges are those of the elements, that it is in one
    /// part, and that it is held.
    ///
    /// # Errors
    /// [`Error::Mesh`] naming the element or the point.
    pub fn check(&self) -> Result<()> {
        let held = |t: &NodeType| matches!(t, NodeType::Body | NodeType::Handle);
        refuse_any(self.types.iter().position(|t| !held(t)), Error::Mesh, |p| {
            format!("point {p} of the body is {}: expected body or handle", self.types[p].name())
        })?;
        let mut materials = self.material.iter().enumerate();
        materials.try_for_each(|(e, m)| m.check(("element", e), Error::Mesh))?;
        for e in 0..self.elements.len() {
            let volume = self.elements.kind[e].measure(&self.elements.corners(e, &self.positions));
            if !(volume.is_finite() && volume > 0.0) {
                return Err(Error::Mesh(format!("element {e} has the volume {volume} m^3 at rest")));
            }
        }
        if self.edges != self.elements.edges() {
            return Err(Error::Mesh("the edges of the body are not the sorted edges of its elements".into()));
        }
        self.check_held()
    }

    /// The body needs to hang together, and handle points that do not all lie on a line: it could turn around that line, or move as it
    /// likes.
    fn check_held(&self) -> Result<()> {
        let part = self.elements.parts(self.positions.len());
        let first = self.elements.points.first().map_or(0, |&p| part[p as usize]);
        refuse_any(self.elements.points.iter().find(|&&p| part[p as usize] != first), Error::Mesh, |p| {
            format!(
                "point {p} of the body shares no element with what hangs together with point {}: expected a body in one part, as a \
                 network sees contact with an obstacle alone; make a body of each part, or join their points",
                self.elements.points[0]
            )
        })?;
        let places = self.positions.iter().zip(&self.types);
        let held: Vec<Vector> = places.filter(|(_, t)| **t == NodeType::Handle).map(|(x, _)| *x).collect();
        let why = match held.len() {
            0 => "no handle: nothing holds it",
            1 => "one handle point: it turns around that",
            _ if on_a_line(&held) => "handle points on one line: it turns around that",
            _ => return Ok(()),
        };
        Err(Error::Mesh(format!("the body has {why}; mark its held points (type 7)")))
    }

    /// The body, and the obstacle that may touch it, as a mesh on one rank.
    pub fn mesh(&self, obstacle: Option<&Obstacle>) -> Mesh {
        self.share(obstacle, &vec![0; self.positions.len()], 0)
    }

    /// The part of rank `rank`, which has the points p with `ranks[p] == rank` and the elements whose first point is
    /// one of them. The obstacle is whole on all ranks.
    pub fn share(&self, obstacle: Option<&Obstacle>, ranks: &[i32], rank: i32) -> Mesh {
        let own: Vec<usize> = (0..self.positions.len()).filter(|&p| ranks[p] == rank).collect();
        let elements: Vec<usize> = (0..self.elements.len())
            .filter(|&e| ranks[self.elements.points_of(e)[0] as usize] == rank)
            .collect();
        let points = elements.iter().flat_map(|&e| self.elements.points_of(e));
        Mesh {
            directions: vec![0, 1, 2],
            cell_global: own.iter().map(|&p| p as i64).collect(),
            cell_centres: own.iter().map(|&p| self.positions[p]).collect(),
            body: Some(BodyShare {
                types: own.iter().map(|&p| self.types[p]).collect(),
                points: points.map(|&p| i64::from(p)).collect(),
                kind: elements.iter().map(|&e| self.elements.kind[e]).collect(),
                material: elements.iter().map(|&e| self.material[e]).collect(),
            }),
            obstacle: obstacle.cloned(),
            ..Mesh::default()
        }
    }
}

/// Relative length below which a distance is rounding.
const ROUNDING: f64 = 1e-6;

/// A change of the distance between two of an obstacle's points, relative to its size, that recorded single precision
/// does not explain.
const GROWTH: f64 = 1e-4;

/// Whether points all lie on a line, or in one place.
fn on_a_line(points: &[Vector]) -> bool {
    let Some([a, b, c]) = triangle(points) else {
        return true;
    };
    let (along, beside) = (sub(points[b], points[a]), sub(points[c], points[a]));
    norm(cross(along, beside)) <= ROUNDING * norm(along).powi(2)
}

/// Three points far apart: the first one, the farthest from it, and the farthest from the line through both.
fn triangle(points: &[Vector]) -> Option<[usize; 3]> {
    let farthest = |far: &dyn Fn(Vector) -> f64| {
        (0..points.len()).max_by(|&i, &j| far(points[i]).total_cmp(&far(points[j])))
    };
    let a = *points.first()?;
    let b = farthest(&|x| norm(sub(x, a)))?;
    let along = sub(points[b], a);
    let c = farthest(&|x| norm(cross(along, sub(x, a))))?;
    Some([0, b, c])
}

impl Obstacle {
    /// Checks that it is a closed surface, and that neither it nor the body is inside of the other.
    ///
    /// # Errors
    /// [`Error::Mesh`] that says which.
    pub fn check(&self, body: &Body) -> Result<()> {
        let inside = |surface: &Surface, points: &[Vector]| {
            !points.is_empty() && points.iter().all(|&x| surface.distance(x) < 0.0)
        };
        let own = Surface::new(&self.positions, &self.triangles)?;
        if inside(&own, &body.positions) {
            return Err(Error::Mesh(
                "the body lies inside of the obstacle: expected an obstacle that touches it from outside"
                    .into(),
            ));
        }
        let skin = body.elements.skin();
        let fan = |face: &Vec<i32>| -> Vec<[i32; 3]> {
            face.windows(2).skip(1).map(|w| [face[0], w[0], w[1]]).collect()
        };
        let triangles: Vec<[i32; 3]> = skin.iter().flat_map(fan).collect();
        if !triangles.is_empty() && inside(&Surface::open(&body.positions, &triangles), &self.positions) {
            return Err(Error::Mesh(
                "the obstacle lies inside of the body: expected an obstacle that touches it from outside"
                    .into(),
            ));
        }
        Ok(())
    }

    /// Checks that a displacement of its points `[Q]`, m, keeps their distances: the obstacle is rigid.
    ///
    /// # Errors
    /// [`Error::Mesh`] naming two points.
    pub fn check_motion<T: Copy + Into<f64>>(&self, displacement: &[[T; 3]]) -> Result<()> {
        let now = moved(&self.positions, displacement);
        let Some(corners) = triangle(&self.positions) else {
            return Ok(());
        };
        let between = |points: &[Vector], a: usize, b: usize| norm(sub(points[a], points[b]));
        // Far from where it was, single precision holds less of its place.
        let far = now.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
        let limit = GROWTH * between(&self.positions, corners[0], corners[1]) + ROUNDING * far;
        for p in 0..now.len() {
            for a in corners {
                let (rest, is) = (between(&self.positions, p, a), between(&now, p, a));
                let off = (rest - is).abs();
                if off.is_nan() || off > limit {
                    return Err(Error::Mesh(format!(
                        "the distance between points {p} and {a} of the obstacle goes from {rest:e} to {is:e} m: expected a \
                         rigid body, which moves and turns but does not deform"
                    )));
                }
            }
        }
        Ok(())
    }
}

impl Mesh {
    /// The whole body that the ranks share, on each of them, and the rank of each of its points: bodies at points are
    /// small beside what ranks are for. Elements are in the order of their points, whoever had them. Collective; all
    /// ranks fail together.
    ///
    /// # Errors
    /// [`Error::Mesh`] for points that are no permutation of 0 to N - 1, an element with a point that no rank has, and
    /// as [`Body::check`].
    pub fn whole_body(&self, comm: &Comm) -> Result<(Body, Vec<i32>)> {
        let n = self.check_points(comm)?;
        let share =
            comm.agree(self.body.as_ref().ok_or_else(|| {
                Error::Mesh("the mesh has no elements: a body needs them on all ranks".into())
            }))?;
        comm.agree(share.check(self.cell_global.len(), n))?;
        let number = everywhere(comm, &self.cell_global);
        let place = everywhere(comm, self.cell_centres.as_flattened());
        let kind: Vec<i32> = share.types.iter().map(|&t| t as i32).collect();
        let kind = everywhere(comm, &kind);
        let rank = everywhere(comm, &vec![comm.rank(); self.cell_global.len()]);
        let mut positions = vec![[0.0; 3]; n];
        let mut types = vec![NodeType::Body; n];
        let mut ranks = vec![0; n];
        for (i, &p) in number.iter().enumerate() {
            positions[p as usize].copy_from_slice(&place[3 * i..3 * i + 3]);
            types[p as usize] = NodeType::from_code(kind[i])?;
            ranks[p as usize] = rank[i];
        }
        let kinds: Vec<i32> = share.kind.iter().map(|&k| k as i32).collect();
        let kinds = everywhere(comm, &kinds);
        let corners = everywhere(comm, &share.points);
        let values: Vec<f64> = share.material.iter().flat_map(|m| [m.young, m.poisson, m.density]).collect();
        let values = everywhere(comm, &values);
        let mut rest = &corners[..];
        let mut all = Vec::with_capacity(kinds.len());
        for (&kind, value) in kinds.iter().zip(values.chunks_exact(3)) {
            let kind = ElementKind::from_code(kind)?;
            let (points, tail) = rest.split_at(kind.n_points());
            rest = tail;
            all.push((points, kind, value));
        }
        all.sort_by_key(|e| e.0);
        let mut elements = Elements {
            kind: all.iter().map(|e| e.1).collect(),
            start: vec![0],
            points: Vec::with_capacity(corners.len()),
        };
        for (points, ..) in &all {
            elements.points.extend(points.iter().map(|&p| p as i32));
            elements.start.push(elements.points.len());
        }
        let material = all.iter().map(|(_, _, v)| Material { young: v[0], poisson: v[1], density: v[2] });
        let body = Body { positions, types, material: material.collect(), edges: elements.edges(), elements };
        comm.agree(body.check())?;
        Ok((body, ranks))
    }
}

impl BodyShare {
    fn check(&self, own: usize, all: usize) -> Result<()> {
        let expect = |what: &str, found: usize, expected: usize| {
            refuse(found != expected, Error::Mesh, || format!("{what}: expected {expected}, found {found}"))
        };
        expect("types of the body's points", self.types.len(), own)?;
        expect("materials of the elements", self.material.len(), self.kind.len())?;
        let corners = self.kind.iter().map(|k| k.n_points()).sum();
        expect("points of the elements", self.points.len(), corners)?;
        refuse_any(self.points.iter().find(|p| !(0..all as i64).contains(p)), Error::Mesh, |p| {
            format!("an element has the point {p}: expected 0 to {} over all ranks", all as i64 - 1)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;

    #[test]
    fn a_body_comes_back_whole() {
        let body = sample::bar(3);
        let obstacle = Obstacle { positions: vec![[0.0; 3]; 3], triangles: vec![[0, 1, 2]] };
        let mesh = body.mesh(Some(&obstacle));
        assert_eq!(mesh.obstacle.as_ref(), Some(&obstacle));
        let (whole, ranks) = mesh.whole_body(&Comm::serial()).unwrap();
        assert_eq!((whole, ranks), (body, vec![0; 16]));
    }

    #[test]
    fn each_element_has_one_rank() {
        let body = sample::bar(3);
        let ranks: Vec<i32> = (0..16).map(|p| p / 6).collect();
        let parts: Vec<BodyShare> = (0..3).map(|r| body.share(None, &ranks, r).body.unwrap()).collect();
        assert_eq!(parts.iter().map(|p| p.types.len()).collect::<Vec<_>>(), [6, 6, 4]);
        assert_eq!(parts.iter().map(|p| p.kind.len()).sum::<usize>(), 3);
    }

    #[test]
    fn what_is_no_body_is_named() {
        let broken = |change: &dyn Fn(&mut Mesh)| {
            let mut mesh = sample::bar(2).mesh(None);
            change(&mut mesh);
            mesh.whole_body(&Comm::serial()).unwrap_err().to_string()
        };
        let share = |change: &dyn Fn(&mut BodyShare)| broken(&|m| change(m.body.as_mut().unwrap()));
        assert!(broken(&|m| m.body = None).contains("no elements"));
        assert!(broken(&|m| m.cell_global[0] = 3).contains("more than once"));
        assert!(broken(&|m| m.cell_centres[0][0] = f64::NAN).contains("finite"));
        assert!(share(&|s| s.types[1] = NodeType::Wall).contains("is wall: expected body or handle"));
        assert!(share(&|s| s.points[0] = 12).contains("the point 12: expected 0 to 11"));
        assert!(share(&|s| s.material[1].young = 0.0).contains("Young's modulus of element 1 is 0 Pa"));
        assert!(share(&|s| s.material[0].poisson = -1.0).contains("Poisson's ratio of element 0 is -1"));
        assert!(share(&|s| s.points[..8].rotate_left(4)).contains("m^3 at rest"));
        assert!(share(&|s| s.types.truncate(3)).contains("expected 12, found 3"));
    }

    #[test]
    fn a_body_is_in_one_part_and_held_by_more_than_a_line() {
        let held = |points: &[usize]| {
            let mut body = sample::bar(2);
            body.types.fill(NodeType::Body);
            points.iter().for_each(|&p| body.types[p] = NodeType::Handle);
            body.check().map_err(|e| e.to_string())
        };
        assert!(held(&[]).unwrap_err().contains("no handle"));
        assert!(held(&[5]).unwrap_err().contains("one handle point"));
        assert!(held(&[0, 4, 8]).unwrap_err().contains("on one line"));
        held(&[0, 4, 1]).unwrap();
        // Two cubes that share no point.
        let mut body = sample::bar(3);
        body.elements = Elements::of_kind(
            ElementKind::Hexahedron,
            [body.elements.points_of(0), body.elements.points_of(2)].concat(),
        );
        (body.edges, body.material) = (body.elements.edges(), vec![body.material[0]; 2]);
        let error = body.check().unwrap_err().to_string();
        assert!(error.contains("expected a body in one part"), "{error}");
    }

    #[test]
    fn an_obstacle_is_rigid_and_outside() {
        let body = sample::bar(3);
        let obstacle = |size: f64, at: Vector| {
            let (points, triangles) = sample::brick([size; 3]);
            Obstacle {
                positions: points.iter().map(|p| std::array::from_fn(|i| p[i] + at[i])).collect(),
                triangles,
            }
        };
        let place = |size, at| obstacle(size, at).check(&body).map_err(|e| e.to_string());
        place(1.0, [0.0, 1.5, 0.0]).unwrap();
        place(1.0, [2.5, 0.5, 0.5]).unwrap();
        assert!(place(20.0, [-9.0; 3]).unwrap_err().contains("body lies inside"));
        assert!(place(0.2, [1.7, 0.4, 0.4]).unwrap_err().contains("obstacle lies inside"));

        let given = obstacle(1.0, [3.0; 3]);
        let motion = |to: &dyn Fn(Vector) -> Vector| -> Vec<Vector> {
            given.positions.iter().map(|&x| sub(to(x), x)).collect()
        };
        let (s, c) = 0.7f64.sin_cos();
        given
            .check_motion(&motion(&|x| [c * x[0] - s * x[1] + 5.0, s * x[0] + c * x[1], x[2] - 2.0]))
            .unwrap();
        for grown in [1.01, 0.5, 0.0, f64::NAN] {
            let error = given.check_motion(&motion(&|x| x.map(|v| grown * v))).unwrap_err();
            assert!(error.to_string().contains("rigid body"), "{error}");
        }
    }
}
