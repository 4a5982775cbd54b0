use m4gn::{dataset, graph::Graph, mesh::sample, model::*, modes::*, parallel::Comm, segments::*};
use std::time::Instant;
fn main() {
    let comm = Comm::serial();
    let args: Vec<String> = std::env::args().collect();
    if args[1] == "data" {
        let mut bad = 0;
        for f in dataset::list(std::path::Path::new(&args[2])).unwrap() {
            let t = dataset::Trajectory::open(&f).unwrap();
            let mesh = t.mesh();
            let mut g = Graph::new(mesh, &comm).unwrap();
            let s = segment(
                mesh,
                &mut g,
                &SegmentSpec {
                    method: SegmentMethod::Metis,
                    ..Default::default()
                },
                &comm,
                None,
            )
            .unwrap();
            bad += (s.reassigned > 0) as usize;
        }
        println!("metis with pieces: {bad}");
        return;
    }
    if args[1] == "one" {
        let t = dataset::Trajectory::open(std::path::Path::new(&args[2])).unwrap();
        let mesh = t.mesh();
        let mut g = Graph::new(mesh, &comm).unwrap();
        let modes = laplacian_modes(mesh, &mut g, &comm, &ModalOptions::fixed(6)).unwrap();
        for k in [16, 36] {
            for method in SegmentMethod::ALL {
                for connected in [false, true] {
                    for scale in [None, Some(0.0)] {
                        if !method.uses_obstacle() && scale.is_some() {
                            continue;
                        }
                        let spec = SegmentSpec {
                            method,
                            count: k,
                            connected,
                            distance_scale: scale,
                            ..Default::default()
                        };
                        let s = segment_by_modes(mesh, &mut g, &spec, &modes, &comm).unwrap();
                        let q = quality(
                            mesh,
                            &mut g,
                            &s.node_segment[..mesh.n_cells()],
                            k,
                            Dissimilarity::Positions,
                            &comm,
                        )
                        .unwrap();
                        let q2 = quality(
                            mesh,
                            &mut g,
                            &s.node_segment[..mesh.n_cells()],
                            k,
                            Dissimilarity::Features(&modes),
                            &comm,
                        )
                        .unwrap();
                        println!(
                            "{k} {method} {connected} {scale:?} {:.4} {:.4} {:.4} {:.4} sweeps {:?} reassigned {}",
                            q.conductance,
                            q.edge_cut_ratio,
                            q.silhouette,
                            q2.silhouette,
                            s.sweeps,
                            s.reassigned
                        );
                    }
                }
            }
        }
        return;
    }
    let n: usize = args[2].parse().unwrap();
    let mesh = if args[1] == "3d" {
        let m = (n as f64).cbrt() as usize;
        sample::block([m, m, m], [1.0, 0.9, 0.8])
    } else {
        let m = (n as f64 / 2.0).sqrt() as usize;
        sample::triangles(m, m, 1.6, 1.0)
    };
    let mut g = Graph::new(&mesh, &comm).unwrap();
    let t = Instant::now();
    let modes = laplacian_modes(&mesh, &mut g, &comm, &ModalOptions::fixed(6)).unwrap();
    println!(
        "{} cells, modes {:.2} s",
        mesh.n_cells(),
        t.elapsed().as_secs_f64()
    );
    for k in [36, 100, 300, 1000] {
        for method in [SegmentMethod::Metis, SegmentMethod::Slic, SegmentMethod::SlicExp] {
            let spec = SegmentSpec {
                method,
                count: k,
                ..Default::default()
            };
            let t = Instant::now();
            let s = segment_by_modes(&mesh, &mut g, &spec, &modes, &comm).unwrap();
            let a = t.elapsed().as_secs_f64();
            let t = Instant::now();
            let q = quality(
                &mesh,
                &mut g,
                &s.node_segment[..mesh.n_cells()],
                k,
                Dissimilarity::Positions,
                &comm,
            )
            .unwrap();
            println!(
                "{k} {method} {a:.2} s, {} sweeps last {:?} reassigned {}, quality {:.2} s {q:?}",
                s.sweeps.len(),
                s.sweeps.last(),
                s.reassigned,
                t.elapsed().as_secs_f64()
            );
        }
    }
}
