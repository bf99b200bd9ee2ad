//! Every path of the processor: functions against the library's, one path against the other, rows against single numbers.

use std::f64::consts::{PI, TAU};

use dynid_core::lanes::{exp, expm1, ln, run_on, sin_cos, tanh, Kernel, Lanes, Path, MOST_LANES};

/// One function over a slice, in rows or number by number.
struct Map<'a> {
    function: Function,
    rows: bool,
    x: &'a [f64],
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Function {
    Sin,
    Cos,
    Exp,
    Expm1,
    Tanh,
    Ln,
    Sqrt,
    Fused,
}

impl Function {
    #[inline(always)]
    fn at<L: Lanes>(self, x: L) -> L {
        match self {
            Self::Sin => sin_cos(x).0,
            Self::Cos => sin_cos(x).1,
            Self::Exp => exp(x),
            Self::Expm1 => expm1(x),
            Self::Tanh => tanh(x),
            Self::Ln => ln(x),
            Self::Sqrt => x.sqrt(),
            Self::Fused => x.mul_add(x, x).mul_sub_from(x, x),
        }
    }

    fn by_libm(self, x: f64) -> f64 {
        match self {
            Self::Sin => x.sin(),
            Self::Cos => x.cos(),
            Self::Exp => x.exp(),
            Self::Expm1 => x.exp_m1(),
            Self::Tanh => x.tanh(),
            Self::Ln => x.ln(),
            Self::Sqrt => x.sqrt(),
            Self::Fused => f64::NAN,
        }
    }
}

impl Kernel for Map<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> Vec<f64> {
        let mut y = vec![0.0; self.x.len()];
        if self.rows {
            for (x, y) in self.x.chunks_exact(L::LEN).zip(y.chunks_exact_mut(L::LEN)) {
                self.function.at(L::load(x)).store(y);
            }
        } else {
            for (x, y) in self.x.chunks_exact(1).zip(y.chunks_exact_mut(1)) {
                self.function.at(S::load(x)).store(y);
            }
        }
        y
    }
}

fn paths() -> impl Iterator<Item = Path> {
    Path::ALL.into_iter().filter(|path| path.is_available())
}

fn on(path: Path, function: Function, rows: bool, x: &[f64]) -> Vec<f64> {
    run_on(path, Map { function, rows, x })
}

/// Steps between neighbouring doubles from `a` to `b`.
fn steps(a: f64, b: f64) -> u64 {
    if a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan()) {
        return 0;
    }
    let ordered = |x: f64| {
        let bits = x.to_bits() as i64;
        if bits < 0 {
            i64::MIN - bits
        } else {
            bits
        }
    };
    ordered(a).abs_diff(ordered(b))
}

/// Evenly over [-most, most], and as many spread over the orders of magnitude.
fn arguments(most: f64) -> Vec<f64> {
    let n = 100_000 * MOST_LANES;
    let mut x: Vec<f64> = (0..n)
        .map(|k| most * (2.0 * (k as f64 + 0.37) / n as f64 - 1.0))
        .collect();
    x.extend((0..n).map(|k| {
        let size = most * (-40.0 * k as f64 / n as f64).exp();
        if k % 2 == 0 {
            size
        } else {
            -size
        }
    }));
    x
}

fn worst(path: Path, function: Function, x: &[f64]) -> (u64, f64) {
    on(path, function, true, x)
        .iter()
        .zip(x)
        .map(|(y, x)| (steps(*y, function.by_libm(*x)), *x))
        .max_by_key(|(steps, _)| *steps)
        .unwrap()
}

#[test]
fn functions_are_as_the_library_has_them() {
    use Function::{Cos, Exp, Expm1, Sin, Sqrt, Tanh};
    for path in paths() {
        for (function, most, allowed) in [
            (Sin, 7.0, 2),
            (Cos, 7.0, 2),
            (Sin, 32_000.0, 2),
            (Cos, 32_000.0, 2),
            (Sin, 1e9, 2),
            (Cos, 1e9, 2),
            (Exp, 700.0, 1),
            (Exp, 760.0, 1),
            (Expm1, 40.0, 2),
            (Expm1, 709.0, 2),
            (Tanh, 30.0, 3),
            (Tanh, 1e3, 3),
            (Sqrt, 1e3, 0),
        ] {
            let (steps, at) = worst(path, function, &arguments(most));
            println!(
                "{:8} {function:?} to {most}: {steps} steps at {at:e}",
                path.name()
            );
            assert!(
                steps <= allowed,
                "{} {function:?}: {steps} steps at {at:e}",
                path.name()
            );
        }
    }
}

#[test]
fn logarithms_are_as_the_library_has_them() {
    let x: Vec<f64> = arguments(1.5)
        .into_iter()
        .map(f64::abs)
        .chain(arguments(700.0).into_iter().map(f64::exp))
        .collect();
    for path in paths() {
        let (steps, at) = worst(path, Function::Ln, &x);
        println!("{:8} Ln: {steps} steps at {at:e}", path.name());
        assert!(steps <= 2, "{}: {steps} steps at {at:e}", path.name());
    }
}

#[test]
fn a_logarithm_ends_at_the_least_normal_number() {
    let ends = [
        0.0,
        -0.0,
        -1.0,
        5e-324,
        f64::MIN_POSITIVE,
        1.0,
        2.0,
        f64::MAX,
    ];
    let none = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
    for path in paths() {
        let least = f64::MIN_POSITIVE.ln();
        let expected = [
            least,
            least,
            least,
            least,
            least,
            0.0,
            2f64.ln(),
            f64::MAX.ln(),
        ];
        assert_eq!(
            on(path, Function::Ln, true, &ends),
            expected,
            "{}",
            path.name()
        );
        let found = on(path, Function::Ln, false, &none);
        assert!(
            found.iter().all(|x| x.is_nan()),
            "{}: {found:?}",
            path.name()
        );
    }
}

/// Near multiples of pi/2 every leading digit cancels; values from the digits of pi (mpmath, 40 digits).
#[test]
fn sines_near_their_zeros_have_all_their_digits() {
    let cases = [
        (PI, 1.2246467991473532e-16),
        (TAU, -2.4492935982947064e-16),
        (22.0, -8.851309290403876e-3),
        (355.0, -3.014_435_335_948_845e-5),
        (113.0 * PI, 0.0),
    ];
    for path in paths() {
        for (x, expected) in &cases[..4] {
            let y = on(path, Function::Sin, true, &[*x; MOST_LANES]);
            assert!(
                steps(y[3], *expected) <= 1,
                "{} sin {x}: {:e}",
                path.name(),
                y[3]
            );
        }
        let (x, _) = cases[4];
        let y = on(path, Function::Sin, true, &[x; MOST_LANES]);
        assert_eq!(steps(y[0], x.sin()), 0, "{}", path.name());
    }
}

#[test]
fn the_ends_of_the_numbers() {
    let x = [
        0.0,
        -0.0,
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MIN_POSITIVE,
        5e-324,
        1e308,
    ];
    for path in paths() {
        for function in [
            Function::Sin,
            Function::Cos,
            Function::Exp,
            Function::Expm1,
            Function::Tanh,
        ] {
            for (y, x) in on(path, function, true, &x).iter().zip(x) {
                let expected = function.by_libm(x);
                // The least numbers may come back as zero with the right sign.
                let near =
                    steps(*y, expected) <= 1 || (expected != 0.0 && (y - expected).abs() < 1e-320);
                assert!(
                    near || (y == &0.0 && expected == 0.0),
                    "{} {function:?}({x:e}) = {y:e}",
                    path.name()
                );
            }
        }
    }
}

/// A row of any width and a single number give the same bits; processors differ only by fusing.
#[test]
fn rows_and_single_numbers_are_the_same_bits() {
    use Function::{Cos, Exp, Expm1, Fused, Ln, Sin, Sqrt, Tanh};
    let x: Vec<f64> = arguments(50.0)
        .into_iter()
        .step_by(7)
        .take(8 * 8000)
        .collect();
    for function in [Sin, Cos, Exp, Expm1, Tanh, Ln, Sqrt, Fused] {
        let bits = |path, rows| -> Vec<u64> {
            on(path, function, rows, &x)
                .into_iter()
                .map(f64::to_bits)
                .collect()
        };
        for path in paths() {
            assert!(
                bits(path, true) == bits(path, false),
                "{} {function:?}",
                path.name()
            );
        }
        let fused: Vec<_> = paths().filter(|path| *path > Path::Baseline).collect();
        for pair in fused.windows(2) {
            assert!(bits(pair[0], true) == bits(pair[1], true), "{function:?}");
        }
    }
}
