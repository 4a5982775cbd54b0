//! The order of nodes within the engine: neighbours close to each other, so that what they gather is in cache, and
//! nodes that wait for other ranks last.

use m4gn_structure::graph::Graph;

/// A numbering of the owned nodes of a graph, and its edges in that numbering.
#[derive(Clone, Debug)]
pub struct Order {
    /// Nodes in the order of the search, before those that wait for ghosts went last.
    pub search: Vec<u32>,
    /// Node of the graph at each place.
    pub node: Vec<u32>,
    /// Places before this one receive from owned nodes alone.
    pub n_interior: usize,
    /// Edges of place i: `row[i]..row[i + 1]`.
    pub row: Vec<u32>,
    /// Place of each edge's sender; ghosts keep their numbers.
    pub senders: Vec<i32>,
    /// Place of each edge's receiver, ascending.
    pub receivers: Vec<i32>,
    /// Edge of the graph for each edge.
    pub edge: Vec<u32>,
}

impl Order {
    /// Reverse Cuthill-McKee of the owned nodes, those without ghosts among their senders first.
    pub fn new(graph: &Graph) -> Self {
        let mut search = cuthill_mckee(graph);
        search.reverse();
        Self::of(graph, &search)
    }

    /// The nodes as in `search`, those without ghosts among their senders first.
    pub fn of(graph: &Graph, search: &[u32]) -> Self {
        let n = graph.n_owned;
        let edges_of = |i: u32| graph.row[i as usize] as usize..graph.row[i as usize + 1] as usize;
        let interior = |i: &u32| graph.senders[edges_of(*i)].iter().all(|&s| (s as usize) < n);
        let (mut order, rest): (Vec<u32>, Vec<u32>) = search.iter().copied().partition(interior);
        let n_interior = order.len();
        order.extend(rest);

        let mut place: Vec<i32> = (0..graph.n_local as i32).collect();
        for (p, &i) in order.iter().enumerate() {
            place[i as usize] = p as i32;
        }
        let n_edges = graph.senders.len();
        let mut row = Vec::with_capacity(n + 1);
        let mut edge = Vec::with_capacity(n_edges);
        let (mut senders, mut receivers) = (Vec::with_capacity(n_edges), Vec::with_capacity(n_edges));
        row.push(0);
        for (p, &i) in order.iter().enumerate() {
            for e in edges_of(i) {
                edge.push(e as u32);
                senders.push(place[graph.senders[e] as usize]);
                receivers.push(p as i32);
            }
            row.push(edge.len() as u32);
        }
        Order { search: search.to_vec(), node: order, n_interior, row, senders, receivers, edge }
    }

    /// Place of each owned node of the graph.
    pub fn places(&self) -> Vec<u32> {
        let mut place = vec![0; self.node.len()];
        for (p, &i) in self.node.iter().enumerate() {
            place[i as usize] = p as u32;
        }
        place
    }
}

/// Breadth first from a node of least degree, neighbours by degree; component after component (Cuthill and McKee
/// 1969).
fn cuthill_mckee(graph: &Graph) -> Vec<u32> {
    let n = graph.n_owned;
    let degree = |i: u32| graph.row[i as usize + 1] - graph.row[i as usize];
    let mut starts: Vec<u32> = (0..n as u32).collect();
    starts.sort_by_key(|&i| degree(i));
    let mut seen = vec![false; n];
    let mut order: Vec<u32> = Vec::with_capacity(n);
    for start in starts {
        if std::mem::replace(&mut seen[start as usize], true) {
            continue;
        }
        let mut next = order.len();
        order.push(start);
        while next < order.len() {
            let i = order[next] as usize;
            next += 1;
            let first = order.len();
            for &s in &graph.senders[graph.row[i] as usize..graph.row[i + 1] as usize] {
                if (s as usize) < n && !std::mem::replace(&mut seen[s as usize], true) {
                    order.push(s as u32);
                }
            }
            order[first..].sort_by_key(|&s| degree(s));
        }
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_parallel::Comm;
    use m4gn_samples::mesh as sample;

    #[test]
    fn every_node_and_edge_once_and_neighbours_close() {
        let graph = Graph::new(&sample::triangles(40, 30, 1.6, 0.41), &Comm::serial()).unwrap();
        let order = Order::new(&graph);
        assert_eq!(order.n_interior, graph.n_owned);
        let mut nodes = order.node.clone();
        nodes.sort_unstable();
        assert!(nodes.iter().enumerate().all(|(i, &node)| i == node as usize));
        let place = order.places();
        let mut seen = vec![false; order.edge.len()];
        let mut widest = 0;
        for (new, &old) in order.edge.iter().enumerate() {
            assert!(!std::mem::replace(&mut seen[old as usize], true));
            let (s, r) = (graph.senders[old as usize], graph.receivers[old as usize]);
            assert_eq!(order.senders[new], place[s as usize] as i32);
            assert_eq!(order.receivers[new], place[r as usize] as i32);
            widest = widest.max(order.senders[new].abs_diff(order.receivers[new]));
        }
        // The bandwidth is that of a front through the channel's short side: about 2 x 30 cells and some.
        assert!(widest < 200, "bandwidth {widest} of {}", graph.n_owned);
    }

    #[test]
    fn nodes_that_wait_for_ghosts_are_last() {
        // Three nodes in a row, the first of which hears a ghost (node 3).
        let graph = Graph {
            n_cells: 3,
            n_owned: 3,
            n_local: 4,
            node_types: vec![0; 4],
            row: vec![0, 2, 4, 5],
            senders: vec![3, 1, 0, 2, 1],
            receivers: vec![0, 0, 1, 1, 2],
            ..Graph::default()
        };
        let order = Order::new(&graph);
        assert_eq!((order.n_interior, order.node[2]), (2, 0));
        assert!(order.senders.contains(&3));
    }
}
