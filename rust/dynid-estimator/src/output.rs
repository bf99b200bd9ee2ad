//! Torques out: CSV or JSON lines, every number the shortest decimal that comes back bit for bit.

use std::io::{self, Write};

use dynid_core::adapt::{Adapted, Part};
use dynid_core::watch::{Change, Kind};
use dynid_core::{Status, TorqueModel};

use crate::args::Format;

/// One answer.
#[derive(Clone, Copy, Debug)]
pub struct Answer<'a> {
    /// Time of the state, if it has one; may be NaN \[s\].
    pub time: Option<f64>,
    /// Sum of the terms; finite.
    pub tau: &'a [f64],
    /// The terms, row-major by term; finite.
    pub terms: &'a [f64],
    /// Standard deviation expected of measured minus predicted torque; finite.
    pub std: &'a [f64],
    /// External torque, where an observer runs; finite.
    pub external: Option<&'a [f64]>,
    /// What a hand may guide the arm by, where it is asked for; finite.
    pub guide: Option<&'a [f64]>,
    /// What the watch has just said, where the model is watched.
    pub change: Option<&'a Change>,
    /// What is added to the model's torque, where something follows; `tau` has it. Finite.
    pub added: Option<&'a [f64]>,
    /// What the adaptation has just said.
    pub adapted: Option<&'a Adapted>,
    /// What was unusual.
    pub status: Status,
}

/// Writes answers of one model.
#[derive(Debug)]
pub struct Writer {
    format: Format,
    n_joints: usize,
    term_names: Vec<String>,
    observes: bool,
    guides: bool,
    adapts: bool,
}

impl Writer {
    /// A writer for answers of `model`: whether with external torques, with what a hand may guide the arm by, and with what is
    /// added.
    pub fn new(format: Format, model: &TorqueModel, [observes, guides, adapts]: [bool; 3]) -> Self {
        Self {
            format,
            n_joints: model.robot().n_joints(),
            term_names: model.term_names(),
            observes,
            guides,
            adapts,
        }
    }

    /// What comes before the first answer: the header of a CSV.
    pub fn begin(&self, with_time: bool, out: &mut impl Write) -> io::Result<()> {
        if self.format == Format::Jsonl {
            return Ok(());
        }
        if with_time {
            out.write_all(b"t,")?;
        }
        let terms = self.term_names.iter().map(String::as_str);
        for name in ["tau"]
            .into_iter()
            .chain(terms)
            .chain(["std"])
            .chain(self.observes.then_some("external"))
            .chain(self.guides.then_some("guide"))
            .chain(self.adapts.then_some("adaptation"))
        {
            for joint in 0..self.n_joints {
                write!(out, "{name}_{joint},")?;
            }
        }
        out.write_all(b"status\n")
    }

    /// One line.
    pub fn write(&self, answer: &Answer<'_>, out: &mut impl Write) -> io::Result<()> {
        match self.format {
            Format::Csv => self.write_csv(answer, out),
            Format::Jsonl => self.write_json(answer, out),
        }
    }

    fn write_csv(&self, answer: &Answer<'_>, out: &mut impl Write) -> io::Result<()> {
        match answer.time {
            Some(time) if time.is_nan() => out.write_all(b"nan,")?,
            Some(time) => write!(out, "{time:?},")?, // an infinity is written as inf
            None => {}
        }
        for torque in answer
            .tau
            .iter()
            .chain(answer.terms)
            .chain(answer.std)
            .chain(answer.external.unwrap_or(&[]))
            .chain(answer.guide.unwrap_or(&[]))
            .chain(answer.added.unwrap_or(&[]))
        {
            write!(out, "{torque:?},")?;
        }
        writeln!(out, "{}", answer.status.bits())
    }

    fn write_json(&self, answer: &Answer<'_>, out: &mut impl Write) -> io::Result<()> {
        out.write_all(b"{")?;
        match answer.time {
            Some(time) if time.is_finite() => write!(out, "\"t\":{time:?},")?,
            Some(_) => out.write_all(b"\"t\":null,")?,
            None => {}
        }
        out.write_all(b"\"tau\":")?;
        write_array(answer.tau, out)?;
        out.write_all(b",\"terms\":{")?;
        let terms = answer.terms.chunks_exact(self.n_joints);
        for (k, (name, term)) in self.term_names.iter().zip(terms).enumerate() {
            write!(out, "{}\"{name}\":", if k == 0 { "" } else { "," })?;
            write_array(term, out)?;
        }
        out.write_all(b"},\"std\":")?;
        write_array(answer.std, out)?;
        if let Some(external) = answer.external {
            out.write_all(b",\"external\":")?;
            write_array(external, out)?;
        }
        if let Some(guide) = answer.guide {
            out.write_all(b",\"guide\":")?;
            write_array(guide, out)?;
        }
        if let Some(added) = answer.added {
            out.write_all(b",\"adaptation\":")?;
            write_array(added, out)?;
        }
        if let Some(change) = answer.change {
            write_change(change, out)?;
        }
        if let Some(adapted) = answer.adapted {
            write_adapted(adapted, out)?;
        }
        writeln!(out, ",\"status\":{}}}", answer.status.bits())
    }
}

/// JSON has no infinities.
fn write_number(number: f64, out: &mut impl Write) -> io::Result<()> {
    if number.is_finite() {
        write!(out, "{number:?}")
    } else {
        out.write_all(b"null")
    }
}

fn write_change(change: &Change, out: &mut impl Write) -> io::Result<()> {
    let (kind, joint) = (change.kind.word(), change.joint);
    let said = change.said.word();
    write!(
        out,
        ",\"change\":{{\"kind\":\"{kind}\",\"joint\":{joint},\"size\":"
    )?;
    write_number(change.size, out)?;
    out.write_all(b",\"std\":")?;
    write_number(change.std, out)?;
    write!(out, ",\"said\":\"{said}\"")?;
    if change.kind == Kind::Load {
        out.write_all(b",\"moments\":")?;
        write_array(&change.moments, out)?;
    }
    if let Some((kind, joint)) = change.or {
        let kind = kind.word();
        write!(out, ",\"or\":{{\"kind\":\"{kind}\",\"joint\":{joint}}}")?;
    }
    out.write_all(b"}")
}

fn write_adapted(adapted: &Adapted, out: &mut impl Write) -> io::Result<()> {
    let (part, joint) = (adapted.part.word(), adapted.joint);
    write!(out, ",\"adapted\":{{\"part\":\"{part}\",\"joint\":{joint}")?;
    for (name, number) in [
        ("from", adapted.from),
        ("to", adapted.to),
        ("estimate", adapted.estimate),
        ("std", adapted.std),
    ] {
        write!(out, ",\"{name}\":")?;
        write_number(number, out)?;
    }
    if adapted.part == Part::Payload {
        out.write_all(b",\"moments\":")?;
        write_array(&adapted.moments, out)?;
    }
    write!(out, ",\"reason\":\"{}\"}}", adapted.reason.word())
}

fn write_array(numbers: &[f64], out: &mut impl Write) -> io::Result<()> {
    for (k, number) in numbers.iter().enumerate() {
        write!(out, "{}{number:?}", if k == 0 { '[' } else { ',' })?;
    }
    out.write_all(b"]")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::changes::tests::{adapted, change};
    use dynid_core::adapt::Reason;

    fn line(format: Format, time: Option<f64>, external: Option<&[f64]>) -> String {
        let writer = Writer {
            format,
            n_joints: 2,
            term_names: ["rigid_body", "friction", "friction2"]
                .map(str::to_owned)
                .to_vec(),
            observes: external.is_some(),
            guides: false,
            adapts: false,
        };
        let answer = Answer {
            time,
            tau: &[1.0, -0.0],
            terms: &[0.1, 1e-7, 1e22, 5e-324, -1.0, 2.0],
            std: &[0.5, 0.25],
            external,
            guide: None,
            change: None,
            added: None,
            adapted: None,
            status: Status::OUTSIDE_DOMAIN,
        };
        let mut out = Vec::new();
        writer.begin(time.is_some(), &mut out).unwrap();
        writer.write(&answer, &mut out).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn answers_look_as_documented() {
        assert_eq!(
            line(Format::Csv, Some(f64::NAN), Some(&[3.0, 4.0])),
            "t,tau_0,tau_1,rigid_body_0,rigid_body_1,friction_0,friction_1,friction2_0,friction2_1,std_0,std_1,external_0,external_1,status\n\
             nan,1.0,-0.0,0.1,1e-7,1e22,5e-324,-1.0,2.0,0.5,0.25,3.0,4.0,2\n"
        );
        assert_eq!(
            line(Format::Jsonl, Some(0.25), Some(&[3.0, 4.0])),
            "{\"t\":0.25,\"tau\":[1.0,-0.0],\"terms\":{\"rigid_body\":[0.1,1e-7],\"friction\":[1e22,5e-324],\
             \"friction2\":[-1.0,2.0]},\"std\":[0.5,0.25],\"external\":[3.0,4.0],\"status\":2}\n"
        );
        assert!(line(Format::Jsonl, Some(f64::INFINITY), None).starts_with("{\"t\":null,"));
        assert!(line(Format::Jsonl, None, None).starts_with("{\"tau\":"));
    }

    #[test]
    fn what_follows_looks_as_documented() {
        let mut out = Vec::new();
        write_adapted(&adapted(Part::Friction, Reason::Limit), &mut out).unwrap();
        assert_eq!(
            String::from_utf8(out).unwrap(),
            ",\"adapted\":{\"part\":\"friction\",\"joint\":0,\"from\":1.0,\"to\":1.05,\"estimate\":1.06,\"std\":0.01,\
             \"reason\":\"limit\"}"
        );
        let mut out = Vec::new();
        write_adapted(&adapted(Part::Payload, Reason::Reset), &mut out).unwrap();
        assert!(String::from_utf8(out)
            .unwrap()
            .contains("\"moments\":[0.0,0.0,0.0],\"reason\":\"reset\""));
    }

    #[test]
    fn changes_look_as_documented() {
        let told = |change: &Change| {
            let mut out = Vec::new();
            write_change(change, &mut out).unwrap();
            String::from_utf8(out).unwrap()
        };
        let friction = change(Kind::Friction, 0.25);
        assert_eq!(
            told(&friction),
            ",\"change\":{\"kind\":\"friction\",\"joint\":0,\"size\":0.25,\"std\":0.01,\"said\":\"named\"}"
        );
        assert!(told(&change(Kind::Unknown, f64::INFINITY)).contains("\"size\":null,\"std\":0.01"));
        let load = Change {
            or: Some((Kind::Gain, 1)),
            ..change(Kind::Load, 2.0)
        };
        assert_eq!(
            told(&load),
            ",\"change\":{\"kind\":\"load\",\"joint\":0,\"size\":2.0,\"std\":0.01,\"said\":\"named\",\
             \"moments\":[0.0,0.0,0.0],\"or\":{\"kind\":\"gain\",\"joint\":1}}"
        );
    }
}
