//! Cycles of a loop whose sender is this test: what they allocate, and that a rehearsal changes nothing.

use super::*;
use crate::counting;
use dynid_core::model::TorqueModelParts;
use dynid_core::watch::{Healthy, WatchSettings};
use dynid_core::{
    Domain, Effect, EffectTerm, GaussianMixtureRegression, Joint, JointKind, JointLimits,
    ObserverSettings, Residual, ResidualInputs, RobotModel, Status,
};
use dynid_io::WatchFile;
use nalgebra::{Matrix3, Vector3};

/// One joint with an effect that remembers and a residual; `factor` tells models apart.
pub fn model(factor: f64) -> Arc<TorqueModel> {
    let joint = Joint {
        name: "joint".into(),
        link: "link".into(),
        kind: JointKind::Revolute,
        rotation: Matrix3::identity(),
        translation: Vector3::zeros(),
        axis: Vector3::x(),
        limits: JointLimits::default(),
        rotor_inertia: 0.0,
        gear_ratio: None,
        phi: [1.0, 0.0, 0.1, 0.2, 0.1, 0.0, 0.1, 0.0, 0.0, 0.1],
    };
    let robot = RobotModel::new("arm".into(), vec![joint], Vector3::new(0.0, 0.0, -9.81));
    let robot = robot.unwrap();
    let hysteresis = Effect::new(
        "friction_hysteresis",
        &[("presliding_distance", vec![0.01])],
    )
    .unwrap();
    let covariance = (Matrix3::identity() * 0.5).as_slice().to_vec();
    let mixture = GaussianMixtureRegression::new(2, vec![1.0], vec![0.1, 0.2, 0.3], covariance);
    let mixture = mixture.unwrap().into();
    let parts = TorqueModelParts {
        phi: robot.phi().iter().map(|x| factor * x).collect(),
        robot,
        torque_scale: vec![1.0],
        effects: vec![EffectTerm::new(hysteresis, vec![factor], 1).unwrap()],
        residual: Some(Residual::new(ResidualInputs::JointState, vec![Some(mixture)]).unwrap()),
        encoder_delay: vec![0.0],
        noise_std: vec![0.1],
        domain: Domain {
            q: vec![[-3.0, 3.0]],
            dq: vec![3.0],
            ddq: vec![9.0],
        },
        torque_unit: "N*m".into(),
        step: None,
    };
    Arc::new(TorqueModel::new(parts).unwrap())
}

#[test]
fn cycles_allocate_nothing() {
    let settings = Settings {
        observer: Some(ObserverSettings::default()),
        watch: Some(Arc::new(WatchFile {
            joints: vec!["joint".to_owned()],
            settings: WatchSettings::default(),
            healthy: Healthy {
                frozen_after: vec![0.05],
                ..Healthy::untold(1)
            },
        })),
        ..Settings::default()
    };
    let model = model(1.0);
    let patience = Some(Duration::from_millis(2));
    for patience in [None, patience] {
        let udp = Udp::listen("127.0.0.1:0", patience, 1, MOST_TERMS).unwrap();
        let address = udp.address().unwrap();
        let sender = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
        sender.connect(address).unwrap();
        let mut cycle = Cycle::new(Arc::clone(&model), &settings).unwrap().warm();
        let mut live = Live::new(
            Link::Udp(udp),
            frame_for(&model, &settings, false),
            &cycle,
            &settings,
            MOST_TERMS,
        );
        live.outbox = Some(Outbox::open(&model));
        let mut good = wire::zero_state(1);
        let (mut buffer, mut seen) = ([0; 4096], Status::OK);
        let before = counting::calls();
        for k in 0..5000_u64 {
            good[16..24].copy_from_slice(&k.to_le_bytes());
            good[24..32].copy_from_slice(&(0.001 * k as f64).to_le_bytes());
            if k % 10 != 0 {
                sender
                    .send(&good[..if k % 7 == 0 { 20 } else { 56 }])
                    .unwrap();
            }
            live.rehearse(&cycle);
            live.cycle(&mut cycle, patience.is_none());
            seen = seen.and(cycle.answer(None).status);
            // A broken message is not answered where nothing else came.
            if k % 7 != 0 && k % 10 != 0 {
                sender.recv(&mut buffer).unwrap();
            }
        }
        assert_eq!(counting::calls() - before, 0);
        assert!(seen.contains(
            Status::REPEATED
                .and(Status::LOST)
                .and(Status::SIGNAL_MISSING)
        ));
        assert!(live.counts.refused > 500 && live.counts.states > 3000);
    }
    let before = counting::calls();
    drop(std::hint::black_box(vec![1.0; 100]));
    assert_eq!(counting::calls() - before, 2, "the counter counts");
}

/// A loop, its sender, and the model that comes later.
struct Rig {
    live: Live,
    cycle: Cycle,
    next: Cycle,
    sender: Option<std::net::UdpSocket>,
    _folder: tempfile::TempDir,
}

impl Rig {
    fn new(shared: bool, settings: &Settings) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (link, sender) = if shared {
            let memory = SharedMemory::create(&folder.path().join("slot"), 1, MOST_TERMS);
            (Link::Shm(memory.unwrap()), None)
        } else {
            let udp = Udp::listen("127.0.0.1:0", None, 1, MOST_TERMS).unwrap();
            let sender = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
            sender.connect(udp.address().unwrap()).unwrap();
            (Link::Udp(udp), Some(sender))
        };
        let (now, later) = (model(1.0), model(2.0));
        let cycle = Cycle::new(Arc::clone(&now), settings).unwrap();
        let mut live = Live::new(
            link,
            frame_for(&now, settings, false),
            &cycle,
            settings,
            MOST_TERMS,
        );
        live.inbox = Some(Inbox::empty());
        Self {
            live,
            cycle,
            next: Cycle::new(later, settings).unwrap(),
            sender,
            _folder: folder,
        }
    }

    fn send(&self, bytes: &[u8]) {
        match (&self.live.link, &self.sender) {
            (Link::Shm(memory), _) => memory.write_state(bytes),
            (_, Some(sender)) => drop(sender.send(bytes)),
            _ => {}
        }
    }

    /// Lays the other model ready; the one that ran is the other one then.
    fn offer(&self, k: u64) {
        let settings = Settings {
            window: Some(7),
            ..Settings::default()
        };
        let new = match k % 2 {
            0 => self.next.clone(),
            _ => Cycle::new(model(3.0), &settings).unwrap(),
        };
        self.live.inbox.as_ref().unwrap().offer(new);
    }

    fn rehearse(&mut self, times: u64) {
        for _ in 0..times {
            self.live.rehearse(&self.cycle);
        }
    }

    /// A cycle, and everything that it says.
    fn cycle(&mut self) -> (Status, Vec<u64>) {
        self.live.cycle(&mut self.cycle, true);
        let answer = self.cycle.answer(None);
        let external = answer.external.unwrap_or(&[]);
        let guide = answer.guide.unwrap_or(&[]);
        let said = [answer.tau, answer.std, answer.terms, external, guide];
        let mut bits: Vec<u64> = said.into_iter().flatten().map(|x| x.to_bits()).collect();
        bits.extend([self.live.counts.states, self.live.counts.refused]);
        bits.extend([
            self.live.frame.sequence.unwrap_or(0),
            self.live.frame.time.to_bits(),
        ]);
        (answer.status, bits)
    }
}

/// Bytes that come in cycle k, faults among them; none in some.
fn messages(k: u64, with_derivatives: bool) -> Vec<Vec<u8>> {
    let x = 0.01 * k as f64;
    let mut numbers = vec![x.sin(), x.cos(), -x.sin(), 3.0 * x.cos()];
    let mut sequence = k;
    match k % 37 {
        5 => numbers[0] = f64::NAN,
        9 => numbers[0] = 1e200,
        12 => sequence = k - 3,
        _ => {}
    }
    let mask: u8 = if with_derivatives {
        0b1000_0111
    } else {
        0b1000_0001
    };
    if !with_derivatives {
        numbers = vec![numbers[0], numbers[3]];
    }
    let mut bytes = wire::zero_state(1)[..wire::HEADER].to_vec();
    bytes[8] = mask;
    // A sender that began again in the middle.
    let sequence = if k > 900 { sequence - 900 } else { sequence };
    bytes[16..24].copy_from_slice(&sequence.to_le_bytes());
    bytes[24..32].copy_from_slice(&(0.001 * sequence as f64).to_le_bytes());
    numbers.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
    match k % 41 {
        3..=5 => vec![],
        8 => vec![bytes.clone(), bytes],
        15 => vec![b"no state".to_vec()],
        21 => vec![bytes.clone(), b"DYNS".to_vec(), bytes],
        _ => vec![bytes],
    }
}

#[test]
fn what_is_rehearsed_before_the_first_state_is_rest() {
    for shared in [false, true] {
        let mut rig = Rig::new(shared, &Settings::default());
        rig.rehearse(2);
        let live = &mut rig.live;
        assert_eq!(
            live.received[..live.newest],
            wire::zero_state(1),
            "{shared}"
        );
        // Gravity pulls at it, so it was computed.
        assert_ne!(live.rehearsal.twin().answer(None).tau, [0.0], "{shared}");
    }
}

/// Missed, doubled, broken and late input, a restarted sender, another model between two cycles and between a rehearsal and
/// its cycle: no answer depends on whether there was a rehearsal, or on how many.
#[test]
fn a_rehearsal_changes_no_bit() {
    for (shared, with_derivatives) in [(false, true), (false, false), (true, true), (true, false)] {
        let settings = Settings {
            window: Some(7),
            ..Settings::default()
        };
        let mut plain = Rig::new(shared, &settings);
        let mut rehearsed = Rig::new(shared, &settings);
        let (mut seen, mut foreseen) = (Status::OK, 0);
        for k in 0..2000 {
            let messages = messages(k, with_derivatives);
            // The state may come before the rehearsal or after it.
            rehearsed.rehearse(k % 3);
            let swaps = k % 97 == 50;
            if swaps && k % 2 == 0 {
                rehearsed.offer(k);
            }
            rehearsed.rehearse(k % 2);
            for message in &messages {
                plain.send(message);
                rehearsed.send(message);
            }
            rehearsed.rehearse(k % 5);
            if swaps {
                plain.offer(k);
                rehearsed.offer(k);
            }
            let expected = plain.cycle();
            // What was rehearsed is what came, with the model that ran.
            let twin = rehearsed.live.rehearsal.twin().answer(None).tau.to_vec();
            assert_eq!(rehearsed.cycle(), expected, "{k}, shared {shared}");
            let in_sight = shared && !swaps && k % 5 > 0;
            if in_sight && messages.len() == 1 && messages[0] != b"no state" {
                assert_eq!(twin, rehearsed.cycle.answer(None).tau, "{k}");
                foreseen += 1;
            }
            seen = seen.and(expected.0);
        }
        let all = [
            Status::NON_FINITE,
            Status::STALE,
            Status::LOST,
            Status::OUT_OF_ORDER,
            Status::REPEATED,
        ];
        assert!(
            all.into_iter().all(|status| seen.contains(status)),
            "{seen:?}"
        );
        assert_eq!(foreseen > 1000, shared);
        assert!(plain.live.counts.refused > 40 && plain.live.counts.states > 1500);
    }
}
