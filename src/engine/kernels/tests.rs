//! The kernels on every instruction set that this processor has, against plain sums in fp64.

use super::*;

/// A number between -1 and 1 that differs from place to place.
fn number(i: usize) -> f32 {
    ((i as f32 * 0.618_034).fract() - 0.5) * 2.0
}

fn numbers<T: Number>(n: usize, seed: usize) -> Buffer<T> {
    let mut buffer = Buffer::new(n);
    for (i, x) in buffer.iter_mut().enumerate() {
        *x = T::from_f32(number(i + seed));
    }
    buffer
}

/// Products of odd shapes with every addend, function and output.
fn products<T: Number>(isa: Isa) {
    // Miri is some thousand times slower.
    let shapes: &[(usize, usize, usize)] = match cfg!(miri) {
        true => &[(1, 1, 1), (3, 5, 20)],
        // The last three are products of tiles where there are any: whole ones, and less than one at the end.
        false => &[
            (1, 1, 1),
            (5, 3, 16),
            (7, 17, 40),
            (13, 64, 80),
            (50, 35, 130),
            (16, 32, 16),
            (48, 64, 64),
            (39, 128, 150),
        ],
    };
    for &(n, inputs, outputs) in shapes {
        let columns = padded(outputs);
        let stride = padded(inputs) + 16;
        let weight = |i: usize, o: usize| number(i * outputs + o + 3) / (inputs as f32).sqrt();
        let packed: Packed<T> = Packed::new(isa, inputs, outputs, weight);
        let mut x: Buffer<T> = numbers(n * stride, 1);
        for (i, x) in x.iter_mut().enumerate() {
            if i % stride >= inputs {
                *x = T::default();
            }
        }
        let rows: Buffer<f32> = numbers(n * columns, 5);
        let senders: Buffer<T> = numbers(4 * columns, 6);
        let index: Vec<i32> = (0..n).map(|i| (i * 7 % 4) as i32).collect();
        let owner: Vec<i32> = (0..n).map(|i| 10 + (i / 9) as i32).collect();
        let kinds = [
            Addend::Nothing,
            Addend::Bias(&rows[..columns]),
            Addend::Rows(&rows),
            Addend::Output(&rows[..columns]),
            Addend::Ends { senders: &senders, index: &index, receivers: &rows, owner: &owner, first: 10 },
        ];
        for addend in kinds {
            let f = |i: usize, o: usize| match addend {
                Addend::Nothing => 0.0,
                Addend::Bias(b) => b[o],
                Addend::Rows(r) => r[i * columns + o],
                Addend::Output(b) => b[o] + rows[i * columns + o],
                Addend::Ends { .. } => {
                    let s = index[i] as usize * columns + o;
                    senders[s].to_f32() + rows[(owner[i] - 10) as usize * columns + o]
                }
            };
            for function in [Function::Identity, Function::Relu, Function::Silu] {
                let mut wide: Buffer<f32> = numbers(n * columns, 5);
                product(isa, &packed, (&x, stride), n, addend, function, Output::Wide(&mut wide));
                for i in 0..n {
                    for o in 0..outputs {
                        let sum: f64 = (0..inputs)
                            .map(|k| {
                                f64::from(x[i * stride + k].to_f32())
                                    * f64::from(T::from_f32(weight(k, o)).to_f32())
                            })
                            .sum();
                        let y = sum + f64::from(f(i, o));
                        let y = match function {
                            Function::Identity => y,
                            Function::Relu => y.max(0.0),
                            Function::Silu => y / (1.0 + (-y).exp()),
                        };
                        let found = f64::from(wide[i * columns + o]);
                        assert!(
                            (found - y).abs() < 3e-6,
                            "{}: {found} for {y} in {n} x {inputs} x {outputs}, {addend:?}",
                            isa.name()
                        );
                    }
                }
                if !matches!(addend, Addend::Output(_)) {
                    let mut slim: Buffer<T> = Buffer::new(n * columns);
                    product(isa, &packed, (&x, stride), n, addend, function, Output::Narrow(&mut slim));
                    let same =
                        slim.iter().zip(wide.iter()).all(|(s, w)| s.to_f32() == T::from_f32(*w).to_f32());
                    assert!(same, "{}: narrow is wide, rounded", isa.name());
                }
            }
        }
    }
}

#[test]
fn products_are_sums() {
    for isa in Isa::available() {
        products::<f32>(isa);
        products::<Bf16>(isa);
    }
}

#[test]
fn bf16_is_rounded_to_nearest_even() {
    let cases = [
        (1.0, 0x3f80),
        // Half of the last place: to the even one, down and up.
        (f32::from_bits(0x3f80_8000), 0x3f80),
        (f32::from_bits(0x3f81_8000), 0x3f82),
        (f32::from_bits(0x3f80_8001), 0x3f81),
        (f32::MAX, 0x7f80),
        (f32::NEG_INFINITY, 0xff80),
        (-0.0, 0x8000),
    ];
    for (x, bits) in cases {
        assert_eq!(Bf16::from_f32(x), Bf16(bits), "{x}");
        for isa in Isa::available() {
            let mut out = [Bf16(0); 16];
            narrow(isa, &[x; 16], &mut out);
            assert_eq!(out, [Bf16(bits); 16], "{}: {x}", isa.name());
            // A NaN whose mantissa is in the half that is cut off.
            narrow(isa, &[f32::from_bits(0x7f80_0001); 16], &mut out);
            assert!(out.iter().all(|x| x.to_f32().is_nan()), "{}", isa.name());
        }
    }
    assert!(Bf16::from_f32(f32::NAN).to_f32().is_nan());
}

#[test]
fn activations_keep_nan_and_survive_extremes() {
    for isa in Isa::available() {
        let one: Packed<f32> = Packed::new(isa, 1, 1, |_, _| 1.0);
        for (x, relu, silu) in
            [(-1e30, 0.0, 0.0), (1e30, 1e30, 1e30), (0.0, 0.0, 0.0), (-90.0, 0.0, 0.0), (88.5, 88.5, 88.5)]
        {
            let apply = |f| {
                let mut out = [0f32; 16];
                product(isa, &one, (&[x], 1), 1, Addend::Nothing, f, Output::Wide(&mut out));
                out[0]
            };
            assert_eq!(apply(Function::Relu), relu, "{}", isa.name());
            // exp is clamped at -87, which leaves 1e-38 of a large negative number.
            let found = apply(Function::Silu);
            assert!((found - silu).abs() <= 1e-6 * silu.abs() + 1e-6, "{}: silu({x}) is {found}", isa.name());
        }
        for f in [Function::Identity, Function::Relu, Function::Silu] {
            let mut out = [0f32; 16];
            let nan = [f32::NAN];
            product(isa, &one, (&nan, 1), 1, Addend::Nothing, f, Output::Wide(&mut out));
            assert!(out[0].is_nan(), "{}: {f:?}", isa.name());
        }
    }
}

#[test]
fn layer_norm_of_known_rows() {
    for isa in Isa::available() {
        // 1..=18 has mean 9.5 and variance (18^2 - 1) / 12; the padding does not count. Five rows: four and one.
        let norm = Norm::new(&[2.0; 18], &[0.5; 18]);
        let mut x = [0f32; 5 * 32];
        for (i, x) in x.iter_mut().enumerate().filter(|(i, _)| i % 32 < 18) {
            *x = (i % 32 + 1) as f32;
        }
        let scale = 1.0 / (323.0f64 / 12.0 + 1e-5).sqrt();
        let expected = |i: usize| match i % 32 {
            c if c < 18 => (c as f64 - 8.5) * scale * 2.0 + 0.5,
            _ => 0.0,
        };
        let check = |found: &[f32], times: f64| {
            for (i, y) in found.iter().enumerate() {
                let y = f64::from(*y);
                assert!((y - times * expected(i)).abs() < 4e-6, "{}: {y} at {i}", isa.name());
            }
        };
        let mut out = [9f32; 5 * 32];
        layer_norm::<f32>(isa, &norm, &x, 5, Normed::Wide(&mut out));
        check(&out, 1.0);
        layer_norm::<f32>(isa, &norm, &x, 5, Normed::Residual(&mut out));
        check(&out, 2.0);
        let mut narrow = [Bf16(1); 5 * 32];
        layer_norm(isa, &norm, &x, 5, Normed::Narrow(&mut narrow));
        let worst = narrow
            .iter()
            .enumerate()
            .fold(0f64, |m, (i, y)| m.max((f64::from(y.to_f32()) - expected(i)).abs()));
        assert!(worst < 0.01, "{worst}");

        // Edges: rows 0 and 1 belong to node 3, 2 to 4 to node 5.
        let (mut edges, before) = ([1f32; 5 * 32], [2f32; 5 * 32]);
        let mut sums = [0f32; 3 * 32];
        for (before, keep) in [(None, true), (Some(&before[..]), false)] {
            sums.fill(0.0);
            let out = Normed::Edges {
                before,
                edges: &mut edges,
                keep,
                sums: &mut sums,
                owner: &[3, 3, 5, 5, 5],
                first: 3,
            };
            layer_norm(isa, &norm, &x, 5, out);
            let base = if before.is_some() { 2.0 } else { 1.0 };
            for (i, e) in edges.iter().enumerate() {
                // The second time they are left as the first one made them.
                assert!((f64::from(*e) - 1.0 - expected(i)).abs() < 4e-6);
            }
            for (i, s) in sums.iter().enumerate() {
                let count = [2.0, 0.0, 3.0][i / 32];
                assert!((f64::from(*s) - count * (base + expected(i))).abs() < 1e-5);
            }
        }

        let mut latents = [1f32; 5 * 32];
        for (before, base) in [(None, 1.0), (Some(&before[..]), 2.0)] {
            layer_norm(isa, &norm, &x, 5, Normed::Latents { before, edges: &mut latents });
            let off = |(i, e): (usize, &f32)| (f64::from(*e) - base - expected(i)).abs();
            assert!(latents.iter().enumerate().map(off).all(|off| off < 4e-6));
        }
    }
}

#[test]
fn means_and_softmax_of_known_rows() {
    for isa in Isa::available() {
        let mut x = [1f32; 32];
        let table: Vec<f32> = [10.0, 20.0, 60.0].iter().flat_map(|v| [*v; 16]).collect();
        add_means(isa, &mut x, 16, &table, &[5, 6, 8], &[9, 9, 9, 9, 9, 2, 0, 1]);
        assert_eq!((x[0], x[31]), (61.0, 16.0));
        let mut p = [7f32; 48];
        p[..2].copy_from_slice(&[0.0, 2f32.ln()]);
        p[16..18].copy_from_slice(&[1e4, 1e4]);
        p[32..34].copy_from_slice(&[f32::NAN, 0.0]);
        softmax(isa, &mut p, 16, 2, 1.0);
        for (a, b) in [p[0], p[1], p[16], p[17]].iter().zip([1.0 / 3.0, 2.0 / 3.0, 0.5, 0.5]) {
            assert!((a - b).abs() < 1e-6, "{}", isa.name());
        }
        assert!(p[2..16].iter().chain(&p[18..32]).all(|v| *v == 0.0));
        assert!(p[33].is_nan());
    }
}

#[test]
fn indices_out_of_range_are_caught() {
    let isa = Isa::detect();
    let weight: Packed<f32> = Packed::new(isa, 1, 1, |_, _| 1.0);
    let rows = [0f32; 32];
    let caught = |index: i32, owner: i32, n: usize| {
        let run = || {
            let mut out = [0f32; 32];
            let ends = Addend::Ends {
                senders: &rows,
                index: &[0, index],
                receivers: &rows,
                owner: &[4, owner],
                first: 4,
            };
            let x = (&rows[..], 1);
            product(isa, &weight, x, n, ends, Function::Identity, Output::Wide(&mut out));
        };
        std::panic::catch_unwind(run).is_err()
    };
    assert!(!caught(1, 5, 2));
    assert!(caught(2, 5, 2) && caught(-1, 5, 2) && caught(1, 6, 2) && caught(1, 3, 2) && caught(1, 5, 3));
}

fn outer_products<T: Number>(isa: Isa) {
    let shapes: &[(usize, usize, usize)] = match cfg!(miri) {
        true => &[(3, 5, 16)],
        false => &[(1, 1, 16), (5, 3, 16), (7, 17, 48), (48, 64, 64), (47, 81, 96)],
    };
    for &(n, outputs, columns) in shapes {
        let left = padded(outputs);
        let y: Buffer<T> = numbers(n * (left + 16), 2);
        let x: Buffer<T> = numbers(n * (columns + 32), 9);
        let (y_stride, x_stride) = (left + 16, columns + 32);
        let mut sums = vec![1.0; outputs * columns];
        let mut pairs = Pairs::new(n, outputs, columns);
        // Twice: what is there is added to.
        for _ in 0..2 {
            let sizes = (outputs, columns);
            outer(isa, (&y, y_stride), (&x, x_stride), n, sizes, &mut sums, &mut pairs);
        }
        for o in 0..outputs {
            for c in 0..columns {
                let terms = (0..n).map(|i| {
                    f64::from(y[i * y_stride + o].to_f32()) * f64::from(x[i * x_stride + c].to_f32())
                });
                let expected = 1.0 + 2.0 * terms.sum::<f64>();
                let found = f64::from(sums[o * columns + c]);
                let name = isa.name();
                assert!((found - expected).abs() < 1e-5 * n as f64, "{name}: {found} {expected}");
            }
        }
    }
}

#[test]
fn outer_products_are_sums() {
    for isa in Isa::available() {
        outer_products::<f32>(isa);
        outer_products::<Bf16>(isa);
    }
}

#[test]
fn rows_are_gathered_and_scattered() {
    for isa in Isa::available() {
        let (index, columns) = ([7, 5, 7], 32);
        let mut x: Buffer<f32> = numbers(3 * columns, 1);
        let before = x.to_vec();
        let mut table = vec![0.5; 3 * columns];
        scatter_add(isa, &x, columns, &mut table, &index, 5);
        assert_eq!(table[3], 0.5 + before[columns + 3]);
        assert_eq!(table[columns], 0.5, "row 6 is nobody's");
        assert_eq!(table[2 * columns + 1], 0.5 + before[1] + before[2 * columns + 1]);
        let short: Buffer<Bf16> = numbers(3 * columns, 1);
        let mut rounded = vec![0.5; 3 * columns];
        scatter_add(isa, &short, columns, &mut rounded, &index, 5);
        assert_eq!(rounded[3], 0.5 + short[columns + 3].to_f32());
        gather_add(isa, &mut x, columns, &table, &index, 5);
        assert_eq!(x[columns + 3], before[columns + 3] + table[3]);
        let caught = std::panic::catch_unwind(|| gather_add(isa, &mut [0.0; 16], 16, &[0.0; 16], &[1], 0));
        assert!(caught.is_err(), "row 1 of 1");
    }
}

fn activations<T: Number>(isa: Isa) {
    // One vector, whole fours of vectors, and fours with a rest.
    for columns in [16, 64, 80] {
        let n = 5;
        let kept: Buffer<T> = numbers(n * columns, 1);
        let before: Buffer<f32> = numbers(n * columns, 2);
        for slope in [false, true] {
            let mut d: Buffer<f32> = numbers(n * columns, 2);
            let mut narrow: Buffer<T> = Buffer::new(n * columns);
            let mut bias: Buffer<f32> = numbers(columns, 3);
            let of = match slope {
                true => Saved::Slope(&kept[..]),
                false => Saved::Value(&kept[..]),
            };
            activation_backward(isa, of, (n, columns), &mut d, &mut narrow, &mut bias);
            let derivative = |i: usize| match (slope, kept[i].to_f32()) {
                (true, kept) => kept,
                (false, kept) => f32::from(kept > 0.0),
            };
            for i in 0..n * columns {
                let expected = before[i] * derivative(i);
                assert_eq!(d[i], expected, "{columns} columns, number {i}");
                assert_eq!(narrow[i].to_f32(), T::from_f32(expected).to_f32());
            }
            for j in 0..columns {
                let sum: f32 = (0..n).map(|i| d[i * columns + j]).sum();
                assert!((bias[j] - number(j + 3) - sum).abs() < 1e-5, "column {j}");
            }
        }
    }
}

#[test]
fn derivatives_go_through_activations() {
    for isa in Isa::available() {
        activations::<f32>(isa);
        activations::<Bf16>(isa);
    }
}
