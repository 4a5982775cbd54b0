//! What a network of bodies is told at its nodes: how the obstacle moves until the next state, and how near it comes to the skin.

use super::graph::Body;
use m4gn_mesh::surface::Surface;
use m4gn_mesh::vector::Vector;
use m4gn_model::N_CONTACT_INPUTS;

impl Body {
    /// Node inputs of the owned nodes, m, for a displacement of all local nodes `[n_local x 3]`, and that of the obstacle's points after the
    /// step, in rows of the same order: the displacement, where the network reads it at the nodes, and eight numbers.
    ///
    /// Of a point of the obstacle: its motion, then zeros. Of a point of the skin that the obstacle is near to, at most the radius of
    /// world edges: 0 0 0, how much nearer than the radius the obstacle is now, how much after its motion if the body stays where it
    /// is, and the latter along the obstacle's normal, which is where the point would be pushed. Zeros of all other points.
    ///
    /// The obstacle's points alone (world edges) say poorly how deep it sinks in between them.
    pub(super) fn inputs_at(&self, displacement: &[f32], next: &[f32], inputs: &mut Vec<f32>) {
        let fields = self.components.inputs.len();
        let width = fields + N_CONTACT_INPUTS;
        inputs.clear();
        inputs.resize(self.n_owned * width, 0.0);
        for (row, u) in inputs.chunks_exact_mut(width).zip(displacement.as_chunks::<3>().0) {
            row[..fields].copy_from_slice(&u[..fields]);
        }
        let of_obstacle = |rows: &[f32]| -> Vec<[f32; 3]> {
            let rows = rows.as_chunks::<3>().0;
            self.obstacle_nodes.iter().map(|&node| rows[node as usize]).collect()
        };
        let (now, after) = (&of_obstacle(displacement)[..], &of_obstacle(next)[..]);
        // Only one rank has rows of the obstacle.
        let rows = inputs.chunks_exact_mut(width).skip(self.n_points());
        for (row, (now, after)) in rows.zip(now.iter().zip(after)) {
            (0..3).for_each(|i| row[fields + i] = after[i] - now[i]);
        }
        let (Some(now), Some(after)) = (self.surface(now), self.surface(after)) else {
            return;
        };
        for &p in &self.skin {
            let u = &displacement[3 * p as usize..][..3];
            let x: Vector = std::array::from_fn(|i| self.rest[p as usize][i] + f64::from(u[i]));
            let row = &mut inputs[p as usize * width + fields..][..N_CONTACT_INPUTS];
            row[3] = self.nearness(&now, x).map_or(0.0, |(near, _)| near as f32);
            if let Some((near, normal)) = self.nearness(&after, x) {
                row[4] = near as f32;
                (0..3).for_each(|i| row[5 + i] = (near * normal[i]) as f32);
            }
        }
    }

    /// How much nearer than the radius a place is to the obstacle, m, and the obstacle's normal there.
    fn nearness(&self, obstacle: &Surface, x: Vector) -> Option<(f64, Vector)> {
        if obstacle.beyond_box(x) >= self.radius {
            return None;
        }
        let foot = obstacle.foot(x)?;
        let near = self.radius - foot.distance;
        (near > 0.0).then_some((near, foot.normal))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Domain;
    use crate::body::part::BodyPart;
    use m4gn_parallel::Comm;
    use m4gn_samples::bodies as sample;

    /// A cube of one brick; the lowest corner of an octahedron is 0.5 above the cube's corner (1, 1, 1), point 7.
    fn cube() -> Body {
        let body = sample::block([1, 1, 1], [1.0; 3]);
        let obstacle = sample::octahedron([1.0, 1.0, 2.0], 0.5);
        let part = BodyPart::whole(&body, Some(&obstacle)).unwrap();
        Body::new(&part, &sample::spec(0.6), &Comm::serial()).unwrap().0
    }

    /// The points' displacement and the obstacle's.
    fn state(displacement: &[f32], obstacle: [f32; 3]) -> Vec<f32> {
        displacement.iter().copied().chain(obstacle.repeat(6)).collect()
    }

    fn inputs(body: &Body, displacement: &[f32], motion: [[f32; 3]; 2]) -> Vec<[f32; N_CONTACT_INPUTS]> {
        let [now, next] = motion.map(|u| state(displacement, u));
        let mut rows = Vec::new();
        body.inputs(&now, &next, &mut rows);
        rows.as_chunks().0.to_vec()
    }

    fn close(a: &[f32], b: &[f32]) {
        let same = a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(same && a.len() == b.len(), "{a:?} {b:?}");
    }

    #[test]
    fn a_point_is_told_how_near_the_obstacle_comes() {
        let body = cube();
        let rows = inputs(&body, &[0.0; 24], [[0.0; 3], [0.0, 0.0, -0.2]]);
        close(&rows[7], &[0.0, 0.0, 0.0, 0.1, 0.3, 0.0, 0.0, -0.3]);
        rows[..7].iter().for_each(|row| close(row, &[0.0; N_CONTACT_INPUTS]));
        rows[8..].iter().for_each(|row| close(row, &[0.0, 0.0, -0.2, 0.0, 0.0, 0.0, 0.0, 0.0]));
    }

    #[test]
    fn a_point_inside_is_nearer_than_the_radius() {
        // The corner is 0.3 below the octahedron's centre, on its axis.
        let rows = inputs(&cube(), &[0.0; 24], [[0.0, 0.0, -0.7], [0.0, 0.0, 5.0]]);
        let depth = 0.2 / 3f32.sqrt();
        close(&rows[7], &[0.0, 0.0, 0.0, 0.6 + depth, 0.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn a_reflection_is_told_the_same() {
        let body = cube();
        let displacement: Vec<f32> = (0..24).map(|i| 0.03 * (1.7 * i as f32).sin()).collect();
        let motion = [[0.05, 0.02, -0.3], [0.1, -0.05, -0.45]];
        let flip = |u: [f32; 3]| [u[0], -u[1], u[2]];
        let flipped: Vec<f32> = displacement.as_chunks::<3>().0.iter().flat_map(|u| flip(*u)).collect();
        let rows = inputs(&body, &displacement, motion);
        let mirror = inputs(&body.mirrored(), &flipped, motion.map(flip));
        assert!(rows[7][3] > 0.1 && rows[7][6].abs() > 1e-3, "{:?}", rows[7]);
        for (a, b) in rows.iter().zip(&mirror) {
            let mut a = *a;
            a[1] = -a[1];
            a[6] = -a[6];
            close(&a, b);
        }
    }
}
