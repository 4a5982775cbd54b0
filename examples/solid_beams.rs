//! Frequencies of a clamped beam, 0.6 x 0.06 x 0.06 m, E = 1 MPa, rho = 1000 kg/m^3, by element, Poisson's ratio and
//! refinement, as the table in docs/solids.md.
//!
//!     cargo run --release --example solid_beams -- 2 4        (cells across; 15 times as many along)

use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Result};
use m4gn_model::modal::{ModalOptions, ModeCount};
use m4gn_modes::fem::{Fixed, Formulation, Material, Options, modes};
use m4gn_samples::points as sample;
use m4gn_samples::points::Kind;
use std::time::Instant;

fn main() -> Result<()> {
    let across: Vec<usize> = std::env::args().skip(1).map(|a| count(&a)).collect::<Result<_>>()?;
    let exact = 1.875_104_068_711_961f64.powi(2) / (2.0 * std::f64::consts::PI * 0.36)
        * 0.06
        * (1000f64 / 12.0).sqrt();
    println!("Euler-Bernoulli: {exact:.4} Hz; deviations of the first two bending frequencies in %");
    println!("| cells | element | formulation | nu 0 | nu 0.3 | nu 0.4 | nu 0.49 | nu 0.4999 | s |");
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for &n in &across {
        for kind in Kind::ALL {
            for formulation in [Formulation::Smoothed, Formulation::Isoparametric] {
                if kind == Kind::Polyhedra && formulation == Formulation::Isoparametric {
                    continue;
                }
                let start = Instant::now();
                let mut line = format!("| {} x {n} x {n} | {kind:?} | {formulation:?} |", 15 * n);
                for poisson in [0.0, 0.3, 0.4, 0.49, 0.4999] {
                    let found = beam(kind, n, poisson, formulation)?;
                    let off = |i: usize| 100.0 * (found[i] / exact - 1.0);
                    line += &format!(" {:+.2} {:+.2} |", off(0), off(1));
                }
                println!("{line} {:.1} |", start.elapsed().as_secs_f64() / 5.0);
            }
        }
    }
    Ok(())
}

fn count(word: &str) -> Result<usize> {
    match word.parse() {
        Ok(n) if (1..=16).contains(&n) => Ok(n),
        _ => Err(Error::Input(format!("'{word}': expected the number of cells across, 1 to 16"))),
    }
}

fn beam(kind: Kind, n: usize, poisson: f64, formulation: Formulation) -> Result<Vec<f64>> {
    let mesh = sample::block(kind, [15 * n, n, n], [0.6, 0.06, 0.06]);
    let materials = vec![Material { young: 1e6, poisson, density: 1000.0 }; mesh.n_cells];
    let clamped = (0..mesh.points.len()).filter(|&p| mesh.points[p][0] < 1e-9);
    let fixed: Vec<Fixed> = clamped.map(|p| Fixed::all(p as i32)).collect();
    let options = Options {
        formulation,
        modal: ModalOptions { count: ModeCount::Fixed(2), ..Default::default() },
        ..Default::default()
    };
    Ok(modes(&mesh, &materials, &fixed, &options, &Comm::serial())?.frequencies())
}
