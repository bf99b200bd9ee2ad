//! States as JSON lines: one object per state, read straight into the frame.

use std::fmt;

use dynid_io::shorten_said;
use serde::de::{self, DeserializeSeed, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};

use super::Fault;
use crate::frame::{Frame, Names, Present, TEMPERATURE, TIME_NAMES};

/// The objects of a stream.
#[derive(Debug, Default)]
pub struct Objects {
    /// What the first object had; the others must have the same.
    first: Option<Present>,
    /// A line rewritten by [`nulls_for_nans`].
    rewritten: Vec<u8>,
}

impl Objects {
    /// Reads one object; unknown keys are ignored.
    ///
    /// # Errors
    /// [`Fault`] if it is not a JSON object, a key is missing or twice, or an array does not fit.
    pub fn parse(&mut self, line: &[u8], frame: &mut Frame) -> Result<(), Fault> {
        let line = if memchr::memchr2(b'N', b'I', line).is_some() {
            nulls_for_nans(line, &mut self.rewritten);
            &self.rewritten
        } else {
            line
        };
        let mut object = serde_json::Deserializer::from_slice(line);
        let present = Keys(frame)
            .deserialize(&mut object)
            .and_then(|present| object.end().map(|()| present))
            .map_err(|error| Fault::line(one_line(&error)))?;
        if !present.signals[0] {
            return Err(Fault::line("key \"q\" is missing, every state needs it"));
        }
        match self.first {
            None => {
                self.first = Some(present);
                frame.set_present(present);
                Ok(())
            }
            // A temperature may come and go: the answer's status says where it is missing.
            Some(first) if first.steady() == present.steady() => {
                frame.set_present(present);
                Ok(())
            }
            Some(first) => Err(Fault::line(difference(first, present, &frame.names()))),
        }
    }
}

/// A signal that comes or goes would change the torque without a word.
fn difference(first: Present, present: Present, names: &Names) -> String {
    let names = names.iter().map(|names| names[0]).chain([TIME_NAMES[0]]);
    let flags = |present: Present| present.signals.into_iter().chain([present.time]);
    let changed = names.zip(flags(first.steady()).zip(flags(present.steady())));
    for (name, (before, now)) in changed {
        if before && !now {
            return format!("key \"{name}\" is missing, the first state has it");
        }
        if now && !before {
            return format!("key \"{name}\" is new, the first state does not have it");
        }
    }
    String::new()
}

/// serde's words, which quote what came, cut to a short sentence; without its line number, which is always 1 here.
fn one_line(error: &serde_json::Error) -> String {
    let text = error.to_string();
    let text = text
        .rsplit_once(" at line 1 column ")
        .map_or(&*text, |(said, _)| said);
    if error.is_data() {
        shorten_said(text)
    } else {
        format!("not a JSON object (byte {}): {text}", error.column())
    }
}

/// `NaN`, `Infinity` and `-Infinity`, which Python writes and JSON does not know, become `null`. The answer to all of
/// them is the same.
fn nulls_for_nans(line: &[u8], out: &mut Vec<u8>) {
    out.clear();
    let (mut at, mut in_string) = (0, false);
    while let Some(byte) = line.get(at) {
        let rest = &line[at..];
        let constant = [&b"NaN"[..], b"Infinity", b"-Infinity"]
            .into_iter()
            .find(|constant| !in_string && rest.starts_with(constant));
        if let Some(constant) = constant {
            out.extend_from_slice(b"null");
            at += constant.len();
        } else if in_string && *byte == b'\\' {
            out.extend(rest.iter().take(2));
            at += 2;
        } else {
            in_string ^= *byte == b'"';
            out.push(*byte);
            at += 1;
        }
    }
}

/// What a key names.
enum Key {
    Time,
    Signal(usize),
    Unknown,
}

/// A key by these names.
struct Known(Names);

impl<'de> DeserializeSeed<'de> for Known {
    type Value = Key;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Key, D::Error> {
        deserializer.deserialize_identifier(self)
    }
}

impl Visitor<'_> for Known {
    type Value = Key;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a key")
    }

    fn visit_str<E>(self, text: &str) -> Result<Key, E> {
        if TIME_NAMES.contains(&text) {
            return Ok(Key::Time);
        }
        let signal = self.0.iter().position(|names| names.contains(&text));
        Ok(signal.map_or(Key::Unknown, Key::Signal))
    }
}

/// An object, read into the frame; says what it had.
struct Keys<'a>(&'a mut Frame);

impl<'de> DeserializeSeed<'de> for Keys<'_> {
    type Value = Present;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Present, D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for Keys<'_> {
    type Value = Present;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object such as {\"q\":[...],\"dq\":[...],\"ddq\":[...]}")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Present, A::Error> {
        let frame = self.0;
        let names = frame.names();
        let mut present = Present::default();
        frame.signal_mut(TEMPERATURE).fill(f64::NAN);
        while let Some(key) = map.next_key_seed(Known(names))? {
            let (name, seen) = match key {
                Key::Time => (TIME_NAMES[0], &mut present.time),
                Key::Signal(signal) if frame.wants(signal) => {
                    (names[signal][0], &mut present.signals[signal])
                }
                Key::Signal(_) | Key::Unknown => {
                    map.next_value::<IgnoredAny>()?;
                    continue;
                }
            };
            if std::mem::replace(seen, true) {
                return Err(de::Error::custom(format_args!("\"{name}\" is given twice")));
            }
            match key {
                Key::Signal(signal) => map.next_value_seed(Signal {
                    name,
                    values: frame.signal_mut(signal),
                })?,
                _ => frame.time = map.next_value_seed(Number { name, joint: None })?,
            }
        }
        Ok(present)
    }
}

/// An array with one number per joint.
struct Signal<'a> {
    name: &'static str,
    values: &'a mut [f64],
}

impl<'de> DeserializeSeed<'de> for Signal<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for Signal<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "\"{}\" to be an array of {} numbers",
            self.name,
            self.values.len()
        )
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<(), A::Error> {
        let (name, n) = (self.name, self.values.len());
        for (joint, value) in self.values.iter_mut().enumerate() {
            let number = Number {
                name,
                joint: Some(joint),
            };
            *value = seq.next_element_seed(number)?.ok_or_else(|| {
                de::Error::custom(format_args!("\"{name}\" has {joint} values, expected {n}"))
            })?;
        }
        match seq.next_element::<IgnoredAny>()? {
            None => Ok(()),
            Some(_) => Err(de::Error::custom(format_args!(
                "\"{name}\" has more than {n} values, expected {n}"
            ))),
        }
    }
}

/// A number, or null for one that is not there.
struct Number {
    name: &'static str,
    joint: Option<usize>,
}

impl<'de> DeserializeSeed<'de> for Number {
    type Value = f64;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<f64, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl Visitor<'_> for Number {
    type Value = f64;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.joint {
            Some(joint) => write!(f, "{}[{joint}] to be a number or null", self.name),
            None => write!(f, "\"{}\" to be a number or null", self.name),
        }
    }

    fn visit_f64<E>(self, value: f64) -> Result<f64, E> {
        Ok(value)
    }

    fn visit_u64<E>(self, value: u64) -> Result<f64, E> {
        Ok(value as f64)
    }

    fn visit_i64<E>(self, value: i64) -> Result<f64, E> {
        Ok(value as f64)
    }

    fn visit_unit<E>(self) -> Result<f64, E> {
        Ok(f64::NAN)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::TORQUE;

    fn parse(line: &str) -> Result<Frame, String> {
        let mut frame = Frame::new(2);
        Objects::default()
            .parse(line.as_bytes(), &mut frame)
            .map(|()| frame)
            .map_err(|fault| fault.to_string())
    }

    #[test]
    fn an_object_becomes_a_state() {
        let line = r#" {"q":[1,-2],"qd":[0.1,1e-3],"note":{"q":[9]},"ddq":[-0,null],"qm":[3.5,4],"time":2} "#;
        let frame = parse(line).unwrap();
        assert_eq!(frame.time, 2.0);
        let [q, dq, ddq, q_motor, dq_motor, _] = frame.sample().motion;
        assert_eq!(q, Some(&[1.0, -2.0][..]));
        assert_eq!(dq, Some(&[0.1, 0.001][..]));
        assert_eq!(ddq.unwrap()[0].to_bits(), (-0.0_f64).to_bits());
        assert!(ddq.unwrap()[1].is_nan());
        assert_eq!(q_motor, Some(&[3.5, 4.0][..]));
        assert_eq!(dq_motor, None);
    }

    #[test]
    fn constants_of_python_are_read_outside_of_strings_only() {
        let mut out = Vec::new();
        nulls_for_nans(
            br#"{"NaN\"NaN":[NaN,-Infinity, Infinity],"\\":NaN}"#,
            &mut out,
        );
        assert_eq!(out, br#"{"NaN\"NaN":[null,null, null],"\\":null}"#);
        nulls_for_nans(br#""\"#, &mut out);
        assert_eq!(out, br#""\"#);
        assert!(parse(r#"{"q":[NaN,1],"dq":[1,1],"ddq":[1,1]}"#)
            .unwrap()
            .sample()
            .motion[0]
            .is_some_and(|q| q[0].is_nan()));
    }

    #[test]
    fn objects_that_are_no_states_are_refused() {
        for (line, expected) in [
            (r#"{"dq":[1,2],"ddq":[1,2]}"#, "\"q\" is missing"),
            (r#"{"q":[1,2],"q":[1,2]}"#, "\"q\" is given twice"),
            (r#"{"t":1,"time":1}"#, "\"t\" is given twice"),
            (r#"{"q":[1]}"#, "\"q\" has 1 values, expected 2"),
            (r#"{"q":[1,2,3]}"#, "\"q\" has more than 2 values"),
            (
                r#"{"q":[1,"x"]}"#,
                "string \"x\", expected q[1] to be a number",
            ),
            (r#"{"q":null}"#, "\"q\" to be an array of 2 numbers"),
            (r#"{"t":"now"}"#, "\"t\" to be a number"),
            (r#"[1,2]"#, "expected an object such as"),
            (r#"{"q":[1,2"#, "not a JSON object (byte 9)"),
            (
                r#"{"q":[1,2],"dq":[1,2],"ddq":[1,2]}}"#,
                "trailing characters",
            ),
            (r#"{"q":[1,1e999]}"#, "number out of range"),
        ] {
            let sentence = parse(line).unwrap_err();
            assert!(sentence.contains(expected), "{line}: {sentence}");
            assert!(!sentence.contains("line 1"), "{sentence}");
        }
    }

    #[test]
    fn a_long_text_where_numbers_are_expected_makes_no_long_sentence() {
        let unseen = "\u{7f}".repeat(60_000);
        let sentence = parse(&format!(r#"{{"q":"{unseen}"}}"#)).unwrap_err();
        assert!(
            sentence.ends_with("\"q\" to be an array of 2 numbers"),
            "{sentence}"
        );
        assert!(sentence.len() < 200, "{} bytes", sentence.len());
    }

    #[test]
    fn a_temperature_may_come_and_go() {
        let mut objects = Objects::default();
        let mut frame = Frame::new(1).wanting(TEMPERATURE, true);
        let state = r#""q":[1],"dq":[1],"ddq":[1]"#;
        for (more, expected) in [
            (r#","temp":[30.5]"#, Some(30.5)),
            ("", None),
            (r#","temperature":[null]"#, None),
            (r#","temperature":[31]"#, Some(31.0)),
        ] {
            let line = format!("{{{state}{more}}}");
            objects.parse(line.as_bytes(), &mut frame).unwrap();
            let temperature = frame.sample().temperature.unwrap()[0];
            assert_eq!((!temperature.is_nan()).then_some(temperature), expected);
        }
        let line = format!("{{{state},\"temperature\":[1,2]}}");
        let fault = objects.parse(line.as_bytes(), &mut frame).unwrap_err();
        assert!(fault.to_string().contains("more than 1 values"));
        // A model that does not want it does not read it.
        let line = format!("{{{state},\"temperature\":\"hot\"}}");
        Objects::default()
            .parse(line.as_bytes(), &mut Frame::new(1))
            .unwrap();
    }

    #[test]
    fn what_is_measured_is_what_the_model_gives() {
        let line = br#"{"q":[1],"dq":[1],"ddq":[1],"tau":[3],"current":[4]}"#;
        for (unit, expected) in [("N*m", 3.0), ("A", 4.0)] {
            let mut frame = Frame::new(1).wanting(TORQUE, true).measured_in(unit);
            Objects::default().parse(line, &mut frame).unwrap();
            assert_eq!(frame.sample().tau, Some(&[expected][..]));
        }
    }

    #[test]
    fn the_signals_of_the_first_object_are_kept() {
        let mut objects = Objects::default();
        let mut frame = Frame::new(1);
        let mut parse = |line: &str| objects.parse(line.as_bytes(), &mut frame);
        parse(r#"{"q":[1],"dq":[1],"ddq":[1],"q_motor":[1]}"#).unwrap();
        let fault = parse(r#"{"q":[1],"dq":[1],"ddq":[1]}"#)
            .unwrap_err()
            .to_string();
        assert!(fault.contains("\"q_motor\" is missing, the first state has it"));
        let line = r#"{"q":[1],"dq":[1],"ddq":[1],"q_motor":[1],"t":1}"#;
        let fault = parse(line).unwrap_err().to_string();
        assert!(fault.contains("\"t\" is new"));
    }
}
