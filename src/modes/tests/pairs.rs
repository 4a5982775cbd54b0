//! General pairs of matrices with eigenvalues known on paper, by the dense and by the sparse solver.

use super::super::*;
use super::matrices::{self, problem};
use m4gn_base::Error;
use m4gn_model::modal::ModalSolver;
use std::f64::consts::PI;

fn bands(points: usize, band: [f64; 3], weight: &[f64]) -> Rows {
    matrices::bands(0..points as i64, points as i64, band, weight)
}

/// Nothing but zeros in row 20 and its column, and this on the diagonal.
fn alone(rows: &mut Rows, diagonal: f64) {
    for e in 0..rows.value.len() {
        match ((rows.row[20]..rows.row[21]).contains(&e), rows.column[e] == 20) {
            (true, true) => rows.value[e] = diagonal,
            (false, false) => {}
            _ => rows.value[e] = 0.0,
        }
    }
}

fn modes(problem: &Problem, n: usize) -> Result<Modes> {
    solve(problem, &Comm::serial(), &ModalOptions::fixed(n))
}

fn close(found: &[f64], exact: impl IntoIterator<Item = f64>, relative: f64) {
    for (i, (x, y)) in found.iter().zip(exact).enumerate() {
        assert!((x - y).abs() <= relative * y.abs(), "eigenvalue {i}: {x}, expected {y}");
    }
}

fn times(a: &Rows, x: &[f64]) -> Vec<f64> {
    let row = |w: &[usize]| (w[0]..w[1]).map(|e| a.value[e] * x[a.column[e] as usize]).sum();
    a.row.windows(2).map(row).collect()
}

#[test]
fn a_bar_with_a_consistent_mass() {
    for n in [40, 400] {
        let h = 1.0 / (n + 1) as f64;
        let m = bands(n, [h / 6.0, 4.0 * h / 6.0, h / 6.0], &[1.0]);
        let found =
            modes(&problem(bands(n, [-1.0 / h, 2.0 / h, -1.0 / h], &[1.0]), Some(m.clone())), 5).unwrap();
        let exact = |k: usize| {
            let c = (k as f64 * PI * h).cos();
            6.0 / (h * h) * (1.0 - c) / (2.0 + c)
        };
        assert_eq!(found.eigenvalues.len(), 5);
        close(&found.eigenvalues, (1..=5).map(exact), 1e-9);
        // phi^T M phi is the sum of all entries of M.
        let sum: f64 = m.value.iter().sum();
        for phi in &found.vectors {
            let square: f64 = times(&m, phi).iter().zip(phi).map(|(x, y)| x * y).sum();
            assert!((square / sum - 1.0).abs() < 1e-9);
        }
    }
}

#[test]
fn a_pair_that_is_not_symmetric_is_refused() {
    for n in [60, 300] {
        m4gn_samples::fails(modes(&problem(bands(n, [-1.3, 2.0, -0.7], &[1.0]), None), 4), &["symmetric"]);
    }
}

#[test]
fn massless_unknowns_have_no_modes_of_their_own() {
    // Masses at every second node of a chain of springs: the springs between masses have half the stiffness.
    for masses in [30, 150] {
        let n = 2 * masses + 1;
        let pair = Problem {
            mass: Mass::Diagonal((0..n).map(|i| (i % 2) as f64).collect()),
            ..problem(bands(n, [-1.0, 2.0, -1.0], &[1.0]), None)
        };
        let found = modes(&pair, 5).unwrap();
        let exact = |k: usize| 1.0 - (k as f64 * PI / (masses + 1) as f64).cos();
        close(&found.eigenvalues, (1..=5).map(exact), 1e-8);
        if masses == 30 {
            let error = modes(&pair, 31).unwrap_err();
            assert!(matches!(&error, Error::Numerical(m) if m.contains("only 30")), "{error}");
        }
    }
}

#[test]
fn unknowns_of_a_point_and_free_parts_make_repeated_eigenvalues() {
    // Two free chains, not joined: 0 twice, and all else twice.
    for n in [30, 90] {
        let mut k = bands(n, [-1.0, 2.0, -1.0], &[1.0, 1.0]);
        for i in [0, 1, 2 * n - 2, 2 * n - 1] {
            for e in k.row[i]..k.row[i + 1] {
                if k.column[e] == i as i64 {
                    k.value[e] = 1.0;
                }
            }
        }
        let pair = Problem {
            block: 2,
            positions: (0..n).map(|i| [i as f64, 0.3, 0.0]).collect(),
            ..problem(k, None)
        };
        let found = modes(&pair, 3).unwrap();
        assert_eq!(found.eigenvalues.len(), 4);
        let exact = 2.0 - 2.0 * (PI / n as f64).cos();
        assert!(found.eigenvalues[..2].iter().all(|v| v.abs() < 1e-10), "{:?}", found.eigenvalues);
        close(&found.eigenvalues[2..], [exact, exact], 1e-7);
        // Each of the first two is constant in each part.
        for phi in &found.vectors[..2] {
            for point in phi.chunks_exact(2) {
                assert!((point[0] - phi[0]).abs() < 1e-6 && (point[1] - phi[1]).abs() < 1e-6);
            }
        }
    }
}

#[test]
fn wrong_pairs_are_refused() {
    let good = problem(bands(40, [-1.0, 2.0, -1.0], &[1.0]), None);
    type Damage = fn(&mut Problem);
    let damages: [(&str, Damage); 12] = [
        ("finite", |p| p.stiffness.value[7] = f64::NAN),
        ("finite", |p| p.mass = Mass::Diagonal(vec![f64::INFINITY; 40])),
        ("column 40", |p| p.stiffness.column[5] = 40),
        ("column -1", |p| p.stiffness.column[5] = -1),
        ("offset", |p| p.stiffness.row[3] = 1),
        ("offsets", |p| p.stiffness.row[40] = 7),
        ("as many", |p| p.mass = Mass::Diagonal(vec![1.0; 39])),
        ("above 0", |p| p.mass = Mass::Diagonal(vec![0.0; 40])),
        ("points", |p| p.block = 3),
        ("points", |p| p.block = 0),
        ("positions", |p| p.positions = vec![[0.0; 3]; 3]),
        ("shift", |p| p.shift = Some(f64::NAN)),
    ];
    for (word, damage) in damages {
        let mut bad = good.clone();
        damage(&mut bad);
        let error = modes(&bad, 3).unwrap_err();
        assert!(matches!(&error, Error::Input(m) if m.contains(word)), "{word}: {error}");
    }
    assert!(matches!(modes(&good, 40), Err(Error::Input(_))));
    assert_eq!(modes(&good, 0).unwrap().vectors.len(), 0);
    // A row of zeros in both.
    for n in [40, 140] {
        let mut bad = problem(bands(n, [-1.0, 2.0, -1.0], &[1.0]), None);
        alone(&mut bad.stiffness, 0.0);
        if let Mass::Diagonal(m) = &mut bad.mass {
            m[20] = 0.0;
        }
        let error = modes(&bad, 3).unwrap_err();
        assert!(matches!(&error, Error::Numerical(m) if m.contains("a row of zeros in both")), "{error}");
    }
}

#[test]
fn indefinite_pairs_are_refused_at_any_size() {
    let solvers = [ModalSolver::Auto, ModalSolver::Direct, ModalSolver::Iterative];
    for (n, solver) in [60, 200].into_iter().flat_map(|n| solvers.map(|s| (n, s))) {
        let modes =
            |p: &Problem, n| solve(p, &Comm::serial(), &ModalOptions { solver, ..ModalOptions::fixed(n) });
        let good = || problem(bands(n, [-1.0, 2.0, -1.0], &[1.0]), None);
        let negative = |k: Rows| problem(k, None);
        let mut mass = good();
        mass.mass = Mass::Diagonal((0..n).map(|i| if i % 7 == 0 { -1.0 } else { 1.0 }).collect());
        let consistent =
            |beside: f64| Problem { mass: Mass::Matrix(bands(n, [beside, 1.0, beside], &[1.0])), ..good() };
        assert!(modes(&consistent(0.49), 4).is_ok(), "{n} rows, {solver:?}");
        let mut massless = consistent(0.49);
        if let Mass::Matrix(m) = &mut massless.mass {
            let own = (m.row[20]..m.row[21]).find(|&e| m.column[e] == 20).unwrap();
            m.value[own] = 0.0;
        }
        let inside = Problem { shift: Some(1.01), ..good() };
        let mut far = bands(n, [-1.0, 2.0, -1.0], &[1.0]);
        alone(&mut far, -0.01);
        for (name, bad, word) in [
            ("one eigenvalue far below", negative(far), "shift below"),
            ("K - 0.5 I", negative(bands(n, [-1.0, 1.5, -1.0], &[1.0])), "shift below"),
            ("-K", negative(bands(n, [1.0, -2.0, 1.0], &[1.0])), "shift below"),
            ("a shift inside of the spectrum", inside, "shift below"),
            ("an indefinite consistent mass", consistent(0.51), "M is not positive semi-definite"),
            (
                "a consistent mass that is indefinite by far",
                consistent(3.0),
                "M is not positive semi-definite",
            ),
            ("a massless row that is coupled", massless, "M is not positive semi-definite"),
            ("a negative mass", mass, "M is not positive semi-definite"),
        ] {
            let error = modes(&bad, 4).unwrap_err().to_string();
            assert!(error.contains(word), "{n} rows, {solver:?}, {name}: {error}");
        }
    }
}

/// Equal parts that are not joined: each eigenvalue as often as there are parts, in any numbering.
#[test]
fn eigenvalues_that_are_repeated_often_are_whole() {
    for (parts, points, wanted) in [(5, 30, 1), (60, 20, 6), (9, 40, 20), (200, 8, 6)] {
        let n = parts * points;
        let chain = bands(points, [-1.0, 2.0, -1.0], &[1.0]);
        // Row i of the whole is row `place(i)` of the parts one after the other.
        let solved = |place: &dyn Fn(usize) -> usize| {
            let mut number = vec![0; n];
            (0..n).for_each(|i| number[place(i)] = i as i64);
            let mut rows = Rows { row: vec![0], ..Default::default() };
            for (part, i) in (0..n).map(|i| (place(i) / points, place(i) % points)) {
                for e in chain.row[i]..chain.row[i + 1] {
                    rows.column.push(number[part * points + chain.column[e] as usize]);
                    rows.value.push(chain.value[e]);
                }
                rows.row.push(rows.column.len());
            }
            let position = |i: usize| [place(i) as f64, 0.0, 0.0];
            let pair = Problem { positions: (0..n).map(position).collect(), ..problem(rows, None) };
            modes(&pair, wanted).unwrap()
        };
        let straight = solved(&|i| i);
        let mixed = solved(&|i| (i * 7919 + 13) % n);
        let exact = |k: usize| 2.0 - 2.0 * (k as f64 * PI / (points + 1) as f64).cos();
        let expected = wanted.div_ceil(parts) * parts;
        assert_eq!(straight.eigenvalues.len(), expected, "{parts} chains of {points}");
        assert_eq!(mixed.eigenvalues.len(), expected, "{parts} chains of {points}, mixed");
        close(&straight.eigenvalues, (0..expected).map(|m| exact(m / parts + 1)), 1e-9);
        // The space of a repeated eigenvalue: of any basis of it the sum of squares at a point is the same.
        let spaces = straight.vectors.chunks(parts).zip(mixed.vectors.chunks(parts));
        for (k, (a, b)) in spaces.enumerate() {
            let squares = |vectors: &[Vec<f64>], i: usize| vectors.iter().map(|v| v[i].powi(2)).sum::<f64>();
            let off = (0..n)
                .map(|i| (squares(a, (i * 7919 + 13) % n) - squares(b, i)).abs() / parts as f64)
                .fold(0.0, f64::max);
            assert!(off < 1e-6, "{parts} chains of {points}: space {k} differs by {off:e}");
        }
    }
}

/// A penalty on one unknown is a Dirichlet condition, however large it is.
#[test]
fn penalties_hold_an_unknown_or_are_refused() {
    for n in [60, 200] {
        for penalty in [1e9, 1e12, 1e15, 1e20, 1e30] {
            let mut k = bands(n, [-1.0, 2.0, -1.0], &[1.0]);
            k.value[0] = penalty;
            let found = modes(&problem(k, None), 4).unwrap();
            let exact = |k: usize| 2.0 - 2.0 * (k as f64 * PI / n as f64).cos();
            assert_eq!(found.eigenvalues.len(), 4, "{n} rows, {penalty:e}");
            close(&found.eigenvalues, (1..=4).map(exact), 1e-6);
        }
        // A penalty that ties two unknowns together drowns what the others say.
        let mut k = bands(n, [-1.0, 2.0, -1.0], &[1.0]);
        for (i, j) in [(20, 20), (20, 21), (21, 20), (21, 21)] {
            let e = (k.row[i]..k.row[i + 1]).find(|&e| k.column[e] == j).unwrap();
            k.value[e] += if i as i64 == j { 1e16 } else { -1e16 };
        }
        let error = modes(&problem(k, None), 4).unwrap_err().to_string();
        assert!(error.contains("to 1.0e16"), "{n} rows: {error}");
    }
}

#[test]
fn entries_that_do_not_lie_symmetrically() {
    // Zeros above the diagonal without partners below: the matrix is symmetric, its entries are not.
    let n = 900;
    let mut k = bands(n, [-1.0, 2.0, -1.0], &[1.0]);
    let (mut row, mut column, mut value) = (vec![0], Vec::new(), Vec::new());
    for i in 0..n {
        column.extend_from_slice(&k.column[k.row[i]..k.row[i + 1]]);
        value.extend_from_slice(&k.value[k.row[i]..k.row[i + 1]]);
        for far in [i + 7 + i % 5, i + 31] {
            if i % 3 != 1 && far < n {
                column.push(far as i64);
                value.push(0.0);
            }
        }
        row.push(column.len());
    }
    k = Rows { row, column, value };
    let exact = |m: usize| 2.0 - 2.0 * (m as f64 * PI / (n + 1) as f64).cos();
    let found = modes(&problem(k, None), 3).unwrap();
    close(&found.eigenvalues, (1..=3).map(exact), 1e-9);
}

/// Entries near the end of double's range: right modes, or an error; never wrong or infinite ones.
#[test]
fn matrices_near_the_end_of_double_are_refused() {
    for points in [12, 160] {
        let of = |size: f64| modes(&problem(bands(points, [-size, 2.0 * size, -size], &[1.0]), None), 3);
        let exact = (1..4).map(|k| 2.0 - 2.0 * (f64::from(k) * PI / (points + 1) as f64).cos());
        for size in [1e-90, 1e90] {
            let found = of(size).unwrap();
            let scaled: Vec<f64> = found.eigenvalues.iter().map(|v| v / size).collect();
            close(&scaled, exact.clone(), 1e-6);
        }
        for size in [1e-300, 1e154, 1e300] {
            let message = of(size).unwrap_err().to_string();
            assert!(message.contains("the largest entry of K"), "{size:e}: {message}");
        }
    }
}
