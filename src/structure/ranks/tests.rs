//! Answers known on paper.

use super::*;

/// Directed edge counts of a ring of `k` segments that share `weight` edges each.
fn ring(k: usize, weight: f64) -> Vec<f64> {
    let mut a = vec![0.0; k * k];
    for i in 0..k {
        let j = (i + 1) % k;
        a[i * k + j] = weight;
        a[j * k + i] = weight;
    }
    a
}

#[test]
fn a_ring_is_cut_into_arcs() {
    let (k, np) = (12, 3);
    let ranks = assign(&[10.0; 12], &ring(k, 5.0), &vec![1.0; np]).unwrap();
    let report = report(&[10.0; 12], &ring(k, 5.0), &vec![1.0; np], &ranks).unwrap();
    assert_eq!(report.loads, [40.0; 3]);
    assert_eq!(report.segments, [4; 3]);
    // Three arcs have three ends.
    assert_eq!((report.cut, report.imbalance), (15.0, 1.0));
}

#[test]
fn shares_follow_the_weights() {
    let ranks = assign(&[10.0; 12], &ring(12, 1.0), &[2.0, 1.0]).unwrap();
    let report = report(&[10.0; 12], &ring(12, 1.0), &[2.0, 1.0], &ranks).unwrap();
    assert_eq!(report.loads, [80.0, 40.0]);
    assert_eq!((report.cut, report.imbalance), (2.0, 1.0));
}

#[test]
fn no_rank_is_empty_for_any_number_of_segments() {
    for np in 1..7 {
        for k in np..14 {
            let sizes: Vec<f64> = (0..k).map(|i| 1.0 + (i * i % 7) as f64).collect();
            for adjacency in [ring(k, 3.0), vec![0.0; k * k]] {
                let ranks = assign(&sizes, &adjacency, &vec![1.0; np]).unwrap();
                assert!((0..np as i32).all(|r| ranks.contains(&r)), "{k} on {np}: {ranks:?}");
                assert_eq!(ranks, assign(&sizes, &adjacency, &vec![1.0; np]).unwrap());
            }
        }
    }
}

#[test]
fn as_many_segments_as_ranks_are_matched_by_size() {
    let ranks = assign(&[10.0, 30.0, 20.0], &ring(3, 1.0), &[3.0, 2.0, 1.0]).unwrap();
    assert_eq!(ranks, [2, 0, 1]);
}

#[test]
fn a_large_segment_does_not_get_company() {
    // 6 + 2 x 3: the balance of 6 : 6 goes before the edges.
    let mut a = vec![0.0; 9];
    (a[1], a[3]) = (1.0, 1.0);
    let ranks = assign(&[6.0, 3.0, 3.0], &a, &[1.0, 1.0]).unwrap();
    assert_eq!(ranks[1], ranks[2]);
    assert_ne!(ranks[0], ranks[1]);
}

#[test]
fn a_grid_of_segments_is_balanced_and_its_cut_small() {
    // 8 x 8 segments on 4 ranks: the best is four squares with 16 cut edges.
    let (n, k) = (8, 64);
    let mut a = vec![0.0; k * k];
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        for (x, y) in [(i + 1, j), (i, j + 1)] {
            if x < n && y < n {
                let (p, q) = (i * n + j, x * n + y);
                (a[p * k + q], a[q * k + p]) = (1.0, 1.0);
            }
        }
    }
    let ranks = assign(&vec![7.0; k], &a, &[1.0; 4]).unwrap();
    let report = report(&vec![7.0; k], &a, &[1.0; 4], &ranks).unwrap();
    assert_eq!((report.imbalance, report.cut), (1.0, 16.0));
}

#[test]
fn bad_input_is_said() {
    let message = |r: Result<Vec<i32>>| r.unwrap_err().to_string();
    assert!(message(assign(&[1.0; 3], &ring(3, 1.0), &[1.0; 4])).contains("raise segments to 4"));
    assert!(message(assign(&[1.0; 3], &ring(3, 1.0), &[1.0, 0.0])).contains("weight of rank 1"));
    assert!(matches!(assign(&[1.0; 3], &[0.0; 4], &[1.0]), Err(Error::Input(_))));
    assert!(matches!(assign(&[1.0; 3], &ring(3, 1.0), &[]), Err(Error::Input(_))));
    assert!(matches!(assign(&[f64::NAN; 3], &ring(3, 1.0), &[1.0]), Err(Error::Input(_))));
    assert!(matches!(report(&[1.0; 3], &ring(3, 1.0), &[1.0], &[0, 0, 1]), Err(Error::Input(_))));
}
