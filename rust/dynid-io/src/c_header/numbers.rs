//! Numbers as C writes them to the last bit: hexadecimal floats.

use std::fmt::Write;

const FRACTION_BITS: u32 = 52;
const LEAST_EXPONENT: i64 = -1022;

/// A finite number as a hexadecimal float, `1.5` as `0x1.8p+0`. A model holds no other.
pub(super) fn number(x: f64) -> String {
    let bits = x.to_bits();
    let sign = if x.is_sign_negative() { "-" } else { "" };
    let fraction = bits & ((1 << FRACTION_BITS) - 1);
    let biased = (bits >> FRACTION_BITS & 0x7ff) as i64;
    let (whole, exponent) = match (biased, fraction) {
        (0, 0) => (0, 0),
        (0, _) => (0, LEAST_EXPONENT),
        _ => (1, biased - 1023),
    };
    let digits = format!("{fraction:013x}");
    let digits = digits.trim_end_matches('0');
    let point = if digits.is_empty() { "" } else { "." };
    format!("{sign}0x{whole}{point}{digits}p{exponent:+}")
}

/// `static const double dynid_name[][width] = {...};`, or one row where the width is 1.
pub(super) fn table(name: &str, width: usize, values: &[f64]) -> String {
    let written: Vec<String> = values.iter().map(|x| number(*x)).collect();
    let mut text = format!("static const double dynid_{name}[{}]", values.len() / width);
    if width == 1 {
        let _ = writeln!(text, " = {{{}}};", lines(&written));
    } else {
        let rows = written
            .chunks(width)
            .map(|row| format!("{{{}}}", lines(row)));
        let rows: Vec<String> = rows.collect();
        let _ = writeln!(text, "[{width}] = {{\n    {}\n}};", rows.join(",\n    "));
    }
    text
}

/// Six to a line.
fn lines(written: &[String]) -> String {
    let lines: Vec<String> = written.chunks(6).map(|line| line.join(", ")).collect();
    lines.join(",\n     ")
}
