//! `RobotModel` in Python.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use dynid_core::{
    inverse_dynamics_into, joint_torque_regressor_into, Joint, JointKind, RobotModel,
};
use dynid_io::mdh::{self, MdhOptions};
use dynid_io::model_file;
use dynid_io::urdf::{self, Loaded, PlacedLink, UrdfOptions};
use dynid_offline::{batch, OfflineError};
use numpy::PyArrayMethods;
use numpy::{PyArray1, PyArray2, PyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::base::PyBaseParameters;
use crate::lists::{optional, List};
use crate::{arrays, errors, small};

/// A serial robot: kinematics, gravity and declared inertial parameters. Immutable.
#[pyclass(name = "RobotModel", module = "dynid_rs._core", frozen)]
#[derive(Clone)]
pub struct PyRobotModel(pub Arc<RobotModel>, Arc<Said>);

/// What the reader of a robot file should know; empty for a robot that comes from elsewhere.
#[derive(Default)]
struct Said {
    choice: Option<String>,
    links: Vec<PlacedLink>,
    notes: Vec<String>,
}

impl From<RobotModel> for PyRobotModel {
    fn from(robot: RobotModel) -> Self {
        Self(Arc::new(robot), Arc::default())
    }
}

impl From<Loaded> for PyRobotModel {
    fn from(loaded: Loaded) -> Self {
        let Loaded {
            robot,
            choice,
            links,
            notes,
        } = loaded;
        let said = Said {
            choice,
            links,
            notes,
        };
        Self(Arc::new(robot), Arc::new(said))
    }
}

impl PyRobotModel {
    fn per_joint<'py>(
        &self,
        py: Python<'py>,
        value: impl Fn(&Joint) -> f64,
    ) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_iter(py, self.0.joints().iter().map(value))
    }
}

/// The joint that moves a link, and the link's rotation and translation in the frame of that joint's link.
pub type LinkFrame<'py> = (
    Option<usize>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
);

/// A function and its argument, as `pickle` wants them.
pub type Rebuild<'py> = (Bound<'py, PyAny>, (String,));

/// The robot of a text that `RobotModel.__reduce__` wrote.
#[pyfunction]
pub fn _robot_of(text: &str) -> PyResult<PyRobotModel> {
    let robot = model_file::robot_from_text(text, "<pickle>").map_err(errors::model_file)?;
    Ok(robot.into())
}

/// What to say of a batch that went wrong; which number was not finite is only looked for now.
fn said(error: OfflineError, signals: [(&str, &Bound<'_, PyAny>); 3], n: usize) -> PyErr {
    match (&error, arrays::samples(signals, n)) {
        (OfflineError::NonFinite { .. }, Err(place)) => place,
        _ => errors::offline(error),
    }
}

fn is_toml(path: &Path) -> bool {
    path.extension()
        .is_some_and(|suffix| suffix.eq_ignore_ascii_case("toml"))
}

fn options(
    base: Option<String>,
    tip: Option<String>,
    gravity: [f64; 3],
    rotor_inertia: Option<List<f64>>,
) -> UrdfOptions {
    UrdfOptions {
        base,
        tip,
        gravity,
        rotor_inertia: optional(rotor_inertia),
    }
}

#[pymethods]
impl PyRobotModel {
    #[staticmethod]
    #[pyo3(signature = (path, *, base=None, tip=None, gravity=[0.0, 0.0, -9.81], rotor_inertia=None))]
    fn from_urdf(
        py: Python<'_>,
        path: PathBuf,
        base: Option<String>,
        tip: Option<String>,
        gravity: [f64; 3],
        rotor_inertia: Option<List<f64>>,
    ) -> PyResult<Self> {
        let options = options(base, tip, gravity, rotor_inertia);
        let robot = py
            .detach(|| urdf::load_with_notes(&path, &options))
            .map_err(errors::urdf)?;
        Ok(robot.into())
    }

    #[staticmethod]
    #[pyo3(signature = (text, *, source_name="<string>", base=None, tip=None, gravity=[0.0, 0.0, -9.81], rotor_inertia=None))]
    fn from_urdf_string(
        py: Python<'_>,
        text: &str,
        source_name: &str,
        base: Option<String>,
        tip: Option<String>,
        gravity: [f64; 3],
        rotor_inertia: Option<List<f64>>,
    ) -> PyResult<Self> {
        let options = options(base, tip, gravity, rotor_inertia);
        let robot = py
            .detach(|| urdf::parse_with_notes(text, source_name, &options))
            .map_err(errors::urdf)?;
        Ok(robot.into())
    }

    #[staticmethod]
    #[pyo3(signature = (path, *, gravity=None, rotor_inertia=None))]
    fn from_mdh(
        py: Python<'_>,
        path: PathBuf,
        gravity: Option<[f64; 3]>,
        rotor_inertia: Option<List<f64>>,
    ) -> PyResult<Self> {
        let options = MdhOptions {
            gravity,
            rotor_inertia: optional(rotor_inertia),
        };
        let robot = py
            .detach(|| mdh::load(&path, &options))
            .map_err(errors::mdh)?;
        Ok(robot.into())
    }

    #[staticmethod]
    #[pyo3(signature = (text, *, source_name="<string>", gravity=None, rotor_inertia=None))]
    fn from_mdh_string(
        py: Python<'_>,
        text: &str,
        source_name: &str,
        gravity: Option<[f64; 3]>,
        rotor_inertia: Option<List<f64>>,
    ) -> PyResult<Self> {
        let options = MdhOptions {
            gravity,
            rotor_inertia: optional(rotor_inertia),
        };
        let robot = py
            .detach(|| mdh::parse(text, source_name, &options))
            .map_err(errors::mdh)?;
        Ok(robot.into())
    }

    /// A `.toml` is a table of modified Denavit-Hartenberg rows, anything else a URDF.
    #[staticmethod]
    #[pyo3(signature = (path, *, base=None, tip=None, gravity=None, rotor_inertia=None))]
    fn from_file(
        py: Python<'_>,
        path: PathBuf,
        base: Option<String>,
        tip: Option<String>,
        gravity: Option<[f64; 3]>,
        rotor_inertia: Option<List<f64>>,
    ) -> PyResult<Self> {
        if !is_toml(&path) {
            let gravity = gravity.unwrap_or(UrdfOptions::default().gravity);
            return Self::from_urdf(py, path, base, tip, gravity, rotor_inertia);
        }
        if base.is_some() || tip.is_some() {
            let name = if base.is_some() { "base" } else { "tip" };
            return Err(errors::value(format!(
                "{}: a robot.toml is one chain from its first row to its last; leave out {name}",
                path.display()
            )));
        }
        Self::from_mdh(py, path, gravity, rotor_inertia)
    }

    #[getter]
    fn name(&self) -> &str {
        self.0.name()
    }

    #[getter]
    fn n_joints(&self) -> usize {
        self.0.n_joints()
    }

    #[getter]
    fn n_links(&self) -> usize {
        self.0.n_joints()
    }

    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.0.joints().iter().map(|j| j.name.clone()).collect()
    }

    #[getter]
    fn link_names(&self) -> Vec<String> {
        self.0.joints().iter().map(|j| j.link.clone()).collect()
    }

    #[getter]
    fn joint_kinds(&self) -> Vec<&'static str> {
        self.0
            .joints()
            .iter()
            .map(|j| match j.kind {
                JointKind::Revolute => "revolute",
                JointKind::Prismatic => "prismatic",
            })
            .collect()
    }

    #[getter]
    fn choice(&self) -> Option<&str> {
        self.1.choice.as_deref()
    }

    #[getter]
    fn notes(&self) -> Vec<String> {
        self.1.notes.clone()
    }

    #[getter]
    fn gravity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.gravity().as_slice())
    }

    #[getter]
    fn phi<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.0.phi())
    }

    #[getter]
    fn rotor_inertia<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.per_joint(py, |j| j.rotor_inertia)
    }

    #[getter]
    fn gear_ratio<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.per_joint(py, |j| j.gear_ratio.unwrap_or(f64::NAN))
    }

    #[getter]
    fn lower<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.per_joint(py, |j| j.limits.lower)
    }

    #[getter]
    fn upper<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.per_joint(py, |j| j.limits.upper)
    }

    #[getter]
    fn velocity_limits<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.per_joint(py, |j| j.limits.velocity)
    }

    #[getter]
    fn acceleration_limits<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.per_joint(py, |j| j.limits.acceleration)
    }

    #[getter]
    fn effort_limits<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.per_joint(py, |j| j.limits.effort)
    }

    /// Where a link of the robot file stands in the link that carries it.
    fn link_frame<'py>(&self, py: Python<'py>, link: &str) -> PyResult<LinkFrame<'py>> {
        let links = &self.1.links;
        let Some(placed) = links.iter().find(|placed| placed.name == link) else {
            let names: Vec<&str> = links.iter().map(|placed| placed.name.as_str()).collect();
            let names = names.join(", ");
            return Err(errors::value(format!(
                "no link of the chain or fixed to it is named {link:?}; there are: {names}"
            )));
        };
        let rotation = placed.rotation.transpose(); // numpy reads rows first
        let rotation = PyArray1::from_slice(py, rotation.as_slice()).reshape([3, 3])?;
        let translation = PyArray1::from_slice(py, placed.translation.as_slice());
        Ok((placed.joint, rotation, translation))
    }

    fn with_gravity(&self, gravity: [f64; 3]) -> PyResult<Self> {
        let robot = self.0.with_gravity(gravity.into()).map_err(errors::core)?;
        Ok(Self(Arc::new(robot), Arc::clone(&self.1)))
    }

    fn with_joint_moved(
        &self,
        joint: usize,
        offset: [f64; 3],
        rotation_vector: [f64; 3],
    ) -> PyResult<Self> {
        let n_joints = self.0.n_joints();
        if joint >= n_joints {
            return Err(errors::value(format!(
                "there is no joint {joint}, the robot has {n_joints}, counted from 0"
            )));
        }
        let robot = self
            .0
            .with_joint_moved(joint, offset.into(), rotation_vector.into())
            .map_err(errors::core)?;
        Ok(robot.into())
    }

    #[pyo3(signature = (q, dq, ddq, phi=None, *, out=None))]
    fn inverse_dynamics<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
        phi: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let n = self.0.n_joints();
        if let (None, Some([q, dq, ddq])) = (phi, small::rows([q, dq, ddq], n)) {
            let [q, dq, ddq] = [&q, &dq, &ddq].map(small::Row::as_slice);
            return small::one_result(py, [1, n], out, |tau| {
                small::with_workspace(&self.0, |workspace, phi| {
                    inverse_dynamics_into(&self.0, workspace, q, dq, ddq, phi, tau)
                })
                .map_err(errors::core)
            });
        }
        let signals = [("q", q), ("dq", dq), ("ddq", ddq)];
        let [q, dq, ddq] = arrays::any_samples(signals, n)?;
        let phi = match phi {
            Some(phi) => arrays::vector(phi, "phi", Some(10 * n))?
                .as_slice()?
                .to_vec(),
            None => self.0.phi(),
        };
        let n_samples = q.shape()[0];
        let (q, dq, ddq) = (q.as_slice()?, dq.as_slice()?, ddq.as_slice()?);
        small::result(py, [n_samples, n], out, |tau| {
            let work = || batch::inverse_dynamics(&self.0, q, dq, ddq, &phi, tau);
            arrays::unlocked(py, n_samples, work).map_err(|error| said(error, signals, n))
        })
    }

    #[pyo3(signature = (q, dq, ddq, phi=None, *, out=None))]
    fn rnea<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
        phi: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.inverse_dynamics(py, q, dq, ddq, phi, out)
    }

    #[pyo3(signature = (q, dq, ddq, *, out=None))]
    fn joint_torque_regressor<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let n = self.0.n_joints();
        if let Some([q, dq, ddq]) = small::rows([q, dq, ddq], n) {
            let [q, dq, ddq] = [&q, &dq, &ddq].map(small::Row::as_slice);
            return small::one_result(py, [1, n, 10 * n], out, |regressor| {
                small::with_workspace(&self.0, |workspace, _| {
                    joint_torque_regressor_into(&self.0, workspace, q, dq, ddq, regressor)
                })
                .map_err(errors::core)
            });
        }
        let signals = [("q", q), ("dq", dq), ("ddq", ddq)];
        let [q, dq, ddq] = arrays::any_samples(signals, n)?;
        let n_samples = q.shape()[0];
        let (q, dq, ddq) = (q.as_slice()?, dq.as_slice()?, ddq.as_slice()?);
        small::result(py, [n_samples, n, 10 * n], out, |regressor| {
            let work = || batch::joint_torque_regressor(&self.0, q, dq, ddq, regressor);
            arrays::unlocked(py, n_samples, work).map_err(|error| said(error, signals, n))
        })
    }

    #[pyo3(signature = (random_state=0, rtol=1e-9))]
    fn base_parameters(
        &self,
        py: Python<'_>,
        random_state: u64,
        rtol: f64,
    ) -> PyResult<PyBaseParameters> {
        let base = py
            .detach(|| dynid_offline::base_parameters(&self.0, random_state, rtol))
            .map_err(errors::offline)?;
        Ok(PyBaseParameters::new(base, &self.0))
    }

    /// Name, gravity and joints as a model file holds them: copies in other processes are built from that text.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Rebuild<'py>> {
        let text =
            model_file::robot_to_text(&self.0).map_err(|error| errors::value(error.to_string()))?;
        Ok((py.import("dynid_rs._core")?.getattr("_robot_of")?, (text,)))
    }

    /// Immutable, so a copy is the robot itself.
    fn __copy__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __deepcopy__<'py>(slf: PyRef<'py, Self>, _memo: &Bound<'py, PyAny>) -> PyRef<'py, Self> {
        slf
    }

    fn __repr__(&self) -> String {
        format!(
            "RobotModel({:?}, n_joints={})",
            self.0.name(),
            self.0.n_joints()
        )
    }
}
