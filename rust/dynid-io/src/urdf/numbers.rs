//! Numbers of attributes, read strictly.

use super::source::shorten;
use super::tag::Attribute;

/// Longest text of a number or of three \[bytes\].
const MAX_TEXT: usize = 512;
/// Largest magnitude that enters a product: powers of it stay far from overflow.
const MAX_MAGNITUDE: f64 = 1e12;

/// One finite number, blanks around it allowed.
fn finite(text: &str) -> Option<f64> {
    // `parse` also reads "inf", "nan", and turns 1e999 into infinity.
    text.parse::<f64>().ok().filter(|x| x.is_finite())
}

fn sized(text: &str) -> Option<&str> {
    (text.len() <= MAX_TEXT).then_some(text)
}

/// Three finite numbers of moderate size, separated by blanks. `mend` says how to write them.
///
/// # Errors
/// A sentence.
pub(super) fn three(attribute: &Attribute, mend: &str) -> Result<[f64; 3], String> {
    let name = attribute.name;
    let complain = || {
        let found = shorten(&attribute.value);
        format!("{name} needs three finite numbers, found \"{found}\"; write {mend}")
    };
    let text = sized(&attribute.value).ok_or_else(complain)?;
    let mut words = text.split_ascii_whitespace();
    let mut numbers = [0.0; 3];
    for number in &mut numbers {
        *number = words.next().and_then(finite).ok_or_else(complain)?;
        moderate(name, *number)?;
    }
    if words.next().is_some() {
        return Err(complain());
    }
    Ok(numbers)
}

/// One finite number. `mend` says how to write it.
///
/// # Errors
/// A sentence.
pub(super) fn one(name: &str, text: &str, mend: &str) -> Result<f64, String> {
    let complain = || {
        format!(
            "{name} needs one finite number, found \"{}\"; write {mend}",
            shorten(text)
        )
    };
    sized(text)
        .and_then(|text| finite(text.trim_ascii()))
        .ok_or_else(complain)
}

/// Refuses a magnitude beyond any robot.
///
/// # Errors
/// A sentence.
pub(super) fn moderate(name: &str, number: f64) -> Result<f64, String> {
    if number.abs() <= MAX_MAGNITUDE {
        Ok(number)
    } else {
        Err(format!("{name} is {number:e}, expected at most {MAX_MAGNITUDE:e} in SI units; check the exponent"))
    }
}

/// The bound that a limit means: one beyond any robot is none.
pub(super) fn bound(number: f64) -> f64 {
    if number.abs() > MAX_MAGNITUDE {
        number.signum() * f64::INFINITY
    } else {
        number
    }
}

/// Refuses a negative number. `meaning` says what the number is.
///
/// # Errors
/// A sentence.
pub(super) fn not_negative(name: &str, number: f64, meaning: &str) -> Result<f64, String> {
    if number >= 0.0 {
        Ok(number)
    } else {
        Err(format!(
            "{name} is {number}, expected zero or more: it is {meaning}"
        ))
    }
}
