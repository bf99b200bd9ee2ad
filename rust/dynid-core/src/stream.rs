//! The place of a state in its stream: next, again, too late, with a clock that went back.

/// What a state is to the ones before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The next one, after `lost` that never came.
    Next {
        /// States that are missing between.
        lost: u64,
    },
    /// The first of a stream that begins again: the sender was restarted, or its clock was set.
    Restart,
    /// The one before once more.
    Repeated,
    /// Older than one that came already.
    OutOfOrder,
    /// Newer by its number, not by its time.
    TimeBackwards,
    /// Its time is no number, and the ones before had times.
    NoTime,
}

impl Place {
    /// True if a state at this place may be used.
    #[must_use]
    pub fn is_new(self) -> bool {
        matches!(self, Self::Next { .. } | Self::Restart)
    }
}

/// So many states in a row that contradict the one before them, but not each other, are a stream that begins again.
const RESTART_AFTER: u8 = 3;

/// Number and time of a state; NaN where it has no time.
type Mark = (Option<u64>, f64);

/// Remembers the newest state's place.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stream {
    newest: Option<Mark>,
    /// The last of a row of states that contradict `newest`, and how many they are.
    suspect: Option<(Mark, u8)>,
}

impl Stream {
    /// Judges a state by its number and its time \[s\] (NaN for none).
    ///
    /// Without numbers the transport keeps the order, so time that goes back is a new beginning at once.
    pub fn place(&mut self, sequence: Option<u64>, time: f64) -> Place {
        let mark = (sequence, time);
        let place = match self.newest {
            None => Place::Next { lost: 0 },
            Some(newest) => compare(newest, mark),
        };
        if place == Place::Repeated {
            return place;
        }
        if place.is_new() {
            self.newest = Some(mark);
            self.suspect = None;
            return place;
        }
        let row = match self.suspect {
            Some((before, row)) if compare(before, mark).is_new() => row.saturating_add(1),
            Some((before, row)) if compare(before, mark) == Place::Repeated => row,
            _ => 1,
        };
        if row >= RESTART_AFTER {
            self.newest = Some(mark);
            self.suspect = None;
            return Place::Restart;
        }
        self.suspect = Some((mark, row));
        place
    }

    /// Length of the row of states, up to the last one, that contradict the newest good one but not each other.
    #[must_use]
    pub fn suspects(&self) -> u8 {
        self.suspect.map_or(0, |(_, row)| row)
    }
}

fn compare((number, time): Mark, (next_number, next_time): Mark) -> Place {
    let (Some(number), Some(next_number)) = (number, next_number) else {
        return if next_time <= time {
            Place::Restart
        } else {
            Place::Next { lost: 0 }
        };
    };
    // Numbers wrap around.
    match next_number.wrapping_sub(number) {
        0 => Place::Repeated,
        ahead if ahead > u64::MAX / 2 => Place::OutOfOrder,
        _ if next_time <= time => Place::TimeBackwards,
        _ if next_time.is_nan() != time.is_nan() => Place::NoTime,
        ahead => Place::Next { lost: ahead - 1 },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(marks: &[(u64, f64)]) -> Vec<Place> {
        let mut stream = Stream::default();
        let marks = marks.iter();
        marks
            .map(|(number, time)| stream.place(Some(*number), *time))
            .collect()
    }

    const NEXT: Place = Place::Next { lost: 0 };

    #[test]
    fn faults_are_told_apart_and_pass() {
        use Place::{NoTime, OutOfOrder, Repeated, TimeBackwards};
        let found = places(&[
            (7, 0.0),
            (8, 0.1),
            (8, 0.1),
            (11, 0.4),
            (10, 0.3),
            (12, 0.4),
            (13, 0.6),
            (14, f64::NAN),
            (15, 0.8),
        ]);
        let lost = |lost| Place::Next { lost };
        let expected = [
            NEXT,
            NEXT,
            Repeated,
            lost(2),
            OutOfOrder,
            TimeBackwards,
            lost(1),
            NoTime,
            lost(1),
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn a_sender_that_was_restarted_is_believed_at_its_third_word() {
        use Place::{OutOfOrder, Restart, TimeBackwards};
        let found = places(&[(1000, 5.0), (0, 0.0), (1, 0.1), (2, 0.2), (3, 0.3)]);
        assert_eq!(found, [NEXT, OutOfOrder, OutOfOrder, Restart, NEXT]);
        let found = places(&[(1, 1e9), (2, 0.2), (3, 0.3), (3, 0.3), (4, 0.4), (5, 0.5)]);
        assert_eq!(
            found,
            [
                NEXT,
                TimeBackwards,
                TimeBackwards,
                TimeBackwards,
                Restart,
                NEXT
            ]
        );
        // Strays that contradict each other are no stream.
        let found = places(&[(1000, 5.0), (900, 4.0), (800, 3.0), (700, 2.0), (600, 1.0)]);
        assert_eq!(found[1..], [OutOfOrder; 4]);
    }

    #[test]
    fn numbers_wrap_around() {
        let found = places(&[(u64::MAX, 0.0), (0, 0.1), (u64::MAX, 0.0), (2, 0.2)]);
        assert_eq!(
            found,
            [NEXT, NEXT, Place::OutOfOrder, Place::Next { lost: 1 }]
        );
    }

    #[test]
    fn without_numbers_time_that_goes_back_is_a_beginning() {
        let mut stream = Stream::default();
        let found = [1.0, 1.1, 0.0, 0.1, f64::NAN, 0.2].map(|time| stream.place(None, time));
        assert_eq!(found, [NEXT, NEXT, Place::Restart, NEXT, NEXT, NEXT]);
    }
}
