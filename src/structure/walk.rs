//! Random-walk structural encoding (Dwivedi et al., 2021) of a weighted graph.

/// Diagonals of P, P^2, ... P^steps, row-major `[n x steps]`, with P = D^-1 A and `a` `[n x n]`.
pub(super) fn rwse(n: usize, a: &[f64], steps: usize) -> Vec<f32> {
    let mut p = a.to_vec();
    for row in p.chunks_exact_mut(n.max(1)) {
        let degree: f64 = row.iter().sum();
        if degree > 0.0 {
            row.iter_mut().for_each(|x| *x /= degree);
        }
    }
    let mut power = p.clone();
    let mut next = vec![0.0; n * n];
    let mut out = vec![0f32; n * steps];
    for step in 0..steps {
        for i in 0..n {
            out[i * steps + step] = power[i * n + i] as f32;
        }
        if step + 1 == steps {
            break;
        }
        next.fill(0.0);
        for i in 0..n {
            for k in 0..n {
                let w = power[i * n + k];
                if w != 0.0 {
                    let (row, from) = (&mut next[i * n..(i + 1) * n], &p[k * n..(k + 1) * n]);
                    row.iter_mut().zip(from).for_each(|(x, y)| *x += w * y);
                }
            }
        }
        std::mem::swap(&mut power, &mut next);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ring_returns_with_central_binomials() {
        // On a ring of n > t nodes a walk is back after t steps with probability C(t, t/2) / 2^t, t even.
        let n = 9;
        let mut a = vec![0.0; n * n];
        for i in 0..n {
            a[i * n + (i + 1) % n] = 3.0;
            a[((i + 1) % n) * n + i] = 3.0;
        }
        let out = rwse(n, &a, 6);
        for row in out.chunks_exact(6) {
            for (x, y) in row.iter().zip([0.0, 0.5, 0.0, 6.0 / 16.0, 0.0, 20.0 / 64.0]) {
                assert!((x - y).abs() < 1e-7);
            }
        }
    }

    #[test]
    fn a_lone_segment_and_none() {
        assert_eq!(rwse(1, &[4.0], 3), [1.0, 1.0, 1.0]);
        assert_eq!(rwse(1, &[0.0], 2), [0.0, 0.0]);
        assert!(rwse(2, &[0.0; 4], 0).is_empty());
    }
}
