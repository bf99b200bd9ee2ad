//! Measurements and answers as bytes, the same in a datagram and in shared memory: fixed places, little-endian, 8-byte
//! aligned. `docs/how_to/online.md` is the description for others; `decode` and `encode` here are the only code.
//!
//! ```text
//! state                                answer
//!  0  "DYNS"                            0  "DYNT"
//!  4  u16  version, 1                   4  u16  version, 1
//!  6  u16  n_joints                     6  u16  n_joints
//!  8  u32  signals that follow, bits    8  u32  status, bits
//! 12  u32  0                           12  u16  n_terms, u16 parts that follow, bits
//! 16  u64  sequence                    16  u64  sequence of the newest state
//! 24  f64  time                        24  f64  time of that state
//! 32  f64  signal by signal, joint     32  f64  tau, std, then what the parts say, then the terms
//! ```

use crate::frame::{Frame, Present, N_SIGNALS};
use crate::output::Answer;

/// First bytes of a state and of an answer.
pub const STATE_MAGIC: [u8; 4] = *b"DYNS";
const ANSWER_MAGIC: [u8; 4] = *b"DYNT";

/// Version of both.
pub const VERSION: u16 = 1;

/// Bytes before the numbers.
pub const HEADER: usize = 32;

/// A state of rest: q, dq and ddq of zeros.
pub fn zero_state(n_joints: usize) -> Vec<u8> {
    let mut bytes = vec![0; HEADER + 3 * 8 * n_joints];
    let [version, n] = [VERSION, n_joints as u16].map(u16::to_le_bytes);
    let head = STATE_MAGIC
        .into_iter()
        .chain(version)
        .chain(n)
        .chain([0b111]);
    for (byte, of_head) in bytes.iter_mut().zip(head) {
        *byte = of_head;
    }
    bytes
}

/// Why bytes are no state of this robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoState;

/// Most bytes of a state of `n_joints` joints.
pub fn most_state_bytes(n_joints: usize) -> usize {
    HEADER + 8 * N_SIGNALS * n_joints
}

/// Bytes that every answer fits in, external torques and what a hand may guide the arm by included.
pub fn answer_bytes(n_joints: usize, n_terms: usize) -> usize {
    HEADER + 8 * n_joints * (4 + n_terms)
}

fn array<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..at + N)?.try_into().ok()
}

/// Reads a state into the frame, which stays as it was where the bytes are none. Signals that nobody wants are passed over.
///
/// # Errors
/// [`NoState`] for another magic, version, robot or length, for signals that there are not, and without q.
pub fn decode(bytes: &[u8], n_joints: usize, frame: &mut Frame) -> Result<(), NoState> {
    read(bytes, n_joints, frame).ok_or(NoState)
}

fn read(bytes: &[u8], n_joints: usize, frame: &mut Frame) -> Option<()> {
    let good_head = array(bytes, 0)? == STATE_MAGIC
        && u16::from_le_bytes(array(bytes, 4)?) == VERSION
        && usize::from(u16::from_le_bytes(array(bytes, 6)?)) == n_joints;
    let signals = u32::from_le_bytes(array(bytes, 8)?);
    let sequence = u64::from_le_bytes(array(bytes, 16)?);
    let time = f64::from_le_bytes(array(bytes, 24)?);
    let numbers = bytes.get(HEADER..)?;
    let known = signals >> N_SIGNALS == 0 && signals & 1 == 1;
    let length = signals.count_ones() as usize * n_joints * 8;
    if !(good_head && known && numbers.len() == length) {
        return None;
    }
    let mut rows = numbers.chunks_exact((8 * n_joints).max(1));
    let mut present = Present {
        time: !time.is_nan(),
        ..Present::default()
    };
    for signal in 0..N_SIGNALS {
        let there = signals >> signal & 1 == 1;
        let wanted = frame.wants(signal);
        let values = frame.signal_mut(signal);
        if !there {
            values.fill(f64::NAN);
            continue;
        }
        let row = rows.next()?.as_chunks::<8>().0;
        for (value, bytes) in values.iter_mut().zip(row) {
            *value = f64::from_le_bytes(*bytes);
        }
        present.signals[signal] = wanted;
    }
    frame.sequence = Some(sequence);
    frame.time = time;
    frame.set_present(present);
    Some(())
}

/// Writes an answer to the front of `out` ([`answer_bytes`] long at least) and says how many bytes it has; zero where `out`
/// is too short.
pub fn encode(answer: &Answer<'_>, sequence: u64, out: &mut [u8]) -> usize {
    let n = answer.tau.len();
    let n_terms = answer.terms.len() / n.max(1);
    let external = answer.external.unwrap_or(&[]);
    let guide = answer.guide.unwrap_or(&[]);
    let parts = [answer.tau, answer.std, external, guide, answer.terms];
    let said = u16::from(!external.is_empty()) | u16::from(!guide.is_empty()) << 1;
    let length = HEADER + 8 * parts.iter().map(|part| part.len()).sum::<usize>();
    let Some(out) = out.get_mut(..length) else {
        return 0;
    };
    let (head, numbers) = out.split_at_mut(HEADER);
    let head_words: [[u8; 8]; 4] = [
        word(ANSWER_MAGIC, [VERSION, n as u16]),
        word(answer.status.bits().to_le_bytes(), [n_terms as u16, said]),
        sequence.to_le_bytes(),
        answer.time.unwrap_or(f64::NAN).to_le_bytes(),
    ];
    for (bytes, word) in head.as_chunks_mut::<8>().0.iter_mut().zip(head_words) {
        *bytes = word;
    }
    let values = parts.into_iter().flatten();
    for (bytes, value) in numbers.as_chunks_mut::<8>().0.iter_mut().zip(values) {
        *bytes = value.to_le_bytes();
    }
    length
}

/// Four bytes and two numbers of two.
fn word([a, b, c, d]: [u8; 4], [x, y]: [u16; 2]) -> [u8; 8] {
    let ([e, f], [g, h]) = (x.to_le_bytes(), y.to_le_bytes());
    [a, b, c, d, e, f, g, h]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{TEMPERATURE, TORQUE};
    use dynid_core::Status;

    /// A state of `n` joints with the signals of a mask; value k of signal s is s + k / 10.
    fn state(n: u16, mask: u32) -> Vec<u8> {
        let mut bytes = [&STATE_MAGIC[..], &VERSION.to_le_bytes(), &n.to_le_bytes()].concat();
        bytes.extend(mask.to_le_bytes());
        bytes.extend([0; 4]);
        bytes.extend(7_u64.to_le_bytes());
        bytes.extend(0.25_f64.to_le_bytes());
        for signal in (0..32).filter(|signal| mask >> signal & 1 == 1) {
            for k in 0..n {
                bytes.extend((f64::from(signal) + f64::from(k) / 10.0).to_le_bytes());
            }
        }
        bytes
    }

    #[test]
    fn a_state_of_rest_is_one() {
        let mut frame = Frame::new(3);
        decode(&zero_state(3), 3, &mut frame).unwrap();
        let motion = frame.sample().motion;
        assert_eq!(
            motion.map(|signal| signal.is_some()),
            [true, true, true, false, false, false]
        );
        assert_eq!(motion[2], Some(&[0.0; 3][..]));
    }

    #[test]
    fn a_state_is_read_from_its_places() {
        let mut frame = Frame::new(2).wanting(TORQUE, true);
        decode(&state(2, 0b1100_1011), 2, &mut frame).unwrap();
        let sample = frame.sample();
        assert_eq!((sample.sequence, sample.time), (Some(7), 0.25));
        let there = sample.motion.map(|signal| signal.map(|values| values[1]));
        assert_eq!(there, [Some(0.1), Some(1.1), None, Some(3.1), None, None]);
        assert_eq!(sample.tau, Some(&[7.0, 7.1][..]));
        assert_eq!(sample.temperature, None, "nobody wants it");
        let mut frame = Frame::new(2).wanting(TEMPERATURE, true);
        decode(&state(2, 0b100_0111), 2, &mut frame).unwrap();
        assert_eq!(frame.sample().temperature, Some(&[6.0, 6.1][..]));
        assert_eq!(frame.sample().tau, None);
        // The next one has none, and the old one is not taken for it.
        decode(&state(2, 0b111), 2, &mut frame).unwrap();
        assert!(frame.sample().temperature.is_some_and(|t| t[0].is_nan()));
    }

    #[test]
    fn what_is_no_state_changes_nothing() {
        let good = state(2, 0b111);
        let mut frame = Frame::new(2);
        decode(&good, 2, &mut frame).unwrap();
        let before = format!("{frame:?}");
        let mut spoiled: Vec<Vec<u8>> = (0..good.len()).map(|n| good[..n].to_vec()).collect();
        spoiled.push([&good[..], &[0]].concat());
        for at in [0, 3, 4, 6, 8, 9, 10, 11] {
            let mut bytes = good.clone();
            bytes[at] ^= 0x41;
            spoiled.push(bytes);
        }
        spoiled.extend([
            state(3, 0b111),
            state(2, 0b110),
            state(2, 0b1_0000_0111),
            state(1, 1),
        ]);
        for bytes in spoiled {
            assert_eq!(decode(&bytes, 2, &mut frame), Err(NoState), "{bytes:?}");
            assert_eq!(format!("{frame:?}"), before);
        }
    }

    #[test]
    fn an_answer_is_written_to_its_places() {
        let answer = Answer {
            time: Some(0.5),
            tau: &[1.0, 2.0],
            terms: &[3.0, 4.0, 5.0, 6.0],
            std: &[7.0, 8.0],
            external: Some(&[9.0, 10.0]),
            guide: Some(&[0.5, 0.0]),
            change: None,
            added: None,
            adapted: None,
            status: Status::STALE,
        };
        let mut out = [0; 200];
        let length = encode(&answer, 42, &mut out);
        assert_eq!(length, answer_bytes(2, 2));
        assert_eq!(out[..8], *b"DYNT\x01\0\x02\0");
        assert_eq!(out[8..16], [128, 0, 0, 0, 2, 0, 3, 0]);
        assert_eq!(out[16..24], 42_u64.to_le_bytes());
        let numbers: Vec<f64> = out[24..length]
            .chunks_exact(8)
            .map(|bytes| f64::from_le_bytes(bytes.try_into().unwrap()))
            .collect();
        assert_eq!(
            numbers,
            [0.5, 1.0, 2.0, 7.0, 8.0, 9.0, 10.0, 0.5, 0.0, 3.0, 4.0, 5.0, 6.0]
        );
        assert_eq!(encode(&answer, 42, &mut out[..length - 1]), 0);
        let unguided = Answer {
            guide: None,
            ..answer
        };
        assert_eq!(encode(&unguided, 42, &mut out), length - 16);
        assert_eq!(out[12..16], [2, 0, 1, 0]);
        let without = Answer {
            external: None,
            ..unguided
        };
        assert_eq!(encode(&without, 42, &mut out), length - 32);
        assert_eq!(out[12..16], [2, 0, 0, 0]);
    }

    /// The bytes of a linear congruential generator; `DYNID_FUZZ` says how many frames (default two hundred thousand).
    #[test]
    fn no_bytes_do_harm() {
        let count = std::env::var("DYNID_FUZZ").map_or(200_000, |n| n.parse::<u64>().unwrap());
        let mut seed = 1_u64;
        let mut next = move || {
            seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            seed >> 33
        };
        let mut frame = Frame::new(2)
            .wanting(TEMPERATURE, true)
            .wanting(TORQUE, true);
        let mut buffer = state(2, 0xff);
        let full = buffer.len();
        let mut good = 0_u64;
        for k in 0..count {
            // Some frames are noise, most are good ones with a few bytes changed, cut or drawn out.
            buffer.clear();
            buffer.extend_from_slice(&state(2, (next() % 512) as u32 | 1));
            for _ in 0..next() % 4 {
                let at = next() as usize % buffer.len();
                buffer[at] = next() as u8;
            }
            match next() % 8 {
                0 => buffer.truncate(next() as usize % (buffer.len() + 1)),
                1 => buffer.resize(buffer.len() + next() as usize % 64, next() as u8),
                2 => buffer.iter_mut().for_each(|byte| *byte = next() as u8),
                _ => {}
            }
            if decode(&buffer, 2, &mut frame).is_ok() {
                good += 1;
                let sample = frame.sample();
                assert!(sample.motion[0].is_some() && buffer.len() <= full, "{k}");
            }
        }
        println!("{count} frames, {good} of them states");
        assert!(good > count / 100 && good < count);
    }
}
