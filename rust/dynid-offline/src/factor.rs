//! Triangular factors: `R` with `Rᵀ R = Aᵀ A`, without ever forming `Aᵀ A` (whose condition is the square of A's).

use crate::error::OfflineError;
use crate::triangle::factor_once;

/// Rows that one QR eats at a time; taller matrices are split and merged.
const BLOCK_ROWS: usize = 256;
/// Columns of the widest matrix: its factor has half a gigabyte, and no robot so many unknowns.
const MOST_COLUMNS: usize = 1 << 13;

/// R of `rows` (m × width, row-major): width × width, row-major, upper triangular, non-negative diagonal. Zero rows fill
/// up when `m < width`.
///
/// # Errors
/// [`OfflineError`] if the length is not a multiple of `width`, this is more than 8192, or a number is not finite.
pub fn triangular_factor(rows: &[f64], width: usize) -> Result<Vec<f64>, OfflineError> {
    if width == 0 || width > MOST_COLUMNS || !rows.len().is_multiple_of(width) {
        return Err(OfflineError::Shape { what: "rows" });
    }
    if !rows.iter().all(|x| x.is_finite()) {
        return Err(OfflineError::NonFinite { what: "rows" });
    }
    let block = BLOCK_ROWS.max(2 * width);
    let factors: Vec<Vec<f64>> = rows
        .chunks(block * width)
        .map(|rows| factor_once(rows, width))
        .collect();
    Ok(tree(factors, width))
}

/// R of several factors stacked, merged pairwise in a fixed tree: the result depends on their order alone.
///
/// # Errors
/// [`OfflineError::Shape`] if there is none, or one is not width × width.
pub fn merge(factors: &[&[f64]], width: usize) -> Result<Vec<f64>, OfflineError> {
    if factors.is_empty() || factors.iter().any(|f| f.len() != width * width) {
        return Err(OfflineError::Shape { what: "factor" });
    }
    if factors.iter().any(|f| !f.iter().all(|x| x.is_finite())) {
        return Err(OfflineError::NonFinite { what: "factor" });
    }
    Ok(tree(factors.iter().map(|f| f.to_vec()).collect(), width))
}

pub(crate) fn tree(mut level: Vec<Vec<f64>>, width: usize) -> Vec<f64> {
    if level.is_empty() {
        return vec![0.0; width * width];
    }
    while level.len() > 1 {
        level = level
            .chunks(2)
            .map(|pair| match pair {
                [left, right] => factor_once(&[left.as_slice(), right.as_slice()].concat(), width),
                single => single.concat(),
            })
            .collect();
    }
    level.swap_remove(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn gram(rows: &[f64], width: usize) -> Vec<f64> {
        let mut g = vec![0.0; width * width];
        for row in rows.chunks_exact(width) {
            for i in 0..width {
                for j in 0..width {
                    g[i * width + j] += row[i] * row[j];
                }
            }
        }
        g
    }

    proptest! {
        #[test]
        fn a_factor_has_the_gram_matrix_of_its_rows(rows in proptest::collection::vec(-1.0..1.0f64, 5 * 3..5 * 40)) {
            let rows = &rows[..rows.len() / 5 * 5];
            let r = triangular_factor(rows, 5).unwrap();
            for (a, b) in gram(rows, 5).iter().zip(gram(&r, 5)) {
                prop_assert!((a - b).abs() < 1e-12);
            }
        }

        #[test]
        fn merging_factors_is_factoring_the_stack(rows in proptest::collection::vec(-1.0..1.0f64, 4 * 30)) {
            let parts: Vec<Vec<f64>> = rows.chunks(4 * 10).map(|part| triangular_factor(part, 4).unwrap()).collect();
            let merged = merge(&parts.iter().map(Vec::as_slice).collect::<Vec<_>>(), 4).unwrap();
            for (a, b) in gram(&rows, 4).iter().zip(gram(&merged, 4)) {
                prop_assert!((a - b).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn spoiled_input_is_an_error() {
        assert!(triangular_factor(&[1.0, 2.0, 3.0], 2).is_err());
        assert!(triangular_factor(&[1.0, f64::NAN], 2).is_err());
        assert!(merge(&[], 2).is_err());
        assert!(merge(&[&[1.0]], 2).is_err());
    }
}
