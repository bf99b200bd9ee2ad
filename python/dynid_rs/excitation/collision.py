"""Self-collision by the collision shapes of a URDF: Pinocchio and coal, the extra ``[collision]``."""

from __future__ import annotations

import hashlib
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from dynid_rs.base.errors import DataError, MissingLibraryError
from dynid_rs.base.files import check_readable
from dynid_rs.base.quoting import shown_value
from dynid_rs.excitation.constraints import Motion, StartError
from dynid_rs.excitation.workspace import SHARPNESS
from dynid_rs.model.robot_file import XACRO, is_mjcf

if TYPE_CHECKING:
    from dynid_rs._core import RobotModel

FloatArray = NDArray[np.float64]

NEGLIGIBLE = 1e-6
"""Weight in the smooth minimum below which a pair's slope is left out."""


@dataclass(frozen=True)
class SelfCollision:
    """Links keep a distance from each other.

    Links that a single joint connects are not asked; they touch by design.

    Parameters
    ----------
    urdf : str or path-like
        Robot with ``<collision>`` shapes; joints by the names of the robot model, all others stay at zero.
    margin : float
        Least distance [m].
    ignored : tuple of (str, str)
        Pairs of links that may touch.
    package_dirs : tuple of str
        Where ``package://`` meshes are.
    """

    urdf: str | Path
    margin: float = 0.02
    ignored: tuple[tuple[str, str], ...] = ()
    package_dirs: tuple[str, ...] = ()

    def bind(self, robot: RobotModel, start: FloatArray) -> BoundCollision:
        """Load the shapes and return the constraint of `robot`.

        Raises
        ------
        MissingLibraryError
            Pinocchio is not installed.
        DataError
            The file has no shapes, or they cannot be loaded; a joint or link is not in it.
        ValueError
            Two links are closer than the margin at the start.
        """
        try:
            import pinocchio
        except ImportError:
            raise MissingLibraryError("pinocchio", "collision", "checks for self-collision") from None
        path = check_readable(self.urdf)
        if path.suffix.lower() in (".toml", XACRO) or is_mjcf(path):
            raise DataError(
                f"{path}: self-collision needs the collision shapes of a URDF, and this is none; leave the check for "
                "self-collision out, or give the arm as a URDF",
                code="collision_shapes",
                file=str(path),
            )
        if not (np.isfinite(self.margin) and self.margin >= 0):
            raise ValueError(f"the margin of self-collision must be a distance in m of at least 0, got {self.margin}")
        try:
            model = pinocchio.buildModelFromUrdf(str(path))
            shapes = pinocchio.buildGeomFromUrdf(
                model, str(path), pinocchio.GeometryType.COLLISION, package_dirs=list(self.package_dirs)
            )
        except ValueError as error:
            text = " ".join(str(error).split())
            raise DataError(
                f"{path}: its collision shapes cannot be loaded ({text}); check the paths of its meshes",
                code="collision_shapes",
                file=str(path),
            ) from None
        _refuse_lost_shapes(path, shapes)
        return BoundCollision(pinocchio, model, shapes, self, robot, start)


def _refuse_lost_shapes(path: Path, shapes: Any) -> None:
    """Refuse a file of which Pinocchio leaves shapes out: it says so on the terminal only."""
    n_loaded = len(shapes.geometryObjects)
    declared = sum(1 for _ in ElementTree.parse(path).getroot().iter("collision"))
    if n_loaded < declared:
        raise DataError(
            f"{path}: {declared} collision shapes are declared and {n_loaded} can be used; "
            "boxes, spheres, cylinders and meshes can, so replace the others",
            code="collision_shapes",
            file=str(path),
        )


class BoundCollision:
    """`SelfCollision` of one robot; made by `SelfCollision.bind`."""

    name = "self-collision"
    stride = 3
    fine_step = 1e-2

    def __init__(
        self, pinocchio: Any, model: Any, shapes: Any, wanted: SelfCollision, robot: RobotModel, start: FloatArray
    ) -> None:
        self._pin, self._model, self._shapes, self._wanted = pinocchio, model, shapes, wanted
        self._thread = threading.local()
        missing = [name for name in robot.joint_names if not model.existJointName(name)]
        if missing:
            raise DataError(
                f"{wanted.urdf}: has no joint {missing[0]!r} of the robot model; name the file that it was read from",
                code="collision_shapes",
                file=str(wanted.urdf),
            )
        joints = [model.joints[model.getJointId(name)] for name in robot.joint_names]
        self._columns = [joint.idx_v for joint in joints]
        self._joints = [(joint.idx_q, joint.nq) for joint in joints]
        self._pairs = self._useful_pairs()
        if not self._pairs:
            raise DataError(
                f"{wanted.urdf}: holds no two collision shapes that could meet; add <collision> shapes to its links "
                "or leave the check for self-collision out",
                code="collision_shapes",
                file=str(wanted.urdf),
            )
        distances = self._distances(start)[0]
        nearest = int(distances.argmin())
        if distances[nearest] <= wanted.margin:
            one, other = self._labels[nearest]
            raise StartError(
                f"at the start, links {one} and {other} are {distances[nearest]:.3g} m apart, and the margin is "
                f"{wanted.margin:g} m; choose another start, or list the pair as ignored if it touches by design"
            )

    def smooth_room(self, motion: Motion, *, slopes: bool) -> tuple[float, Motion]:
        """Smooth least distance of all pairs and samples, less the margin [m]."""
        q = motion[0]
        found = [self._distances(row) for row in q]
        distances = np.array([values for values, _ in found])
        room = -float(logsumexp(-SHARPNESS * distances)) / SHARPNESS - self._wanted.margin
        if not slopes:
            return room, motion
        weights = softmax(-SHARPNESS * distances)
        gradient = np.zeros_like(q)
        for k, row in enumerate(q):
            near = np.flatnonzero(weights[k] > NEGLIGIBLE)
            if near.size:
                gradient[k] = weights[k, near] @ self._slopes(row, near.tolist())
        nothing = np.zeros_like(q)
        return room, (gradient, nothing, nothing)

    def exact_room(self, motion: Motion) -> float:
        """Least distance of all pairs and samples, less the margin [m]."""
        return min(float(self._distances(row)[0].min()) for row in motion[0]) - self._wanted.margin

    def describe(self) -> Any:
        """Return file, margin and what is ignored."""
        content = hashlib.sha256(Path(self._wanted.urdf).read_bytes()).hexdigest()
        return ["self-collision", content, repr(self._wanted.margin), [list(pair) for pair in self._wanted.ignored]]

    def report(self, motion: Motion) -> Any:
        """Return the least distance and who is that near."""
        distances = np.array([self._distances(row)[0] for row in motion[0]])
        nearest = int(distances.min(axis=0).argmin())
        return {
            "least_distance_m": float(distances.min()),
            "margin_m": self._wanted.margin,
            "nearest": list(self._labels[nearest]),
            "n_pairs": len(self._pairs),
            "kept": bool(distances.min() >= self._wanted.margin),
        }

    def _useful_pairs(self) -> list[tuple[int, int]]:
        """Shapes of links that more than one joint lies between, without the ignored ones."""
        shapes = list(self._shapes.geometryObjects)
        links = [str(self._model.frames[shape.parentFrame].name) for shape in shapes]
        known = {str(frame.name) for frame in self._model.frames}
        for pair in self._wanted.ignored:
            for name in pair:
                if name not in known:
                    raise DataError(
                        f"{self._wanted.urdf}: has no link {shown_value(name)}, which is to be ignored; "
                        "check its spelling",
                        code="collision_shapes",
                        file=str(self._wanted.urdf),
                    )
        ignored = {frozenset(pair) for pair in self._wanted.ignored}
        pairs = []
        for i, one in enumerate(shapes):
            for j, other in enumerate(shapes[:i]):
                inner, outer = sorted((int(one.parentJoint), int(other.parentJoint)))
                neighbours = inner == outer or int(self._model.parents[outer]) == inner
                if not neighbours and frozenset((links[i], links[j])) not in ignored:
                    pairs.append((j, i))
        self._labels = [(links[i], links[j]) for i, j in pairs]
        for i, j in pairs:
            self._shapes.addCollisionPair(self._pin.CollisionPair(i, j))
        return pairs

    def _data(self) -> tuple[Any, Any]:
        """Scratch of this thread."""
        if not hasattr(self._thread, "data"):
            self._thread.data = (self._model.createData(), self._shapes.createData())
        return self._thread.data  # type: ignore[no-any-return]

    def _configuration(self, q: FloatArray) -> FloatArray:
        """Pinocchio's q: a continuous joint is stored as (cos, sin)."""
        full = self._pin.neutral(self._model)
        for value, (at, nq) in zip(q.tolist(), self._joints, strict=True):
            full[at : at + nq] = [np.cos(value), np.sin(value)] if nq == 2 else value
        return np.asarray(full)

    def _distances(self, q: FloatArray) -> tuple[FloatArray, Any]:
        """Distances of all pairs in one pose (n_pairs,) [m], negative where links overlap, and the full results."""
        data, geometry = self._data()
        self._pin.computeDistances(self._model, data, self._shapes, geometry, self._configuration(q))
        results = geometry.distanceResults
        return np.array([results[k].min_distance for k in range(len(self._pairs))]), results

    def _slopes(self, q: FloatArray, pairs: list[int]) -> FloatArray:
        """Slopes of the distances of some pairs in q: (n, n_joints)."""
        _, results = self._distances(q)
        data, _ = self._data()
        self._pin.computeJointJacobians(self._model, data, self._configuration(q))
        slopes = []
        for k in pairs:
            result, sides = results[k], self._pairs[k]
            points = (result.getNearestPoint1(), result.getNearestPoint2())
            one, other = (self._point_jacobian(data, side, p) for side, p in zip(sides, points, strict=True))
            slopes.append(result.normal @ (other - one))
        return np.array(slopes)[:, self._columns]

    def _point_jacobian(self, data: Any, shape: int, point: FloatArray) -> FloatArray:
        """Velocity of a point of a shape per joint velocity (3, n)."""
        joint = self._shapes.geometryObjects[shape].parentJoint
        frame = self._pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        jacobian = self._pin.getJointJacobian(self._model, data, joint, frame)
        arm = point - data.oMi[joint].translation
        return np.asarray(jacobian[:3] - np.cross(arm, jacobian[3:], axisa=0, axisb=0, axisc=0))
