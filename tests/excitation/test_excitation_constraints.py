"""What an exciting trajectory must keep beside its limits: workspace and self-collision."""

import sys

import numpy as np
import pinocchio as pin
import pytest
from helpers.data import ROOT
from numpy.testing import assert_allclose

from dynid_rs import DataError, RobotModel
from dynid_rs.base.errors import MissingLibraryError
from dynid_rs.excitation import FourierExcitation, SelfCollision, WorkspaceBox
from dynid_rs.excitation.collision import BoundCollision

INERTIAL = '<inertial><mass value="2"/><inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"/></inertial>'
LIMIT = 'velocity="3" effort="200"'


def link(name, place, shape, inertial=INERTIAL):
    return (
        f'<link name="{name}">{inertial}<collision><origin xyz="{place}"/>'
        f"<geometry>{shape}</geometry></collision></link>"
    )


def joint(name, kind, parent, child, place, axis, limit):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{place}"/><axis xyz="{axis}"/><limit {limit} {LIMIT}/></joint>'
    )


ARM = "\n".join(
    [
        '<robot name="folding_arm">',
        link("base", "0 0 0.2", '<cylinder radius="0.1" length="0.4"/>', ""),
        link("upper", "0.25 0 0", '<box size="0.5 0.08 0.08"/>'),
        joint("shoulder", "revolute", "base", "upper", "0 0 0.5", "0 1 0", 'lower="-3" upper="3"'),
        link("fore", "0.2 0 0", '<box size="0.3 0.08 0.08"/>'),
        joint("elbow", "continuous", "upper", "fore", "0.5 0 0", "0 1 0", ""),
        link("hand", "0.1 0 0", '<sphere radius="0.06"/>'),
        joint("wrist", "revolute", "fore", "hand", "0.4 0 0", "0 0 1", 'lower="-2" upper="2"'),
        "</robot>",
    ]
)


@pytest.fixture
def urdf(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    return path


def arm():
    return RobotModel.from_urdf_string(ARM)


def quick(*constraints, **options):
    given = {"duration": 8.0, "n_restarts": 2, "max_iter": 25, "random_state": 0}
    return FourierExcitation(constraints=constraints, **(given | options))


def motion(trajectory, step=2e-3):
    return trajectory.evaluate(np.arange(0, trajectory.duration + step / 2, step))


def origins(q):
    """Origins of all link frames by Pinocchio, (n_samples, n_links, 3)."""
    model = pin.buildModelFromXML(ARM)
    data = model.createData()
    places = []
    for q0, q1, q2 in q:
        pin.forwardKinematics(model, data, np.array([q0, np.cos(q1), np.sin(q1), q2]))
        places.append([np.array(data.oMi[k + 1].act(np.zeros(3))) for k in range(3)])
    return np.array(places)


def tips(q, tool):
    model = pin.buildModelFromXML(ARM)
    data = model.createData()
    places = []
    for q0, q1, q2 in q:
        pin.forwardKinematics(model, data, np.array([q0, np.cos(q1), np.sin(q1), q2]))
        places.append(data.oMi[3].act(np.array(tool)))
    return np.array(places)


def distances(path, q):
    """Least distance of links that are not neighbours, by coal, (n_samples,)."""
    model = pin.buildModelFromUrdf(str(path))
    shapes = pin.buildGeomFromUrdf(model, str(path), pin.GeometryType.COLLISION)
    for pair in ((0, 2), (0, 3), (1, 3)):
        shapes.addCollisionPair(pin.CollisionPair(*pair))
    data, geometry = model.createData(), shapes.createData()
    found = []
    for q0, q1, q2 in q:
        pin.computeDistances(model, data, shapes, geometry, np.array([q0, np.cos(q1), np.sin(q1), q2]))
        found.append(min(result.min_distance for result in geometry.distanceResults))
    return np.array(found)


def slope_by_differences(constraint, q, step=1e-6):
    still = np.zeros_like(q)
    slope = np.empty_like(q)
    for k, j in np.ndindex(*q.shape):
        ahead, behind = q.copy(), q.copy()
        ahead[k, j] += step
        behind[k, j] -= step
        rooms = [constraint.smooth_room((at, still, still), slopes=False)[0] for at in (ahead, behind)]
        slope[k, j] = (rooms[0] - rooms[1]) / (2 * step)
    return slope


def test_the_workspace_is_kept():
    lower, upper, tool = (-0.2, -0.5, 0.15), (1.2, 0.5, 1.0), (0.1, 0.0, 0.0)
    robot = arm()
    free = quick().fit(robot)
    places = origins(motion(free.trajectory_)[0])[:, 1:]
    assert (places < lower).any() or (places > upper).any()  # the box matters
    design = quick(WorkspaceBox(lower, upper, tool=tool)).fit(robot)
    q, _, _ = motion(design.trajectory_)
    places = np.concatenate([origins(q)[:, 1:], tips(q, tool)[:, None]], axis=1)
    assert (places >= np.array(lower) - 1e-5).all()
    assert (places <= np.array(upper) + 1e-5).all()
    report = design.constraint_report_["workspace"]
    assert report["kept"]
    assert_allclose(report["least_m"], places.min(axis=(0, 1)), atol=1e-4)
    assert_allclose(report["greatest_m"], places.max(axis=(0, 1)), atol=1e-4)
    assert design.condition_number_ > free.condition_number_


def test_slopes_of_the_workspace_are_differences():
    robot = arm()
    box = WorkspaceBox((-0.2, -np.inf, 0.15), (1.2, 0.5, 1.0), tool=(0.1, 0.05, 0.0)).bind(robot, np.zeros(3))
    q = np.random.default_rng(0).uniform(-1, 1, (4, 3))
    still = np.zeros_like(q)
    room, (slope, *rest) = box.smooth_room((q, still, still), slopes=True)
    assert room <= box.exact_room((q, still, still)) + 1e-12
    assert_allclose(slope, slope_by_differences(box, q), rtol=1e-5, atol=1e-8)
    assert not np.any(rest)


def test_links_keep_apart(urdf):
    robot = arm()
    free = quick().fit(robot)
    assert distances(urdf, motion(free.trajectory_, 0.02)[0]).min() < 0.02  # the arm folds into itself
    design = quick(SelfCollision(urdf, margin=0.03)).fit(robot)
    found = distances(urdf, motion(design.trajectory_, 0.005)[0])
    assert found.min() >= 0.03 - 1e-4
    report = design.constraint_report_["self-collision"]
    assert report["kept"]
    assert report["n_pairs"] == 3
    assert_allclose(report["least_distance_m"], found.min(), atol=1e-3)


def test_slopes_of_distances_are_differences(urdf):
    robot = arm()
    bound = SelfCollision(urdf).bind(robot, np.zeros(3))
    assert isinstance(bound, BoundCollision)
    # Near each other and apart; where links overlap the depth has kinks of its own.
    q = np.array([[1.2, 0.3, 0.2], [-0.4, 2.5, -0.5], [0.9, 1.0, 0.4], [0.2, -2.4, 1.2]])
    still = np.zeros_like(q)
    room, (slope, *rest) = bound.smooth_room((q, still, still), slopes=True)
    assert room <= bound.exact_room((q, still, still)) + 1e-12
    assert_allclose(slope, slope_by_differences(bound, q, 1e-5), rtol=2e-3, atol=2e-4 * np.abs(slope).max())
    assert np.abs(slope).max() > 0
    assert not np.any(rest)
    # The same from many threads: each has its own scratch.
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(4) as pool:
        rooms = list(pool.map(lambda _: bound.smooth_room((q, still, still), slopes=True)[0], range(32)))
    assert set(rooms) == {room}


def test_both_constraints_and_torque_together(urdf):
    robot = arm()
    design = quick(SelfCollision(urdf), WorkspaceBox((-0.5, -1, 0.0), (1.5, 1, 1.6))).fit(robot)
    assert set(design.constraint_report_) == {"torque", "self-collision", "workspace"}
    assert all(report["kept"] for report in design.constraint_report_.values())
    assert design.merit_.violations(design.limits_) == 0
    other = quick(SelfCollision(urdf), WorkspaceBox((-0.5, -1, 0.0), (1.5, 1, 1.6)), n_jobs=1).fit(robot)
    assert other.objective_ == design.objective_


def test_ignored_pairs_may_touch(urdf):
    robot = arm()
    ignored = (("base", "fore"), ("hand", "base"), ("upper", "hand"))
    bound = SelfCollision(urdf, ignored=ignored[:2]).bind(robot, np.zeros(3))
    assert bound.report((np.zeros((1, 3)),) * 3)["n_pairs"] == 1
    with pytest.raises(DataError, match="no two collision shapes that could meet"):
        SelfCollision(urdf, ignored=ignored).bind(robot, np.zeros(3))


# Bad input


def test_a_missing_library_is_named_with_its_mend(urdf, monkeypatch):
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    with pytest.raises(
        MissingLibraryError, match=r"pinocchio, which is not installed: pip install 'dynid-rs\[collision\]'"
    ):
        quick(SelfCollision(urdf)).fit(arm())
    assert "[collision]" not in (ROOT / "python/dynid_rs/cli.py").read_text()
    quick(max_iter=2).fit(arm())  # nothing else needs it


def test_nothing_loads_the_library_before_it_is_asked_for():
    import subprocess

    code = "import sys, dynid_rs.excitation; sys.exit('pinocchio' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("box", "words"),
    [
        (WorkspaceBox((1, 0, 0), (0, 1, 1)), "is empty; expected lower x, y, z below upper ones"),
        (WorkspaceBox((0, 0), (1, 1)), "is empty; expected lower"),
        (
            WorkspaceBox((-2, -2, -2), (2, 2, 2), links=("foot",)),
            "names link 'foot', and the chain has upper, fore, hand",
        ),
        (WorkspaceBox((-2, -2, -2), (0.8, 2, 2)), "link hand is at 0.9, 0, 0.5 m, outside the workspace box; choose"),
        (WorkspaceBox((-2, -2, -2), (1, 2, 2), tool=(0.2, 0, 0)), "the tool is at 1.1, 0, 0.5 m, outside"),
        (WorkspaceBox((-2, -2, -2), (2, 2, 2), links=()), "no point to keep inside"),
    ],
)
def test_boxes_that_make_no_sense_are_refused(box, words):
    with pytest.raises(ValueError, match=words):
        quick(box).fit(arm())


def test_shapes_that_cannot_be_used_are_refused(urdf, tmp_path):
    robot = arm()

    def refused(text, words, kind=DataError, **options):
        path = tmp_path / "other.urdf"
        path.write_text(text)
        with pytest.raises(kind, match=words):
            quick(SelfCollision(path, **options)).fit(robot)

    bare = ARM
    while "<collision>" in bare:
        bare = bare[: bare.index("<collision>")] + bare[bare.index("</collision>") + len("</collision>") :]
    refused(bare, "holds no two collision shapes that could meet; add <collision> shapes")
    refused(ARM.replace('name="elbow"', 'name="knee"'), "has no joint 'elbow' of the robot model")
    mesh = '<mesh filename="package://nowhere/hand.stl"/>'
    refused(
        ARM.replace('<sphere radius="0.06"/>', mesh),
        r"collision shapes cannot be loaded .* check the paths of its meshes",
    )
    capsule = ARM.replace('<sphere radius="0.06"/>', '<capsule radius="0.06" length="0.1"/>')
    refused(capsule, "4 collision shapes are declared and 3 can be used; boxes, spheres")
    refused("not a robot", "collision shapes cannot be loaded")
    refused(ARM, "has no link 'foot', which is to be ignored", ignored=(("foot", "base"),))
    refused(ARM, "margin of self-collision must be a distance", ValueError, margin=-0.1)
    refused(
        ARM,
        r"at the start, links .* are .* m apart, and the margin is 0.5 m; choose another start",
        ValueError,
        margin=0.5,
    )
    with pytest.raises(FileNotFoundError, match="does not exist"):
        quick(SelfCollision(tmp_path / "nowhere.urdf")).fit(robot)


def test_constraints_that_nothing_keeps_are_said():
    robot = arm()
    # The start is just inside, and any motion leaves the box.
    box = WorkspaceBox((0.899999, -1e-6, 0.499999), (0.900001, 1e-6, 0.500001), links=("hand",))
    with pytest.raises(ValueError, match="none of 2 searches found a motion that keeps torque and workspace; choose"):
        quick(box, max_iter=5).fit(robot)
