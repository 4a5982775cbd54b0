//! g-U-Net (Gao and Ji 2019) of message passing: down to graphs of the nodes with the largest learned scores, and up again.
//!
//! Its coarser graphs depend on the state: they are made in each step, on one rank.

use super::bi_stride::Floor;
use super::{Processor, flops_of_features};
use crate::grid::Grid;
use crate::kernels::{Number, padded};
use crate::order::Order;
use crate::passing::Layer;
use crate::pool::Pool;
use crate::profile::Phase;
use crate::scale::Scale;
use crate::weights::Weights;
use m4gn_base::Result;
use m4gn_model::Model;
use m4gn_parallel::{Comm, Element};
use m4gn_structure::{Pooled, Structure};

/// The layers of a model.
pub struct GraphUNet<T> {
    /// Down, on the coarsest graph, up.
    layers: Vec<Layer<T>>,
    /// A unit vector a level, whose product with a node's latents is its score.
    scores: Vec<Vec<f32>>,
    /// Of the edges' features.
    edge_scale: Scale,
    finest: Floor<T>,
    graph: PoolGraph,
}

/// Who hears whom, the normalised features of the edges, and by what the nodes are chosen beside their scores.
#[derive(Debug, Default)]
pub struct PoolGraph {
    pub nodes: Vec<[u32; 2]>,
    pub senders: Vec<i32>,
    pub receivers: Vec<i32>,
    pub features: Vec<f32>,
}

impl PoolGraph {
    /// The graph of the nodes with the largest scores, and the same for coarser ones.
    pub fn pooled(&self, score: &[f32]) -> (Pooled, PoolGraph) {
        let pooled = Pooled::new((&self.senders, &self.receivers), &self.nodes, score);
        let (k, n_edges) = (self.features.len() / self.senders.len().max(1), pooled.graph.senders.len());
        let mut features = vec![0.0; n_edges * k];
        pooled.edges.add(0..n_edges, k.max(1), &self.features, &mut features);
        let nodes = pooled.kept.iter().map(|&i| self.nodes[i as usize]).collect();
        let (senders, receivers) = (pooled.graph.senders.clone(), pooled.graph.receivers.clone());
        (pooled, PoolGraph { nodes, senders, receivers, features })
    }
}

/// For each place of a coarser graph's order the node's place in the finer graph, and its gate.
pub fn above(pooled: &Pooled, own: &Order, finer: &Order, score: &[f32]) -> Vec<(usize, f32)> {
    let place = finer.places();
    let numbers = own.node.iter().map(|&i| pooled.kept[i as usize] as usize);
    numbers.map(|i| (place[i] as usize, score[i].tanh())).collect()
}

/// p / |p|, padded.
pub fn unit(p: &[f32]) -> Vec<f32> {
    let length = p.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
    let mut unit: Vec<f32> = p.iter().map(|x| (f64::from(*x) / length) as f32).collect();
    unit.resize(padded(p.len()), 0.0);
    unit
}

/// Scores of the nodes by number, whose latents stand at their places.
pub fn scores(latents: &[f32], unit: &[f32], node: &[u32]) -> Vec<f32> {
    let mut scores = vec![0.0; node.len()];
    for (h, &i) in latents.chunks_exact(unit.len()).zip(node) {
        scores[i as usize] = h.iter().zip(unit).map(|(h, p)| h * p).sum();
    }
    scores
}

impl<T: Number + Element> GraphUNet<T> {
    /// The layers of a model.
    pub fn new(weights: &mut Weights, model: &Model, grid: &Grid<T>, levels: usize) -> Result<Self> {
        let layers = 0..model.spec.architecture.layers();
        let score = |l| Ok(unit(&model.tensor(&format!("processor.{l}.score.weight"))?.data));
        Ok(GraphUNet {
            layers: layers
                .map(|l| Layer::new(weights, &model.spec.architecture, l))
                .collect::<Result<_>>()?,
            scores: (0..levels).map(score).collect::<Result<_>>()?,
            edge_scale: Scale::of_model(model, "edge")?,
            finest: Floor::of_nodes(grid),
            graph: PoolGraph::default(),
        })
    }

    /// All that is below a graph, and the layers on it: `layers` are those of it and of the coarser ones.
    fn cycle(
        comm: &Comm,
        grid: &mut Grid<T>,
        (floor, links): (&mut Floor<T>, &PoolGraph),
        layers: &[Layer<T>],
        scores: &[Vec<f32>],
    ) {
        let [first, others @ ..] = layers else { return };
        floor.pass(comm, grid, first);
        let ([inner @ .., last], [unit, scores @ ..]) = (others, scores) else {
            return;
        };
        let columns = grid.columns;
        let score = self::scores(&grid.nodes, unit, &grid.order.node);
        let (pooled, below) = links.pooled(&score);
        let pool = Pool::new(1, grid.isa);
        let mut next: Grid<T> = Grid::new(&pooled.graph, columns, pool, Vec::new(), grid.timed);
        let above = above(&pooled, &next.order, &grid.order, &score);
        let k = links.features.len() / links.senders.len().max(1);
        let mut ground = Floor::of_nodes(&next);
        ground.take(&next.order.edge, &below.features, &Scale::unit(k), columns);
        for (to, &(at, gate)) in next.nodes.chunks_exact_mut(columns).zip(&above) {
            to.iter_mut().zip(&grid.nodes[at * columns..]).for_each(|(to, h)| *to = gate * h);
        }
        grid.hand_over(&mut next);
        Self::cycle(comm, &mut next, (&mut ground, &below), inner, scores);
        grid.hand_over(&mut next);
        for (&(at, _), h) in above.iter().zip(next.nodes.chunks_exact(columns)) {
            grid.nodes[at * columns..(at + 1) * columns].iter_mut().zip(h).for_each(|(to, h)| *to += h);
        }
        floor.pass(comm, grid, last);
    }
}

impl<T: Number + Element> Processor<T> for GraphUNet<T> {
    fn place(&mut self, grid: &mut Grid<T>, structure: &Structure) {
        let graph = &structure.graph;
        let k = self.edge_scale.channels();
        let order: Vec<u32> = (0..graph.senders.len() as u32).collect();
        let mut normed = vec![0f32; order.len() * k];
        self.edge_scale.normalise_rows(&graph.edge_features, &order, k, &mut normed);
        self.graph = PoolGraph {
            nodes: structure.choice(),
            senders: graph.senders.clone(),
            receivers: graph.receivers.clone(),
            features: normed,
        };
        self.finest.take(&grid.order.edge, &graph.edge_features, &self.edge_scale, grid.columns);
    }

    fn run(&mut self, comm: &Comm, grid: &mut Grid<T>) {
        Self::cycle(comm, grid, (&mut self.finest, &self.graph), &self.layers, &self.scores);
    }

    /// Of the finest graph, whose nodes are halved from level to level; edges are more or fewer with the choice.
    fn flops(&self, grid: &Grid<T>, model: &Model) -> Vec<(Phase, f64)> {
        let layers = 4.0 - 3.0 * 0.5f64.powi(self.scores.len() as i32);
        let both = (layers * grid.n_owned as f64, layers * grid.order.senders.len() as f64);
        flops_of_features(model, self.edge_scale.channels(), both)
    }
}
