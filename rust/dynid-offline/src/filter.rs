//! Zero-phase low-pass: a cascade of second-order sections, forwards and backwards.
//!
//! The sections are designed by `scipy.signal`; only the running is here, because it has to follow every column of the
//! regressor. Eight columns run side by side, one per lane. Same result as `scipy.signal.sosfiltfilt` (odd padding,
//! steady-state start).

use crate::error::OfflineError;

/// Columns that are filtered together.
pub const LANES: usize = 8;
/// One sample of [`LANES`] columns.
pub type Lanes = [f64; LANES];

/// A second-order section `(b0 + b1 z^-1 + b2 z^-2) / (1 + a1 z^-1 + a2 z^-2)` and its steady state for a unit input.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Section {
    b: [f64; 3],
    a: [f64; 2],
    steady: [f64; 2],
}

/// Forward-backward filter. With no section it hands its input through.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct ZeroPhase {
    sections: Vec<Section>,
    pad: usize,
}

impl ZeroPhase {
    /// `sections`: rows `b0 b1 b2 a0 a1 a2` as `scipy.signal.butter(..., output="sos")` gives them; `steady`: rows of
    /// `scipy.signal.sosfilt_zi`; `pad`: samples of odd extension at each end.
    ///
    /// # Errors
    /// [`OfflineError`] if the two have different lengths, a number is not finite, or an `a0` is not 1.
    pub fn new(
        sections: &[[f64; 6]],
        steady: &[[f64; 2]],
        pad: usize,
    ) -> Result<Self, OfflineError> {
        if sections.len() != steady.len() {
            return Err(OfflineError::Shape {
                what: "steady state of the filter",
            });
        }
        let numbers = sections.iter().flatten().chain(steady.iter().flatten());
        if !numbers.into_iter().all(|x| x.is_finite()) {
            return Err(OfflineError::NonFinite {
                what: "filter coefficients",
            });
        }
        if sections.iter().any(|s| s[3] != 1.0) {
            return Err(OfflineError::Shape {
                what: "filter section (a0 must be 1)",
            });
        }
        Ok(Self {
            sections: sections
                .iter()
                .zip(steady)
                .map(|(s, steady)| Section {
                    b: [s[0], s[1], s[2]],
                    a: [s[4], s[5]],
                    steady: *steady,
                })
                .collect(),
            pad,
        })
    }

    /// True if there is no section, so that it hands its input through.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.sections.is_empty()
    }

    /// Least number of samples that can be filtered.
    #[must_use]
    pub fn min_samples(&self) -> usize {
        self.pad + 1
    }

    /// Filters `samples` (time along the slice, one column per lane) in place. `work` is scratch of any length.
    pub fn apply<const N: usize>(&self, samples: &mut [[f64; N]], work: &mut Vec<[f64; N]>) {
        if self.sections.is_empty() {
            return;
        }
        let n = samples.len();
        debug_assert!(n >= self.min_samples());
        work.clear();
        work.extend((0..self.pad).map(|k| mirror(&samples[0], &samples[self.pad - k])));
        work.extend_from_slice(samples);
        work.extend((0..self.pad).map(|k| mirror(&samples[n - 1], &samples[n - 2 - k])));
        self.run(work.iter_mut());
        self.run(work.iter_mut().rev());
        samples.copy_from_slice(&work[self.pad..self.pad + n]);
    }

    /// One direction, direct form II transposed, started in the steady state of its first sample.
    fn run<'a, const N: usize>(&self, samples: impl Iterator<Item = &'a mut [f64; N]>) {
        // The band's filter has two sections; with their number known they stay in registers.
        match <&[Section; 2]>::try_from(self.sections.as_slice()) {
            Ok(sections) => cascade(*sections, samples),
            Err(_) => {
                let mut samples: Vec<_> = samples.collect();
                for section in &self.sections {
                    cascade([*section], samples.iter_mut().map(|sample| &mut **sample));
                }
            }
        }
    }
}

/// Runs `S` sections one after the other over all samples.
fn cascade<'a, const N: usize, const S: usize>(
    sections: [Section; S],
    mut samples: impl Iterator<Item = &'a mut [f64; N]>,
) {
    let Some(first) = samples.next() else { return };
    // A section's steady output for a steady input is the next one's input; `steady` already counts on that.
    let mut z0 = sections.map(|s| first.map(|x| x * s.steady[0]));
    let mut z1 = sections.map(|s| first.map(|x| x * s.steady[1]));
    for sample in std::iter::once(first).chain(samples) {
        let mut x = *sample;
        for (k, section) in sections.iter().enumerate() {
            let mut y = [0.0; N];
            for lane in 0..N {
                y[lane] = section.b[0] * x[lane] + z0[k][lane];
                z0[k][lane] = section.b[1] * x[lane] - section.a[0] * y[lane] + z1[k][lane];
                z1[k][lane] = section.b[2] * x[lane] - section.a[1] * y[lane];
            }
            x = y;
        }
        *sample = x;
    }
}

/// Point reflection of `inner` through the end value: odd extension.
fn mirror<const N: usize>(end: &[f64; N], inner: &[f64; N]) -> [f64; N] {
    std::array::from_fn(|lane| 2.0 * end[lane] - inner[lane])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A one-pole smoother as a section: y = (x + x z^-1)/2 per sample is FIR, enough to see phase and gain.
    #[test]
    fn a_symmetric_pair_of_passes_keeps_a_straight_line() {
        let filter = ZeroPhase::new(&[[0.5, 0.5, 0.0, 1.0, 0.0, 0.0]], &[[0.5, 0.0]], 4).unwrap();
        let mut line: Vec<Lanes> = (0..50).map(|k| [f64::from(k); LANES]).collect();
        filter.apply(&mut line, &mut Vec::new());
        for (k, sample) in line.iter().enumerate() {
            assert!((sample[3] - k as f64).abs() < 1e-12);
        }
    }

    #[test]
    fn no_section_hands_through() {
        let filter = ZeroPhase::default();
        let mut x = vec![[1.0; LANES], [5.0; LANES]];
        filter.apply(&mut x, &mut Vec::new());
        assert_eq!(x, vec![[1.0; LANES], [5.0; LANES]]);
    }
}
