//! How long things took: a fixed table of logarithmic buckets, no allocation after `new`, a relative error below 1.6 %.

/// Buckets per factor of two.
const PER_OCTAVE: u64 = 64;
const BITS: u32 = PER_OCTAVE.trailing_zeros();

/// Numbers below `PER_OCTAVE` have a bucket each; above, every octave has [`PER_OCTAVE`].
const N_BUCKETS: usize = (PER_OCTAVE * (64 - BITS as u64 + 1)) as usize;

/// Counts of durations \[ns\].
#[derive(Clone, Debug)]
pub struct Histogram {
    counts: Vec<u64>,
    n: u64,
    most: u64,
}

impl Histogram {
    /// Empty, with its pages in place: zeros would only be there once something was written to them.
    pub fn new() -> Self {
        let mut counts = vec![1; N_BUCKETS];
        std::hint::black_box(&mut counts).fill(0);
        Self {
            counts,
            n: 0,
            most: 0,
        }
    }

    /// One more.
    pub fn record(&mut self, nanoseconds: u64) {
        if let Some(count) = self.counts.get_mut(bucket(nanoseconds)) {
            *count += 1;
        }
        self.n += 1;
        self.most = self.most.max(nanoseconds);
    }

    /// How many there are.
    pub fn n(&self) -> u64 {
        self.n
    }

    /// The greatest, exactly.
    pub fn most(&self) -> u64 {
        self.most
    }

    /// The least duration that a part of all does not exceed, rounded up within its bucket; zero if there is none.
    pub fn quantile(&self, part: f64) -> u64 {
        let wanted = (part * self.n as f64).ceil() as u64;
        let mut seen = 0;
        for (index, count) in self.counts.iter().enumerate() {
            seen += count;
            if seen >= wanted && seen > 0 {
                return upper_end(index as u64).min(self.most);
            }
        }
        self.most
    }
}

fn bucket(x: u64) -> usize {
    if x < PER_OCTAVE {
        return x as usize;
    }
    let octave = x.ilog2() - BITS;
    // The leading one stands at bit BITS of the mantissa.
    ((u64::from(octave) << BITS) + (x >> octave)) as usize
}

/// The greatest number of a bucket.
fn upper_end(index: u64) -> u64 {
    if index < 2 * PER_OCTAVE {
        return index;
    }
    let octave = (index >> BITS) - 1;
    let mantissa = PER_OCTAVE + (index & (PER_OCTAVE - 1));
    (mantissa << octave) + ((1 << octave) - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_is_in_the_bucket_that_ends_at_or_above_it() {
        for x in (0..5000).chain([u64::MAX, u64::MAX / 3, 1 << 40, (1 << 40) - 1]) {
            let end = upper_end(bucket(x) as u64);
            assert!(end >= x && (end - x) as f64 <= x as f64 / 64.0, "{x} {end}");
            assert!(bucket(x) < N_BUCKETS);
            assert!(x == 0 || bucket(x - 1) <= bucket(x));
        }
    }

    #[test]
    fn quantiles_are_those_of_the_sorted_numbers() {
        let mut histogram = Histogram::new();
        assert_eq!(histogram.quantile(0.5), 0);
        let mut numbers: Vec<u64> = (0..10_000_u64).map(|k| k * 7919 % 10_007 * 31).collect();
        for x in &numbers {
            histogram.record(*x);
        }
        numbers.sort_unstable();
        for part in [0.5, 0.99, 0.999, 0.9999, 1.0] {
            let exact = numbers[(part * 10_000.0) as usize - 1];
            let found = histogram.quantile(part);
            assert!(
                found >= exact && found as f64 <= exact as f64 * (1.0 + 1.0 / 64.0),
                "{part}"
            );
        }
        assert_eq!((histogram.n(), histogram.most()), (10_000, numbers[9999]));
        assert_eq!(histogram.quantile(1.0), numbers[9999]);
    }
}
