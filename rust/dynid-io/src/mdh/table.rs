//! Typed access to TOML: every value with its place, every refusal with a sentence.

use toml::de::{DeTable, DeValue};
use toml::Spanned;

use super::error::MdhError;
use super::MAX_BYTES;
use crate::text::{nearest, position, shorten, shorten_to};

/// Largest magnitude that enters a product: powers of it stay far from overflow.
const MAX_MAGNITUDE: f64 = 1e12;
/// Longest name of a robot, link or joint \[bytes\].
const MAX_NAME: usize = 256;

/// Text of a file together with its name.
pub(super) struct Source<'a> {
    pub(super) file: &'a str,
    text: &'a str,
}

impl<'a> Source<'a> {
    /// Checks size and encoding; strips a UTF-8 byte order mark.
    ///
    /// # Errors
    /// [`MdhError::Invalid`] for more than [`MAX_BYTES`] and for bytes that are not UTF-8.
    pub(super) fn decode(file: &'a str, bytes: &'a [u8]) -> Result<Self, MdhError> {
        let whole = |text| Self { file, text };
        if bytes.len() > MAX_BYTES {
            let message = format!("larger than {MAX_BYTES} bytes, expected a short TOML file");
            return Err(whole("").refuse(0, "file", message));
        }
        let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
        match std::str::from_utf8(bytes) {
            Ok(text) => Ok(whole(text)),
            Err(error) => {
                let good = bytes.get(..error.valid_up_to()).unwrap_or_default();
                let before = std::str::from_utf8(good).unwrap_or_default();
                let message = "this byte is not UTF-8; save the file as UTF-8";
                Err(whole(before).refuse(before.len(), "text", message))
            }
        }
    }

    /// The file as a table of values.
    ///
    /// # Errors
    /// [`MdhError::Invalid`] if it is not TOML; nesting is limited by the parser.
    pub(super) fn parse(&self) -> Result<DeTable<'a>, MdhError> {
        let parsed = DeTable::parse(self.text).map_err(|error| {
            let at = error.span().map_or(0, |span| span.start);
            let hint = match self.text.trim_start().starts_with('<') {
                true => "; this looks like a URDF, whose name must end in .urdf",
                false => "",
            };
            let said = error.message().split_whitespace().collect::<Vec<_>>();
            let message = format!(
                "is not valid TOML: {}{hint}",
                shorten_to(&said.join(" "), 160)
            );
            self.refuse(at, "text", message)
        })?;
        Ok(parsed.into_inner())
    }

    /// The refusal of `place` at an offset.
    pub(super) fn refuse(
        &self,
        at: usize,
        place: impl Into<String>,
        message: impl Into<String>,
    ) -> MdhError {
        let (line, column) = position(self.text, at);
        MdhError::Invalid {
            file: self.file.to_owned(),
            line,
            column,
            place: place.into(),
            message: message.into(),
        }
    }
}

/// A table of the file: the top one, a `[base]`, a `[[joint]]`.
pub(super) struct Table<'s, 't, 'a> {
    pub(super) source: &'s Source<'a>,
    content: &'t DeTable<'a>,
    /// Where it starts \[bytes\].
    pub(super) at: usize,
    /// How sentences call it, e.g. `joint "elbow"`; empty for the top one.
    label: String,
}

type Value<'t, 'a> = &'t Spanned<DeValue<'a>>;

impl<'s, 't, 'a> Table<'s, 't, 'a> {
    /// Refuses keys beyond `known`: a misspelt one would silently count as not given.
    ///
    /// # Errors
    /// [`MdhError::Invalid`] at the first key in the file that is not known.
    pub(super) fn new(
        source: &'s Source<'a>,
        content: &'t DeTable<'a>,
        at: usize,
        label: impl Into<String>,
        known: &[&str],
    ) -> Result<Self, MdhError> {
        let table = Self {
            source,
            content,
            at,
            label: label.into(),
        };
        let unknown = content
            .keys()
            .filter(|key| !known.contains(&key.get_ref().as_ref()))
            .min_by_key(|key| key.span().start);
        let Some(key) = unknown else {
            return Ok(table);
        };
        let name = key.get_ref();
        let expected = match nearest(name, known) {
            Some(known) => format!("is {known} meant?"),
            None => format!("expected {}", known.join(", ")),
        };
        let place = table.place(&shorten(name));
        let message = format!("this key is not known; {expected}");
        Err(source.refuse(key.span().start, place, message))
    }

    /// `alpha of joint "elbow"`.
    pub(super) fn place(&self, key: &str) -> String {
        match (self.label.as_str(), key) {
            ("", key) => key.to_owned(),
            (label, "") => label.to_owned(),
            (label, key) => format!("{key} of {label}"),
        }
    }

    pub(super) fn relabel(&mut self, label: String) {
        self.label = label;
    }

    pub(super) fn has(&self, key: &str) -> bool {
        self.content.contains_key(key)
    }

    /// Where the value of `key` is, or the table.
    pub(super) fn at(&self, key: &str) -> usize {
        self.content
            .get(key)
            .map_or(self.at, |value| value.span().start)
    }

    /// The refusal of a key's value.
    pub(super) fn refuse(&self, key: &str, message: impl Into<String>) -> MdhError {
        self.source.refuse(self.at(key), self.place(key), message)
    }

    /// The refusal of what is not there; `mend` says how to write it.
    pub(super) fn missing(&self, key: &str, mend: &str) -> MdhError {
        self.refuse(key, format!("is missing; write {mend}"))
    }

    fn wrong(&self, key: &str, value: Value, expected: &str) -> MdhError {
        let message = format!("must be {expected}, found {}", describe(value.get_ref()));
        self.source
            .refuse(value.span().start, self.place(key), message)
    }

    /// A text.
    pub(super) fn text(&self, key: &str, expected: &str) -> Result<Option<&'t str>, MdhError> {
        let Some(value) = self.content.get(key) else {
            return Ok(None);
        };
        match value.get_ref() {
            DeValue::String(text) => Ok(Some(text)),
            _ => Err(self.wrong(key, value, expected)),
        }
    }

    /// A name on one line.
    pub(super) fn name(&self, key: &str) -> Result<Option<&'t str>, MdhError> {
        let Some(name) = self.text(key, "a name in quotes")? else {
            return Ok(None);
        };
        if name.trim().is_empty() || name.len() > MAX_NAME || name.chars().any(char::is_control) {
            let found = shorten(name);
            let message = format!(
                "must be a name of at most {MAX_NAME} bytes on one line, found \"{found}\""
            );
            return Err(self.refuse(key, message));
        }
        Ok(Some(name))
    }

    /// A finite number of moderate size.
    pub(super) fn number(&self, key: &str) -> Result<Option<f64>, MdhError> {
        let value = self.content.get(key);
        value
            .map(|value| self.finite(key, value, "a number"))
            .transpose()
    }

    fn finite(&self, key: &str, value: Value, expected: &str) -> Result<f64, MdhError> {
        let number = match value.get_ref() {
            DeValue::Integer(integer) if integer.radix() == 10 => integer.as_str().parse().ok(),
            DeValue::Float(float) => float.as_str().parse().ok(),
            _ => return Err(self.wrong(key, value, expected)),
        };
        let message = match number {
            Some(number) if f64::abs(number) <= MAX_MAGNITUDE => return Ok(number),
            Some(number) if f64::is_finite(number) => format!(
                "is {number:e}, expected at most {MAX_MAGNITUDE:e} in SI units; check the exponent"
            ),
            _ => format!(
                "must be a finite number, found {}",
                describe(value.get_ref())
            ),
        };
        Err(self
            .source
            .refuse(value.span().start, self.place(key), message))
    }

    /// Three finite numbers.
    pub(super) fn three(&self, key: &str) -> Result<Option<[f64; 3]>, MdhError> {
        let expected = "three numbers, written as [x, y, z]";
        let Some(value) = self.content.get(key) else {
            return Ok(None);
        };
        let list = match value.get_ref() {
            DeValue::Array(list) if list.len() == 3 => list,
            _ => return Err(self.wrong(key, value, expected)),
        };
        let mut numbers = [0.0; 3];
        for (number, value) in numbers.iter_mut().zip(list.iter()) {
            *number = self.finite(key, value, "three numbers")?;
        }
        Ok(Some(numbers))
    }

    /// A table inside this one, with `known` keys.
    pub(super) fn table(&self, key: &str, known: &[&str]) -> Result<Option<Self>, MdhError> {
        let Some(value) = self.content.get(key) else {
            return Ok(None);
        };
        let DeValue::Table(content) = value.get_ref() else {
            let expected = format!("a table of {}", known.join(", "));
            return Err(self.wrong(key, value, &expected));
        };
        let label = self.place(key);
        Self::new(self.source, content, value.span().start, label, known).map(Some)
    }

    /// The tables of `[[key]]`, with where they start.
    pub(super) fn tables(&self, key: &str) -> Result<Vec<(&'t DeTable<'a>, usize)>, MdhError> {
        let Some(value) = self.content.get(key) else {
            return Ok(Vec::new());
        };
        let expected = format!("a list of tables, each written as [[{key}]]");
        let DeValue::Array(list) = value.get_ref() else {
            return Err(self.wrong(key, value, &expected));
        };
        let table = |value: Value<'t, 'a>| match value.get_ref() {
            DeValue::Table(content) => Ok((content, value.span().start)),
            _ => Err(self.wrong(key, value, &expected)),
        };
        list.iter().map(table).collect()
    }
}

/// A value as a sentence calls it.
fn describe(value: &DeValue) -> String {
    match value {
        DeValue::String(text) => {
            format!("the text \"{}\"", shorten(text))
        }
        DeValue::Integer(integer) => shorten(&integer.to_string()),
        DeValue::Float(float) => shorten(float.as_str()),
        DeValue::Boolean(flag) => flag.to_string(),
        DeValue::Datetime(_) => "a date".to_owned(),
        DeValue::Array(list) => format!("a list of {}", list.len()),
        DeValue::Table(_) => "a table".to_owned(),
    }
}
