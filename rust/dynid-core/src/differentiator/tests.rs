use super::*;

const STEP: f64 = 0.001;

/// Runs `signal` through a window, leaving out what `lost` says, and hands over every answer.
fn run(
    window: usize,
    signal: impl Fn(f64) -> f64,
    lost: impl Fn(usize) -> bool,
    mut check: impl FnMut(f64, [f64; 3]),
) -> usize {
    let mut filter = Differentiator::new(1, STEP, window).unwrap();
    let mut answers = 0;
    for k in (0..2000).filter(|k| !lost(*k)) {
        let t = k as f64 * STEP;
        if filter.push(t, &[signal(t)]).unwrap() {
            answers += 1;
            check(t - filter.delay(), filter.fitted().map(|x| x[0]));
        }
    }
    answers
}

#[test]
fn a_sine_comes_late_by_the_stated_delay_at_every_frequency() {
    for window in [7, 21, 51] {
        let half = (window / 2) as i32;
        for hertz in [0.5, 2.0, 7.0, 20.0] {
            let w = std::f64::consts::TAU * hertz;
            // Gains of a filter of linear phase: real, from the weights of Savitzky and Golay.
            let s = |i: i32| f64::from(i) / f64::from(half);
            let sums: Vec<f64> = [0, 2, 4]
                .iter()
                .map(|p| (-half..=half).map(|i| s(i).powi(*p)).sum())
                .collect();
            let (m0, m2, m4) = (sums[0], sums[1], sums[2]);
            let det = m0 * m4 - m2 * m2;
            let gain = |weight: &dyn Fn(f64) -> f64, odd: bool| -> f64 {
                (-half..=half)
                    .map(|i| {
                        let phase = w * STEP * f64::from(i);
                        weight(s(i)) * if odd { phase.sin() } else { phase.cos() }
                    })
                    .sum()
            };
            let h = f64::from(half) * STEP;
            let value = gain(&|s| (m4 - m2 * s * s) / det, false);
            let slope = gain(&|s| s / m2, true) / h;
            let curvature = gain(&|s| 2.0 * (m0 * s * s - m2) / det, false) / (h * h);
            let answers = run(
                window,
                |t| (w * t + 0.3).sin(),
                |_| false,
                |t, fitted| {
                    if t < h - 0.1 * STEP {
                        return; // the window is not full yet
                    }
                    let (sin, cos) = (w * t + 0.3).sin_cos();
                    for (fitted, expected) in
                        fitted
                            .iter()
                            .zip([value * sin, slope * cos, curvature * sin])
                    {
                        let size = expected.abs().max(w * w);
                        assert!(
                            (fitted - expected).abs() < 1e-9 * size,
                            "{window} {hertz} {fitted} {expected}"
                        );
                    }
                },
            );
            assert!(answers > 1900);
            // In the band it is the derivative itself.
            if window == 7 && hertz <= 2.0 {
                assert!((value - 1.0).abs() < 1e-3 && (slope / w - 1.0).abs() < 1e-3);
                assert!((curvature / (w * w) + 1.0).abs() < 1e-3);
            }
        }
    }
}

#[test]
fn the_band_ends_where_the_formula_says() {
    for window in [21, 51] {
        let hertz = 0.532 / delay(window, STEP);
        let mut most = 0.0_f64;
        let sine = |t: f64| (std::f64::consts::TAU * hertz * t).sin();
        run(
            window,
            sine,
            |_| false,
            |t, [value, ..]| {
                if t > 0.1 {
                    most = most.max(value.abs());
                }
            },
        );
        assert!((most - 0.5_f64.sqrt()).abs() < 0.05, "{window} {most}");
    }
}

#[test]
fn a_parabola_comes_back_exactly_through_any_gap() {
    let curve = |t: f64| 100.0 + 3.0 * t - 7.0 * t * t;
    let lost: [&dyn Fn(usize) -> bool; 3] = [
        &|_| false,
        &|k| k * 7919 % 100 < 50,     // half of them
        &|k| (300..900).contains(&k), // 0.6 s
    ];
    for (case, lost) in lost.iter().enumerate() {
        let answers = run(21, curve, lost, |t, fitted| {
            let expected = [curve(t), 3.0 - 14.0 * t, -14.0];
            for (fitted, (expected, tolerance)) in
                fitted.iter().zip(expected.iter().zip([1e-11, 1e-9, 1e-7]))
            {
                assert!(
                    (fitted - expected).abs() < tolerance,
                    "case {case}: {fitted} {expected}"
                );
            }
        });
        assert!(answers > [1980, 800, 1350][case], "case {case}: {answers}");
    }
}

#[test]
fn what_left_the_window_is_forgotten_to_the_last_bit() {
    let mut old = Differentiator::new(2, STEP, 9).unwrap();
    for k in 0..40 {
        let _ = old
            .push(f64::from(k) * STEP, &[1e300 * f64::from(k), f64::from(k)])
            .unwrap();
    }
    let mut fresh = Differentiator::new(2, STEP, 9).unwrap();
    for k in 40..80 {
        let (t, sample) = (f64::from(k) * STEP, [(f64::from(k) * 0.1).sin(), 5.0]);
        let (of_old, of_fresh) = (
            old.push(t, &sample).unwrap(),
            fresh.push(t, &sample).unwrap(),
        );
        if k >= 49 {
            assert!(of_old && of_fresh);
            assert_eq!(old.fitted(), fresh.fitted());
        }
    }
}

#[test]
fn time_that_does_not_go_on_starts_again() {
    let mut filter = Differentiator::new(1, STEP, 5).unwrap();
    let mut settled = |t: f64| filter.push(t, &[1.0]).unwrap();
    assert_eq!(
        [0.0, 0.001, 0.002, 0.003, 0.004].map(&mut settled),
        [false, false, false, false, true]
    );
    assert!(!settled(0.004));
    assert!(!settled(f64::NAN));
    assert_eq!(
        [1.0, 1.001, 1.002, 1.003, 1.004].map(settled),
        [false, false, false, false, true]
    );
}

#[test]
fn the_first_answer_comes_when_it_is_said_to() {
    for (window, first) in [(5, 5), (7, 5), (9, 6), (15, 10), (21, 14), (101, 64)] {
        assert_eq!(first_answer(window), first);
        for step in [0.00025, 0.001, 0.004] {
            let mut filter = Differentiator::new(1, step, window).unwrap();
            for start in [0.0, 12_345.678] {
                let times = (0..200).map(|k| start + f64::from(k) * step);
                let answers = times.map(|t| filter.push(t, &[1.0]).unwrap());
                let before = answers.take_while(|answer| !answer).count();
                assert_eq!(before + 1, first, "{window} {step} {start}");
                filter.reset();
            }
        }
    }
}

#[test]
fn the_usual_window_answers_within_ten_samples() {
    for step in [0.001, 0.00125, 0.002, 0.004, 0.008, 0.02] {
        assert!(first_answer(usual_window(step)) <= 10, "{step}");
    }
    assert!(first_answer(usual_window(STEP) + 2) > 10);
    // Faster than that it is ten milliseconds.
    for step in [0.0005, 0.00025] {
        assert!(
            first_answer(usual_window(step)) as f64 * step < 0.0105,
            "{step}"
        );
    }
}

/// Noise of one encoder step of 1e-5 rad, evenly spread, as noise of the answer: value, slope, curvature.
fn noise(window: usize) -> [f64; 3] {
    let mut state = 1_u64;
    let encoder: Vec<f64> = (0..2000)
        .map(|_| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            1e-5 * ((state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5)
        })
        .collect();
    let (mut squares, mut count) = ([0.0; 3], 0.0);
    let read = |t: f64| encoder[(t / STEP).round() as usize];
    run(
        window,
        read,
        |_| false,
        |t, fitted| {
            // From the first full window on.
            if t > 0.1 {
                count += 1.0;
                for (sum, x) in squares.iter_mut().zip(fitted) {
                    *sum += x * x;
                }
            }
        },
    );
    squares.map(|sum: f64| (sum / count).sqrt())
}

#[test]
fn what_a_shorter_window_costs() {
    let [usual, longer] = [usual_window(STEP), 21].map(noise);
    for (window, [q, dq, ddq]) in [(usual_window(STEP), usual), (21, longer)] {
        println!("window {window}: q {q:.1e} rad, dq {dq:.1e} rad/s, ddq {ddq:.3} rad/s^2");
    }
    let cost: Vec<f64> = usual.iter().zip(longer).map(|(a, b)| a / b).collect();
    println!(
        "times: q {:.2}, dq {:.2}, ddq {:.2}",
        cost[0], cost[1], cost[2]
    );
    // White noise: the window to the powers -1/2, -3/2 and -5/2.
    let shorter = 21.0 / usual_window(STEP) as f64;
    for (cost, power) in cost.into_iter().zip([0.5, 1.5, 2.5]) {
        assert!(
            (cost / shorter.powf(power) - 1.0).abs() < 0.15,
            "{cost} {power}"
        );
    }
}

#[test]
fn windows_that_are_none() {
    for (step, window) in [(0.0, 7), (f64::NAN, 7), (STEP, 6), (STEP, 3), (STEP, 103)] {
        assert!(Differentiator::new(1, step, window).is_err());
    }
    assert_eq!(
        [0.001, 0.002, 0.008, 0.0005, 1e-9, 1e9].map(usual_window),
        [15, 11, 7, 31, 101, 7]
    );
    assert!(Differentiator::new(1, STEP, 5)
        .unwrap()
        .push(0.0, &[1.0, 2.0])
        .is_err());
}

#[test]
fn a_lost_sample_takes_no_older_one_in() {
    let mut filter = Differentiator::new(1, STEP, 7).unwrap();
    for k in (0..=10).filter(|k| *k != 8) {
        filter.push(f64::from(k) * STEP, &[0.0]).unwrap();
    }
    // Of the last seven times, 4 to 10, one is missing.
    assert_eq!(filter.n_samples(), 6);
}
