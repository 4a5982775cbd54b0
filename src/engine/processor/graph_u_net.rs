//! g-U-Net (Gao and Ji 2019) of message passing: down to graphs of the nodes with the largest learned scores, and up again.
//!
//! Its coarser graphs depend on the state: they are made in each step, on one rank.

use super::bi_stride::Floor;
use super::{Processor, flops_of_features};
use crate::grid::Grid;
use crate::kernels::{Number, padded};
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
    graph: Links,
}

/// Who hears whom, the normalised features of the edges, and by what the nodes are chosen beside their scores.
#[derive(Debug, Default)]
struct Links {
    nodes: Vec<[u32; 2]>,
    senders: Vec<i32>,
    receivers: Vec<i32>,
    features: Vec<f32>,
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
            graph: Links::default(),
        })
    }

    /// All that is below a graph, and the layers on it: `layers` are those of it and of the coarser ones.
    fn cycle(
        comm: &Comm,
        grid: &mut Grid<T>,
        (floor, links): (&mut Floor<T>, &Links),
        layers: &[Layer<T>],
        scores: &[Vec<f32>],
    ) {
        let [first, others @ ..] = layers else { return };
        floor.pass(comm, grid, first);
        let ([inner @ .., last], [unit, scores @ ..]) = (others, scores) else {
            return;
        };
        let (columns, place) = (grid.columns, grid.order.places());
        let score = self::scores(&grid.nodes, unit, &grid.order.node);
        let ends = (&links.senders[..], &links.receivers[..]);
        let Pooled { kept, graph, edges } = Pooled::new(ends, &links.nodes, &score);
        let k = links.features.len() / links.senders.len().max(1);
        let n_edges = graph.senders.len();
        let mut below = Links { features: vec![0.0; n_edges * k], ..Links::default() };
        edges.add(0..n_edges, k.max(1), &links.features, &mut below.features);
        let pool = Pool::new(1, grid.isa);
        let mut next: Grid<T> = Grid::new(&graph, columns, pool, Vec::new(), grid.timed);
        (below.senders, below.receivers) = (graph.senders, graph.receivers);
        below.nodes = kept.iter().map(|&i| links.nodes[i as usize]).collect();
        let mut ground = Floor::of_nodes(&next);
        ground.take(&next.order.edge, &below.features, &Scale::unit(k), columns);
        // Where a place of the coarser graph stands in this one.
        let above = |p: usize| place[kept[next.order.node[p] as usize] as usize] as usize * columns;
        let above: Vec<usize> = (0..next.n_owned).map(above).collect();
        for (p, to) in next.nodes.chunks_exact_mut(columns).take(above.len()).enumerate() {
            let gate = score[kept[next.order.node[p] as usize] as usize].tanh();
            to.iter_mut().zip(&grid.nodes[above[p]..]).for_each(|(to, h)| *to = gate * h);
        }
        grid.hand_over(&mut next);
        Self::cycle(comm, &mut next, (&mut ground, &below), inner, scores);
        grid.hand_over(&mut next);
        for (&at, h) in above.iter().zip(next.nodes.chunks_exact(columns)) {
            grid.nodes[at..at + columns].iter_mut().zip(h).for_each(|(to, h)| *to += h);
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
        self.graph = Links {
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
