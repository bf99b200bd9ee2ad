"""A box that the links' frames must not leave."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from dynid_rs import _core
from dynid_rs.base.quoting import shown_value
from dynid_rs.excitation.constraints import Motion, StartError

if TYPE_CHECKING:
    from dynid_rs._core import RobotModel

FloatArray = NDArray[np.float64]
Place = tuple[float, float, float]

SHARPNESS = 400.0
"""Of the smooth minimum of distances [1/m]: ten equal ones count 6 mm less."""


@dataclass(frozen=True)
class WorkspaceBox:
    """Bounds of the origins of link frames, and of a tool point, in the base frame of the chain.

    Parameters
    ----------
    lower, upper : (3,)
        Corners [m]; infinite where there is no wall.
    links : tuple of str, optional
        Links whose origins must stay inside; all but the first, whose origin does not move, by default.
    tool : (3,), optional
        One more point, in the frame of the last link [m].
    """

    lower: Place
    upper: Place
    links: tuple[str, ...] | None = None
    tool: Place | None = None

    def bind(self, robot: RobotModel, start: FloatArray) -> BoundBox:
        """Return the constraint of `robot`.

        Raises
        ------
        ValueError
            The box is empty, a link is not known, or a point lies outside at the start.
        """
        lower, upper = np.array(self.lower, dtype=np.float64), np.array(self.upper, dtype=np.float64)
        if lower.shape != (3,) or upper.shape != (3,) or not (lower < upper).all():
            raise ValueError(
                f"the workspace box from {self.lower} to {self.upper} is empty; expected lower x, y, z below upper ones"
            )
        known = list(robot.link_names)
        unknown = [name for name in self.links or () if name not in known]
        if unknown:
            raise ValueError(
                f"the workspace names link {shown_value(unknown[0])}, and the chain has {', '.join(known)}"
            )
        chosen = range(1, len(known)) if self.links is None else [known.index(name) for name in self.links]
        links, places, labels = [*chosen], [(0.0, 0.0, 0.0)] * len(chosen), [f"link {known[i]}" for i in chosen]
        if self.tool is not None:
            links, places, labels = [*links, len(known) - 1], [*places, self.tool], [*labels, "the tool"]
        if not links:
            raise ValueError("the workspace box has no point to keep inside; name links or a tool")
        return BoundBox(robot, links, np.array(places, dtype=np.float64), labels, (lower, upper), start)


class BoundBox:
    """`WorkspaceBox` of one robot; made by `WorkspaceBox.bind`."""

    name = "workspace"
    stride = 1
    fine_step = 5e-3

    def __init__(
        self,
        robot: RobotModel,
        links: list[int],
        places: FloatArray,
        labels: list[str],
        box: tuple[FloatArray, FloatArray],
        start: FloatArray,
    ) -> None:
        self._robot, self._links, self._places, self._labels = robot, links, places, labels
        self._lower, self._upper = box
        rooms = self._rooms(self._points(start[None]))[0].min(axis=(1, 2))
        worst = int(rooms.argmin())
        if rooms[worst] <= 0:
            place = ", ".join(f"{value:.3g}" for value in self._points(start[None])[0, worst])
            raise StartError(
                f"at the start, {labels[worst]} is at {place} m, outside the workspace box; "
                "choose another start or widen the box"
            )

    def smooth_room(self, motion: Motion, *, slopes: bool) -> tuple[float, Motion]:
        """Smooth least distance to a wall over all points and samples [m]."""
        points = self._points(motion[0])
        rooms = self._rooms(points)
        room = -float(logsumexp(-SHARPNESS * rooms)) / SHARPNESS
        if not slopes:
            return room, motion
        weights = softmax(-SHARPNESS * rooms)
        slope = weights[..., 0] - weights[..., 1]
        gradient = _core.point_gradient(self._robot, motion[0], self._links, self._places, slope)
        nothing = np.zeros_like(gradient)
        return room, (gradient, nothing, nothing)

    def exact_room(self, motion: Motion) -> float:
        """Least distance to a wall [m]."""
        return float(self._rooms(self._points(motion[0])).min())

    def describe(self) -> Any:
        """Return the box and its points."""
        return [
            "workspace",
            self._links,
            self._places.tolist(),
            *([repr(value) for value in corner.tolist()] for corner in (self._lower, self._upper)),
        ]

    def report(self, motion: Motion) -> Any:
        """Return the corners that the points reach."""
        points = self._points(motion[0])
        room = self._rooms(points)
        return {
            "least_m": points.min(axis=(0, 1)).tolist(),
            "greatest_m": points.max(axis=(0, 1)).tolist(),
            "least_distance_m": float(room.min()),
            "nearest": self._labels[int(room.min(axis=(0, 2, 3)).argmin())],
            "kept": bool(room.min() >= 0),
        }

    def _points(self, q: FloatArray) -> FloatArray:
        return _core.point_places(self._robot, q, self._links, self._places)

    def _rooms(self, points: FloatArray) -> FloatArray:
        """Distances to the lower and upper walls, (n_samples, n_points, 3, 2); far ones in place of infinite ones."""
        return np.stack([np.minimum(points - self._lower, 1e3), np.minimum(self._upper - points, 1e3)], axis=-1)
