//! The solution against plain dense algebra: what it must satisfy, in any order of the unknowns.

#![allow(non_snake_case)] // H and W of the formulas

use dynid_offline::{likeliest, JointGram, Likeliest, Noise, NormalPrior, OfflineError};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

/// Two joints that share unknowns 2 and 3 of seven; unknown 6 is a further one, of the second joint alone.
const PLACES: [&[usize]; 2] = [&[3, 0, 1, 2], &[2, 6, 4, 3, 5]];
const N: usize = 7;
const HELD: usize = 6;
const ROWS: usize = 40;

struct Case {
    grams: Vec<DMatrix<f64>>,
    wide: Vec<DMatrix<f64>>,
    precision: DMatrix<f64>,
    moment: DVector<f64>,
}

fn case(numbers: &[f64]) -> Case {
    let mut numbers = numbers.iter().copied().cycle();
    let mut take = |n: usize, m: usize| DMatrix::from_fn(n, m, |_, _| numbers.next().unwrap());
    let (mut grams, mut wide) = (Vec::new(), Vec::new());
    for places in PLACES {
        let mut rows = take(ROWS, places.len() + 1);
        // Not all alike, however few numbers are cycled through.
        for i in 0..ROWS {
            for k in 0..=places.len() {
                rows[(i, k)] += ((i * (k + 2)) as f64).sin();
            }
        }
        let mut all = DMatrix::zeros(ROWS, N + 1);
        for (k, &at) in places.iter().enumerate() {
            all.set_column(at, &rows.column(k));
        }
        all.set_column(N, &rows.column(places.len()));
        grams.push(rows.transpose() * &rows);
        wide.push(all.transpose() * &all);
    }
    let root = take(HELD, HELD) + DMatrix::identity(HELD, HELD) * 3.0;
    let mut precision = DMatrix::identity(N, N);
    precision
        .view_mut((0, 0), (HELD, HELD))
        .copy_from(&(root.transpose() * root));
    let mut moment = DVector::zeros(N);
    moment.rows_mut(0, HELD).copy_from(&take(HELD, 1).column(0));
    Case {
        grams,
        wide,
        precision,
        moment,
    }
}

fn solved(case: &Case, std: &[f64], is_known: bool) -> Likeliest {
    let parts: Vec<Vec<f64>> = case.grams.iter().map(|g| g.as_slice().to_vec()).collect();
    let joints: Vec<_> = parts
        .iter()
        .zip(PLACES)
        .map(|(gram, places)| JointGram { gram, places })
        .collect();
    let own = case.precision.view((0, 0), (HELD, HELD)).into_owned();
    let prior = NormalPrior {
        precision: own.as_slice(),
        moment: &case.moment.as_slice()[..HELD],
    };
    let noise = Noise {
        std,
        n_effective: &[30.0, 10.0],
        least: &[1e-9, 1e-9],
        n_rows: ROWS as f64,
        is_known,
    };
    likeliest(&joints, N, prior, noise).unwrap()
}

fn precision(case: &Case, noise: &[f64]) -> (DMatrix<f64>, DVector<f64>, Vec<f64>) {
    let weights: Vec<f64> = [30.0, 10.0]
        .iter()
        .zip(noise)
        .map(|(k, s)| k / ROWS as f64 / (s * s))
        .collect();
    let (mut H, mut b) = (case.precision.clone(), case.moment.clone());
    for (wide, w) in case.wide.iter().zip(&weights) {
        H += wide.view((0, 0), (N, N)) * *w;
        b += wide.view((0, N), (N, 1)) * *w;
    }
    (H, b, weights)
}

proptest! {
    #[test]
    fn it_solves_what_dense_algebra_solves(numbers in prop::collection::vec(-2.0..2.0_f64, 97)) {
        let case = case(&numbers);
        let std = [0.3, 2.0];
        let found = solved(&case, &std, true);
        prop_assert_eq!(&found.noise, &std);
        let (H, b, _) = precision(&case, &std);
        let x = DVector::from_vec(found.x.clone());
        prop_assert!((&H * &x - &b).norm() <= 1e-9 * b.norm().max(H.norm() * x.norm()));
        let W = DMatrix::from_row_slice(N, N, &found.whitener);
        prop_assert!((W.transpose() * W * &H - DMatrix::identity(N, N)).norm() < 1e-7);
        let log_det: f64 = 2.0 * H.cholesky().unwrap().l().diagonal().map(f64::ln).sum();
        prop_assert!((found.log_det - log_det).abs() < 1e-7 * (1.0 + log_det.abs()));
        let distance = (x.transpose() * &case.precision * &x)[0] - 2.0 * case.moment.dot(&x);
        prop_assert!((found.distance - distance).abs() < 1e-9 * (1.0 + distance.abs()));
        for (wide, power) in case.wide.iter().zip(&found.power) {
            let signed = (-&x).push(1.0);
            let expected = (signed.transpose() * wide * &signed)[0];
            prop_assert!((power - expected).abs() < 1e-9 * wide.norm());
        }
    }

    #[test]
    fn the_noise_is_at_its_fixed_point(numbers in prop::collection::vec(-2.0..2.0_f64, 97)) {
        let case = case(&numbers);
        let found = solved(&case, &[1.0, 1.0], false);
        let (H, _, weights) = precision(&case, &found.noise);
        let inverse = H.try_inverse().unwrap();
        for j in 0..2 {
            let k = [30.0, 10.0][j];
            let taken = weights[j] * (&inverse * case.wide[j].view((0, 0), (N, N))).trace();
            let left = (k - taken).max(0.1 * k);
            let next = (k / ROWS as f64 * found.power[j] / left).sqrt();
            // A step of less than 1 % was the last one; the next is smaller.
            prop_assert!((next / found.noise[j] - 1.0).abs() < 0.02);
        }
    }
}

#[test]
fn what_nothing_holds_stays_at_zero_and_what_does_not_fit_is_refused() {
    let gram = [2.0, 1.0, 1.0, 3.0];
    let joints = [JointGram {
        gram: &gram,
        places: &[1],
    }];
    let prior = NormalPrior {
        precision: &[0.0, 0.0, 0.0, 1.0],
        moment: &[0.0, 0.0],
    };
    let noise = Noise {
        std: &[1.0],
        n_effective: &[5.0],
        least: &[0.1],
        n_rows: 5.0,
        is_known: true,
    };
    let found = likeliest(&joints, 2, prior, noise).unwrap();
    assert_eq!(found.x[0], 0.0);
    assert!((found.x[1] - 1.0 / 3.0).abs() < 1e-15);

    let shape = |what| Err(OfflineError::Shape { what });
    let beyond = [JointGram {
        gram: &gram,
        places: &[2],
    }];
    assert_eq!(
        likeliest(&beyond, 2, prior, noise),
        shape("Gram matrix of a joint")
    );
    assert_eq!(
        likeliest(&joints, 1, prior, noise),
        shape("Gram matrix of a joint")
    );
    let long = NormalPrior {
        precision: &[1.0; 9],
        moment: &[0.0; 3],
    };
    assert_eq!(
        likeliest(&joints, 2, long, noise),
        shape("precision of the prior")
    );
    let two = Noise {
        least: &[0.1, 0.1],
        ..noise
    };
    assert_eq!(likeliest(&joints, 2, prior, two), shape("noise"));
    let spoiled = [JointGram {
        gram: &[f64::NAN, 1.0, 1.0, 3.0],
        places: &[1],
    }];
    assert!(matches!(
        likeliest(&spoiled, 2, prior, noise),
        Err(OfflineError::NonFinite { .. })
    ));
}
