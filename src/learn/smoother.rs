//! The smooth part of an error: averages over neighbouring nodes.
//!
//! The error of a stride is rough: most of its square is at the scale of a node, where the next strides and the solver take it
//! away. What stays and grows, phase and amplitude of waves and wakes, is a small smooth part, which a mean square over nodes
//! hardly sees. With S a step of averaging, `S = I - (D - A) / (d + 1)`, where A is the matrix of neighbours, D the diagonal of their
//! numbers and d the largest of these, the loss of an error e is `|e|^2 + weight |S^hops e|^2`. S is symmetric, so that the derivative is
//! twice `e + weight S^hops S^hops e`.

use m4gn_structure::graph::Graph;

/// Averages over neighbouring nodes of one graph, boundary nodes left out.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Smoother {
    /// Neighbours of node i: `row[i]..row[i + 1]`.
    row: Vec<u32>,
    neighbours: Vec<u32>,
    /// 1 / (d + 1)
    share: f32,
    hops: usize,
    /// What the square of the smooth part counts.
    weight: f32,
}

impl Smoother {
    /// For a graph, from what a training configuration says.
    pub fn new(graph: &Graph, hops: usize, weight: f64) -> Self {
        let (mut row, mut neighbours) = (vec![0], Vec::new());
        let mut most = 0;
        for node in 0..graph.n_cells {
            let edges = graph.row[node] as usize..graph.row[node + 1] as usize;
            let senders = graph.senders[edges].iter().map(|s| *s as usize);
            let before = neighbours.len();
            neighbours.extend(senders.filter(|s| *s < graph.n_cells).map(|s| s as u32));
            most = most.max(neighbours.len() - before);
            row.push(neighbours.len() as u32);
        }
        Smoother { row, neighbours, share: 1.0 / (most + 1) as f32, hops, weight: weight as f32 }
    }

    /// `S^hops x` in place, x `[nodes x n]`.
    fn apply(&self, x: &mut Vec<f32>, n: usize) {
        let mut next = x.clone();
        for _ in 0..self.hops {
            for (node, to) in next.chunks_exact_mut(n).enumerate() {
                let own = &x[node * n..(node + 1) * n];
                to.copy_from_slice(own);
                for &other in &self.neighbours[self.row[node] as usize..self.row[node + 1] as usize] {
                    let other = &x[other as usize * n..][..n];
                    let pairs = to.iter_mut().zip(other).zip(own);
                    pairs.for_each(|((to, other), own)| *to += self.share * (other - own));
                }
            }
            std::mem::swap(x, &mut next);
        }
    }

    /// From `factor_i e_i` of each component to `factor_i (e_i + weight S^hops S^hops e_i)`, `[nodes x n]`.
    pub fn add_smooth(&self, d: &mut [f32], n: usize) {
        let mut smooth = d.to_vec();
        for _ in 0..2 {
            self.apply(&mut smooth, n);
        }
        let pairs = d.iter_mut().zip(&smooth);
        pairs.for_each(|(d, smooth)| *d += self.weight * smooth);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three nodes in a row: S = [2/3 1/3 0; 1/3 1/3 1/3; 0 1/3 2/3].
    fn three(hops: usize) -> Smoother {
        Smoother { row: vec![0, 1, 3, 4], neighbours: vec![1, 0, 2, 1], share: 1.0 / 3.0, hops, weight: 9.0 }
    }

    #[test]
    fn constants_stay_and_roughness_goes() {
        let mut x = vec![1.0, 5.0, 1.0, -4.0, 1.0, 5.0];
        three(1).apply(&mut x, 2);
        let expected = [1.0, 2.0, 1.0, 2.0, 1.0, 2.0];
        assert!(x.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{x:?}");
    }

    #[test]
    fn the_derivative_is_that_of_the_loss() {
        // S^2 of a unit at the end: (5 3 1)/9
        let mut d = vec![1.0, 0.0, 0.0];
        three(1).add_smooth(&mut d, 1);
        let expected = [1.0 + 5.0, 3.0, 1.0];
        assert!(d.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{d:?}");
        // Half the loss by finite differences, with other hops.
        let s = three(2);
        let loss = |e: [f32; 3]| {
            let mut smooth = e.to_vec();
            s.apply(&mut smooth, 1);
            let square = |x: &[f32]| x.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>();
            0.5 * (square(&e) + 9.0 * square(&smooth))
        };
        let e = [0.5, -1.0, 0.25];
        let mut d = e.to_vec();
        s.add_smooth(&mut d, 1);
        for (i, d) in d.iter().enumerate() {
            let (mut a, mut b) = (e, e);
            (a[i], b[i]) = (e[i] - 0.01, e[i] + 0.01);
            let slope = (loss(b) - loss(a)) / f64::from(b[i] - a[i]);
            assert!((slope - f64::from(*d)).abs() < 1e-3, "{i}: {slope} {d}");
        }
    }

    #[test]
    fn a_graph_gives_its_cells_neighbours() {
        let mesh = m4gn_samples::mesh::triangles(2, 1, 1.0, 1.0);
        let graph = Graph::new(&mesh, &m4gn_mesh::parallel::Comm::serial()).unwrap();
        let s = Smoother::new(&graph, 3, 2.0);
        assert_eq!((s.row.len(), s.share), (5, 1.0 / 3.0), "{s:?}");
        assert_eq!(s.neighbours.len(), 6, "three faces between four triangles");
    }
}
