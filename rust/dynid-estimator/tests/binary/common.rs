//! A small model on disk, and the binary on it.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Arc;

use dynid_core::model::TorqueModelParts;
use dynid_core::{
    Domain, Effect, EffectTerm, GaussianMixtureRegression, Joint, JointKind, JointLimits, Residual,
    ResidualInputs, RobotModel, TorqueModel,
};
use nalgebra::{Matrix3, Rotation3, Vector3};
use tempfile::TempDir;

/// A valid header, without time.
pub const HEADER: &str = "q_0,q_1,dq_0,dq_1,ddq_0,ddq_1";

fn joint(name: &str, kind: JointKind) -> Joint {
    Joint {
        name: name.into(),
        link: format!("{name}_link"),
        kind,
        rotation: Rotation3::from_euler_angles(0.1, 0.2, 0.3).into_inner(),
        translation: Vector3::new(0.1, -0.2, 1.0 / 3.0),
        axis: Vector3::new(0.6, 0.0, 0.8),
        limits: JointLimits::default(),
        rotor_inertia: 0.25,
        gear_ratio: None,
        phi: [0.0; 10],
    }
}

/// Two joints, every effect, a residual on the deflection of the first joint, a channel delay.
pub fn model() -> TorqueModel {
    TorqueModel::new(parts()).unwrap()
}

pub fn parts() -> TorqueModelParts {
    let joints = vec![
        joint("shoulder", JointKind::Revolute),
        joint("slide", JointKind::Prismatic),
    ];
    let robot = RobotModel::new("arm".into(), joints, Vector3::new(0.0, 0.0, -9.81)).unwrap();
    let friction = Effect::friction(&[0.0, 0.05], &[0.01, 0.02]).unwrap();
    let covariance = (Matrix3::identity() * 0.5).as_slice().to_vec();
    let mixture =
        GaussianMixtureRegression::new(2, vec![1.0], vec![0.1, 0.2, 0.3], covariance).unwrap();
    TorqueModelParts {
        robot,
        phi: (0..20).map(|k| f64::from(k) / 7.0).collect(),
        torque_scale: vec![1.0, 0.8],
        effects: vec![
            EffectTerm::new(Effect::rotor_inertia(), vec![0.1, 0.2], 2).unwrap(),
            EffectTerm::new(Effect::torque_offset(), vec![-0.1, 0.2], 2).unwrap(),
            EffectTerm::new(friction, (0..16).map(f64::from).collect(), 2).unwrap(),
        ],
        residual: Some(
            Residual::new(ResidualInputs::Deflection, vec![Some(mixture.into()), None]).unwrap(),
        ),
        encoder_delay: vec![0.003, 0.0],
        noise_std: vec![0.5, 0.6],
        domain: Domain {
            q: vec![[-1.0, 1.0]; 2],
            dq: vec![2.0; 2],
            ddq: vec![3.0; 2],
        },
        torque_unit: "N*m".into(),
        step: None,
    }
}

/// The model in a folder of its own.
pub struct Saved {
    pub model: Arc<TorqueModel>,
    folder: TempDir,
}

impl Saved {
    pub fn new() -> Self {
        let saved = Self {
            model: Arc::new(model()),
            folder: tempfile::tempdir().unwrap(),
        };
        dynid_io::save(&saved.model, &saved.path()).unwrap();
        saved
    }

    pub fn path(&self) -> PathBuf {
        self.folder.path().join("model.json")
    }

    /// The binary on this model.
    pub fn run(&self, args: &[&str], input: impl AsRef<[u8]>) -> Answer {
        run(&self.path(), args, input.as_ref())
    }
}

/// What came back.
#[derive(Debug)]
pub struct Answer {
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
}

impl Answer {
    pub fn lines(&self) -> Vec<&str> {
        self.out.lines().collect()
    }

    /// Exit 2 and one sentence that has all the words, after notes at most.
    #[track_caller]
    pub fn refused(&self, words: &[&str]) {
        assert_eq!(self.code, Some(2), "{self:?}");
        let mut lines = self.err.lines();
        let sentence = lines.next_back().unwrap();
        assert!(lines.all(|line| line.starts_with("note: ")), "{self:?}");
        assert!(sentence.starts_with("error: "), "{sentence}");
        for word in words {
            assert!(sentence.contains(word), "{word:?} is not in {sentence:?}");
        }
    }

    /// Exit 0.
    #[track_caller]
    pub fn good(self) -> Self {
        assert_eq!(self.code, Some(0), "{self:?}");
        self
    }
}

impl From<Output> for Answer {
    fn from(output: Output) -> Self {
        Self {
            code: output.status.code(),
            out: String::from_utf8(output.stdout).unwrap(),
            err: String::from_utf8(output.stderr).unwrap(),
        }
    }
}

/// The program with signals as a shell gives them, also where the tests run under `nohup` or in the background.
pub fn command(args: &[&str]) -> Command {
    let program = env!("CARGO_BIN_EXE_dynid-estimator");
    let mut command = if cfg!(target_os = "linux") {
        let mut plain = Command::new("env");
        plain.arg("--default-signal=HUP,INT,TERM").arg(program);
        plain
    } else {
        Command::new(program)
    };
    command
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

pub fn run(model: &Path, args: &[&str], input: &[u8]) -> Answer {
    let mut child = command(args).arg(model).spawn().unwrap();
    let mut stdin = child.stdin.take().unwrap();
    let input = input.to_vec();
    // It may end before it has read everything; then the rest has nowhere to go.
    let writer = std::thread::spawn(move || drop(stdin.write_all(&input)));
    let output = child.wait_with_output().unwrap();
    writer.join().unwrap();
    output.into()
}
