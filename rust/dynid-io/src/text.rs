//! Places in a text, and words of it in sentences.

/// Line and column of an offset in bytes, both from 1; columns count characters.
pub(crate) fn position(text: &str, at: usize) -> (usize, usize) {
    let before = text.get(..at).unwrap_or(text);
    let line = before.bytes().filter(|&b| b == b'\n').count() + 1;
    let start = before.rfind('\n').map_or(0, |newline| newline + 1);
    let column = before.get(start..).unwrap_or_default().chars().count() + 1;
    (line, column)
}

/// Start of a text for use in a sentence.
pub(crate) fn shorten(text: &str) -> String {
    shorten_to(text, 40)
}

/// The first `length` characters of a text; what a terminal would obey, or not show, is written out.
pub(crate) fn shorten_to(text: &str, length: usize) -> String {
    let mut short = String::new();
    for c in text.chars().take(length) {
        if matches!(c, '"' | '\'' | '\\') || c.escape_debug().len() == 1 {
            short.push(c);
        } else {
            short.extend(c.escape_debug());
        }
    }
    if text.chars().nth(length).is_some() {
        short.push('…');
    }
    short
}

/// What serde says, short: it begins with words of the file, as long as they are there, and ends with what it expected.
pub fn shorten_said(message: &str) -> String {
    // The last one: an earlier one may stand in the file.
    let at = message.rfind(", expected ").unwrap_or(message.len());
    let (found, expected) = message.split_at(at);
    shorten_to(found, 80) + expected
}

/// Longer names are compared with nothing \[bytes\].
const MAX_NAME: usize = 32;

/// The one of `known` that `name` was probably meant to be: the beginning of one, or a few letters away from it.
pub(crate) fn nearest<'k>(name: &str, known: &[&'k str]) -> Option<&'k str> {
    if name.len() > MAX_NAME {
        return None;
    }
    let name = name.to_lowercase();
    known
        .iter()
        .filter_map(|other| Some((*other, slips(&name, other)?)))
        .min_by_key(|&(_, slips)| slips)
        .map(|(other, _)| other)
}

/// How many slips of the pen lead from `name` to `known`; none if they are too many.
fn slips(name: &str, known: &str) -> Option<usize> {
    let (shorter, longer) = (name.len().min(known.len()), name.len().max(known.len()));
    let begins = known.starts_with(name) || name.starts_with(known);
    if shorter >= 2 && (begins || is_anagram(name, known)) {
        return Some(1);
    }
    let apart = letters_apart(name, known);
    // A third of the letters, rounded up: lower and low, but not a and d.
    (apart <= longer.div_ceil(3) && apart < shorter).then_some(apart)
}

/// The same letters in another order.
fn is_anagram(a: &str, b: &str) -> bool {
    let sorted = |text: &str| {
        let mut bytes = text.as_bytes().to_vec();
        bytes.sort_unstable();
        bytes
    };
    a.len() == b.len() && sorted(a) == sorted(b)
}

/// Letters to add, drop or change on the way from `a` to `b` (Levenshtein).
fn letters_apart(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = i;
        let mut left = i + 1;
        for (entry, y) in row.iter_mut().skip(1).zip(&b) {
            let cost = (diagonal + usize::from(x != *y))
                .min(left + 1)
                .min(*entry + 1);
            diagonal = *entry;
            (*entry, left) = (cost, cost);
        }
        if let Some(first) = row.first_mut() {
            *first = i + 1;
        }
    }
    row.last().copied().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOWN: [&str; 8] = [
        "alpha",
        "lower",
        "upper",
        "velocity",
        "acceleration",
        "effort",
        "a",
        "d",
    ];

    #[test]
    fn a_terminal_obeys_nothing_that_is_quoted() {
        assert_eq!(shorten("a\u{1b}[2J\n\u{202e}"), "a\\u{1b}[2J\\n\\u{202e}");
        assert_eq!(shorten("\"it's\" C:\\ é"), "\"it's\" C:\\ é");
        assert_eq!(shorten_to("\0\0\0", 2), "\\0\\0…");
        let said = shorten_said("unknown field `\u{1b}`, expected `a`");
        assert_eq!(said, "unknown field `\\u{1b}`, expected `a`");
    }

    #[test]
    fn a_slip_finds_its_name() {
        for (slip, meant) in [
            ("aplha", "alpha"),
            ("low", "lower"),
            ("Lower", "lower"),
            ("uper", "upper"),
            ("vel", "velocity"),
            ("velcoity", "velocity"),
            ("velocity_limit", "velocity"),
            ("acc", "acceleration"),
            ("efort", "effort"),
        ] {
            assert_eq!(nearest(slip, &KNOWN), Some(meant), "{slip}");
        }
    }

    #[test]
    fn what_is_far_from_all_is_near_to_none() {
        for other in ["min", "b", "", "friction", "e", &"lower".repeat(10)] {
            assert_eq!(nearest(other, &KNOWN), None, "{other}");
        }
    }

    #[test]
    fn letters_are_counted() {
        for (a, b, apart) in [
            ("", "abc", 3),
            ("abc", "", 3),
            ("kitten", "sitting", 3),
            ("low", "lower", 2),
        ] {
            assert_eq!(letters_apart(a, b), apart);
            assert_eq!(letters_apart(b, a), apart);
        }
    }
}
