//! States as CSV: a header that says which column is which signal of which joint, then rows.

use std::collections::HashMap;
use std::io::Read;

use dynid_core::online::N_MOTION;
use dynid_core::RobotModel;

use super::cells::{delimiter_of, number, Cells};
use super::{shown, Fault, Lines};
use crate::frame::{Frame, Names, Present, N_SIGNALS, TEMPERATURE, TIME_NAMES};
use crate::stop::Stop;

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Column {
    Ignored,
    Time,
    Value { signal: usize, joint: usize },
}

/// The columns of a stream.
#[derive(Debug)]
pub struct Columns {
    delimiter: u8,
    names: Vec<String>,
    columns: Vec<Column>,
}

impl Columns {
    /// Reads the header; comments (`#`) may stand before it. Where numbers follow a comment directly, the comment is the
    /// header, as numpy.savetxt writes it.
    ///
    /// # Errors
    /// [`Stop`] if the columns do not fit the robot.
    pub fn read<R: Read>(
        lines: &mut Lines<R>,
        robot: &RobotModel,
        frame: &mut Frame,
    ) -> Result<Self, Stop> {
        let mut comment = None;
        let header = loop {
            if !lines.advance()? {
                break comment.unwrap_or_default();
            }
            let line = lines.line();
            if let Some(text) = line.strip_prefix(b"#") {
                comment = Some(text.trim_ascii().to_vec());
                continue;
            }
            match comment {
                Some(comment) if starts_with_number(line, &comment) => {
                    lines.hold();
                    break comment;
                }
                _ => break line.to_vec(),
            }
        };
        let joints: Vec<&str> = robot.joints().iter().map(|joint| &*joint.name).collect();
        let (columns, present) =
            Self::from_header(&header, &joints, frame).map_err(|fault| lines.fault(&fault))?;
        frame.set_present(present);
        Ok(columns)
    }

    /// Columns of signals that are not wanted are ignored like any other.
    fn from_header(
        header: &[u8],
        joints: &[&str],
        frame: &Frame,
    ) -> Result<(Self, Present), Fault> {
        let delimiter = delimiter_of(header);
        let names = Cells::new(header, delimiter)
            .map(|cell| cell.map(|cell| String::from_utf8_lossy(cell).into_owned()))
            .collect::<Result<Vec<_>, _>>()
            .map_err(|_| Fault::line("a quote in the header is not closed"))?;
        if names.iter().all(|name| number(name.as_bytes()).is_some()) {
            return Err(Fault::line(format!(
                "found numbers, expected a header such as t,q_0,...,dq_0,...,ddq_0,... (found {})",
                shown(header)
            )));
        }
        let meanings = meanings(joints, frame);
        let columns = names
            .iter()
            .map(|name| match meanings.get(name.as_str()).map(Vec::as_slice) {
                None => Ok(Column::Ignored),
                Some([column]) => Ok(*column),
                Some(_) => Err(Fault::cell(
                    name,
                    "can mean two joints, because joints are named like numbers or signals; name the columns differently",
                )),
            })
            .collect::<Result<Vec<_>, _>>()?;
        refuse_twice(&names, &columns)?;
        let present = present(&columns, joints, &frame.names())?;
        refuse_more_joints(&names, &columns, (joints, &frame.names()))?;
        let columns = Self {
            delimiter,
            names,
            columns,
        };
        Ok((columns, present))
    }

    /// Reads one row; cells of ignored columns, and of signals that are not wanted yet, may hold anything.
    ///
    /// # Errors
    /// [`Fault`] if a cell is not a number or the number of cells is wrong.
    pub fn parse(&self, line: &[u8], frame: &mut Frame) -> Result<(), Fault> {
        let n_columns = self.columns.len();
        let mut n_cells = 0;
        for cell in Cells::new(line, self.delimiter) {
            let cell = cell.map_err(|_| Fault::line("a quote is not closed"))?;
            let column = self.columns.get(n_cells).ok_or_else(|| {
                Fault::line(format!(
                    "has more than {n_columns} cells, expected one for each column of the header"
                ))
            })?;
            let value = || number(cell).ok_or_else(|| self.no_number(n_cells, cell));
            match *column {
                Column::Ignored => {}
                Column::Value { signal, .. } if !frame.wants(signal) => {}
                Column::Time => frame.time = value()?,
                Column::Value { signal, joint } => *frame.value_mut(signal, joint) = value()?,
            }
            n_cells += 1;
        }
        match self.names.get(n_cells) {
            None => Ok(()),
            Some(name) => Err(Fault::cell(
                name,
                format!("missing: {n_cells} cells, expected {n_columns}; the line may be cut off"),
            )),
        }
    }

    fn no_number(&self, column: usize, cell: &[u8]) -> Fault {
        let sentence = if cell.is_empty() {
            "the cell is empty, expected a number (nan where there is none)".to_owned()
        } else {
            format!("found {}, expected a number", shown(cell))
        };
        Fault::cell(&self.names[column], sentence)
    }
}

fn starts_with_number(line: &[u8], header: &[u8]) -> bool {
    Cells::new(line, delimiter_of(header))
        .next()
        .and_then(Result::ok)
        .is_some_and(|cell| number(cell).is_some())
}

/// Every name that a column can have, with what it can mean.
fn meanings(joints: &[&str], frame: &Frame) -> HashMap<String, Vec<Column>> {
    let mut meanings: HashMap<String, Vec<Column>> = HashMap::new();
    let mut add = |name: String, column| {
        let known = meanings.entry(name).or_default();
        if !known.contains(&column) {
            known.push(column);
        }
    };
    for name in TIME_NAMES {
        add(name.to_owned(), Column::Time);
    }
    let mut add_all = |aliases: &[&str], column: &dyn Fn(usize) -> Column| {
        for alias in aliases {
            for (joint, joint_name) in joints.iter().enumerate() {
                add(format!("{alias}_{joint}"), column(joint));
                add(format!("{alias}_{joint_name}"), column(joint));
            }
        }
    };
    for (signal, aliases) in frame
        .names()
        .iter()
        .enumerate()
        .filter(|(signal, _)| frame.seeks(*signal))
    {
        add_all(aliases, &|joint| Column::Value { signal, joint });
    }
    meanings
}

fn refuse_twice(names: &[String], columns: &[Column]) -> Result<(), Fault> {
    let mut seen: HashMap<(usize, usize), &String> = HashMap::new();
    for (name, column) in names.iter().zip(columns) {
        let place = match *column {
            Column::Ignored => continue,
            Column::Time => (N_SIGNALS, 0),
            Column::Value { signal, joint } => (signal, joint),
        };
        if let Some(first) = seen.insert(place, name) {
            let sentence = format!(
                "repeats column {}, expected each signal once",
                shown(first.as_bytes())
            );
            return Err(Fault::cell(name, sentence));
        }
    }
    Ok(())
}

/// Which signals are there, for all joints.
fn present(columns: &[Column], joints: &[&str], names: &Names) -> Result<Present, Fault> {
    let mut present = Present {
        time: columns.contains(&Column::Time),
        ..Present::default()
    };
    for (signal, names) in names.iter().enumerate() {
        let has = |joint| columns.contains(&Column::Value { signal, joint });
        let n_there = (0..joints.len()).filter(|joint| has(*joint)).count();
        present.signals[signal] = n_there > 0;
        let Some(joint) = (0..joints.len()).find(|joint| !has(*joint)) else {
            continue;
        };
        // A temperature may be known of some joints only.
        if n_there > 0 && signal != TEMPERATURE || signal == 0 {
            let name = names[0];
            let reason = if signal == 0 {
                "every state needs q of every joint".to_owned()
            } else {
                format!("expected {name} for all joints or for none")
            };
            return Err(Fault::cell(
                &format!("{name}_{joint}"),
                format!(
                    "missing ({name} of joint {}); {reason}",
                    shown(joints[joint].as_bytes())
                ),
            ));
        }
    }
    Ok(present)
}

/// A column that continues the count of joints comes from another robot.
fn refuse_more_joints(
    names: &[String],
    columns: &[Column],
    (joints, of_signals): (&[&str], &Names),
) -> Result<(), Fault> {
    let counts_on = |name: &str| {
        let Some((signal, index)) = name.rsplit_once('_') else {
            return false;
        };
        let mut motion = of_signals.iter().take(N_MOTION);
        motion.any(|aliases| aliases.contains(&signal))
            && index
                .parse()
                .is_ok_and(|index: u64| index >= joints.len() as u64)
    };
    match names
        .iter()
        .zip(columns)
        .find(|(name, column)| **column == Column::Ignored && counts_on(name))
    {
        None => Ok(()),
        Some((name, _)) => Err(Fault::cell(
            name,
            format!(
                "the model has {} joints, counted from 0; expected states of the same robot",
                joints.len()
            ),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::TORQUE;

    const ARM: [&str; 2] = ["shoulder", "elbow"];

    fn fault(header: &str, joints: &[&str]) -> String {
        let frame = Frame::new(joints.len()).wanting(TEMPERATURE, true);
        Columns::from_header(header.as_bytes(), joints, &frame)
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn columns_are_found_by_index_name_and_alias() {
        let header = "tau_0,time,qd_elbow,q_0,qdd_0,q_elbow,dq_0,ddq_1,qm_0,q_motor_elbow,note,";
        let mut frame = Frame::new(2);
        let (columns, present) = Columns::from_header(header.as_bytes(), &ARM, &frame).unwrap();
        assert!(present.time);
        assert_eq!(
            present.signals,
            [true, true, true, true, false, false, false, false]
        );
        frame.set_present(present);
        columns
            .parse(b"x,7,11,0,20,1,10,21,30,31,\"a,b\",", &mut frame)
            .unwrap();
        assert_eq!(frame.time, 7.0);
        for (signal, expected) in [[0.0, 1.0], [10.0, 11.0], [20.0, 21.0], [30.0, 31.0]]
            .iter()
            .enumerate()
        {
            assert_eq!(frame.sample().motion[signal], Some(&expected[..]));
        }
        assert_eq!(frame.sample().motion[4], None);
    }

    #[test]
    fn names_with_two_meanings_are_refused() {
        let numbers = ["1", "2"];
        assert!(fault("q_0,q_1,dq_0,dq_1,ddq_0,ddq_1", &numbers).contains("can mean two joints"));
        assert!(fault("q_motor_0", &["motor_0", "b"]).contains("can mean two joints"));
        assert!(Columns::from_header(b"q_0,dq_0,ddq_0", &["0"], &Frame::new(1)).is_ok());
    }

    #[test]
    fn temperatures_are_read_where_they_are_wanted_and_may_be_missing() {
        let header = "q_0,q_1,dq_0,dq_1,ddq_0,ddq_1,temp_elbow,temperature_7";
        let row = b"0,0,0,0,0,0,41.5,hot";
        let mut frame = Frame::new(2);
        let (columns, present) = Columns::from_header(header.as_bytes(), &ARM, &frame).unwrap();
        assert!(!present.signals[TEMPERATURE]);
        columns.parse(row, &mut frame).unwrap();
        assert_eq!(frame.sample().temperature, None);
        let mut frame = Frame::new(2).wanting(TEMPERATURE, true);
        let (columns, present) = Columns::from_header(header.as_bytes(), &ARM, &frame).unwrap();
        assert!(present.signals[TEMPERATURE]);
        columns.parse(row, &mut frame).unwrap();
        let temperature = frame.sample().temperature.unwrap();
        assert!(temperature[0].is_nan());
        assert_eq!(temperature[1], 41.5);
        let valid = "q_0,q_1,dq_0,dq_1,ddq_0,ddq_1,temp_0";
        let twice = fault(&format!("{valid},temperature_shoulder"), &ARM);
        assert!(twice.contains("repeats column \"temp_0\""));
    }

    #[test]
    fn what_is_measured_is_what_the_model_gives() {
        let header = "q_0,dq_0,ddq_0,tau_0,current_0";
        for (unit, expected) in [("N*m", 3.0), ("A", 4.0)] {
            let mut frame = Frame::new(1).wanting(TORQUE, true).measured_in(unit);
            let (columns, present) =
                Columns::from_header(header.as_bytes(), &["elbow"], &frame).unwrap();
            frame.set_present(present);
            columns.parse(b"0,1,2,3,4", &mut frame).unwrap();
            assert_eq!(frame.sample().tau, Some(&[expected][..]));
        }
        let frame = Frame::new(1).wanting(TORQUE, true);
        let (_, present) =
            Columns::from_header(b"q_0,dq_0,ddq_0,current_0", &["elbow"], &frame).unwrap();
        assert!(!present.signals[TORQUE]);
    }

    #[test]
    fn headers_that_do_not_fit_are_refused() {
        let valid = "q_0,q_1,dq_0,dq_1,ddq_0,ddq_1";
        assert!(fault(&format!("{valid},q_0"), &ARM).contains("repeats column \"q_0\""));
        assert!(fault(&format!("{valid},q_shoulder"), &ARM).contains("repeats column \"q_0\""));
        assert!(fault(&format!("{valid},t,time"), &ARM).contains("repeats column \"t\""));
        assert!(fault(&format!("{valid},q_motor_0"), &ARM).contains("\"q_motor_1\": missing"));
        assert!(fault(&format!("{valid},q_2"), &ARM).contains("2 joints"));
        assert!(fault("dq_0,dq_1", &ARM).contains("\"q_0\": missing"));
        assert!(fault("q_0,q_1,dq_0", &ARM).contains("\"dq_1\": missing"));
        assert!(fault("0.1,0.2", &ARM).contains("found numbers"));
        assert!(fault("\"q_0,q_1", &ARM).contains("quote"));
    }
}
