"""`docs/measured/paper.md`: the paper's Section 6 with our figures beside its own. Every number comes from the run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import tables
from clock import Clock
from designs import OBJECTIVES, Designs
from errors import FIRST, SECOND, THIRD, TRAINING, WLS, Outcome
from laboratory import DESIGNED, TABLE_3, WITH_FRICTION, Friction, Laboratory
from markdown import JOINTS, duration, joints_where, numbers, percent, significant, table
from measured import KUKA, UR10E, Measured

from dynid_rs.simulation import Tracking

OBJECTIVE_NAMES = {"condition": "condition number alone", "block": "block objective, Eq. 14"}


@dataclass(frozen=True, eq=False)
class Times:
    """Run times [s] and the processor they come from."""

    machine: str
    designs: list[float]
    identification: Clock
    cycle: float


@dataclass(frozen=True, eq=False)
class Experiment:
    """All that was done."""

    arms: dict[str, Designs]
    lab: Laboratory
    friction: Friction
    outcomes: dict[str, Outcome]
    robots: list[Measured]
    times: Times
    quick: bool

    @property
    def ours(self) -> Outcome:
        """Full method on the laboratory arm, exciting runs alone."""
        return self.outcomes["ours"]

    def measured(self, robot: str) -> list[Measured]:
        """Identifications of one measured robot, none where its data is not at hand."""
        return [one for one in self.robots if one.robot == robot]


def write(experiment: Experiment) -> str:
    """The page up to what does not reproduce."""
    parts = (_head, _robots, _trajectories, _friction, _exciting, _errors, _measured, _times)
    return "\n".join(part(experiment) for part in parts)


def _head(experiment: Experiment) -> str:
    quick = "\n**A quick run, to see that the script works: its numbers mean nothing.**\n" if experiment.quick else ""
    return f"""# The paper's experiment, repeated

Liu, Xu, Song, Wu, Zhang, Zhao: *An Accurate Dynamic Model Identification Method of an Industrial Robot Based on
Double-Encoder Compensation*, Section 6. `make paper` wrote this page and its figures; every number of ours comes from
that run, every number of the paper's is as printed there. Errors are root mean squares in the band of the fit while
the arm moves, "held out" are runs that nothing was fitted to, and a change is that against weighted least squares
(WLS: rigid body, Coulomb and viscous friction, offset).
{quick}"""


def _robots(experiment: Experiment) -> str:
    lab = experiment.lab
    missing = [name for name in (UR10E, KUKA) if not experiment.measured(name)]
    told = ""
    if missing:
        left_out = " and ".join(f"`{name}`" for name in missing)
        told = (
            f"\nThe measured data of {left_out} was not at hand, so these parts were **left out**;\n"
            "set `DYNID_DATA` to the folder that holds it.\n"
        )
    limits = [np.degrees(tables.LIMITS[name]) for name in ("position", "velocity", "acceleration")]
    names = ("position ± [deg]", "velocity ± [deg/s]", "acceleration ± [deg/s²]")
    stiffness = significant(lab.arm.stiffness / 1e3, 3)
    return f"""## 1. Robots and limits

The paper's arm is not described. Ours is the six-axis arm of this package in a simulated laboratory: gears that yield,
with tooth friction and a kinematic error, two encoders on two clocks with steps and noise, torque noise, and a
controller of {Tracking().bandwidth:g} Hz that does not follow exactly. The identification sees both positions and the
torque. Gear stiffness, joints 1 to 6: {", ".join(stiffness)} kN m/rad; runs at {lab.train[0].rate:g} Hz.
{told}
**Table 1, as printed.** Used on every arm here in place of its own limits; self-collision is not looked at.

{table(("", *JOINTS), [[name, *numbers(values, 0)] for name, values in zip(names, limits, strict=True)])}"""


def _trajectories(experiment: Experiment) -> str:
    header = [
        "trajectory",
        "seeds",
        "condition number",
        "least to greatest",
        "acceleration",
        "velocity",
        "gravity block",
    ]
    text = """## 2. Condition numbers (Table 2)

Condition number of the unweighted base regressor over 200 samples, 5 harmonics, 20 s, limits of Table 1; the last row
of each arm is the paper's own trajectory (Table 3) played on it. The middle seed's blocks are beside it (Eq. 14, each
over its structural rank). The paper prints {condition:.4f} for plain and {block:.4f} for the block objective.
""".format(**tables.CONDITION_NUMBERS)
    for arm, designs in experiment.arms.items():
        rows = []
        for objective in OBJECTIVES:
            found, middle = designs.conditions(objective), designs.median(objective)
            span = f"{found.min():.1f} to {found.max():.1f}"
            merit = middle.merit_
            rows.append([OBJECTIVE_NAMES[objective], str(len(found)), f"{middle.condition_number_:.1f}", span])
            rows[-1] += significant(merit.block_condition_numbers.values(), 3)
        paper = designs.paper
        rows.append(["the paper's Table 3", "", f"{paper.condition_number:.1f}", ""])
        rows[-1] += significant(paper.block_condition_numbers.values(), 3)
        text += f"\nOn {arm}:\n\n{table(header, rows)}"
        ratio = paper.condition_number / designs.median("block").condition_number_
        text += f"\nThe paper's trajectory has {ratio:.1f} times the condition number of the block design.\n"
    return text + _maxima(next(iter(experiment.arms.values())))


def _maxima(designs: Designs) -> str:
    """Exact maxima beside the limits; they belong to the trajectory, not to the arm."""
    rows = []
    for name, merit in (("designed", designs.median("block").merit_), ("Table 3", designs.paper)):
        size = np.degrees(np.maximum(np.abs(merit.lowest), np.abs(merit.highest)))
        for k, motion in enumerate(("position [deg]", "velocity [deg/s]", "acceleration [deg/s²]")):
            limit = np.degrees(list(tables.LIMITS.values())[k])
            cells = [f"{most:.1f} of {bound:.0f}" for most, bound in zip(size[k], limit, strict=True)]
            rows.append([f"{name}, {motion}", *cells])
    count = [m.violations(tables.table_1()) for m in (designs.median("block").merit_, designs.paper)]
    return f"""
Largest values on a grid of 1 ms beside the limits ({count[0]} limits exceeded by the design, {count[1]} by Table 3):

{table(("", *JOINTS), rows)}"""


def _friction(experiment: Experiment) -> str:
    found = experiment.friction
    rows = []
    for j, odd in enumerate(found.pairs):
        size, pairs, error = found.errors(j)
        cells = significant((size, pairs, found.ideal_errors(j), error), 3)
        rows.append([f"joint {j + 1}", str(len(odd.speed)), *cells])
        rows[-1].append(f"{100 * error / size:.1f}")
    header = ("", "speeds", "simulated [N m]", "pairs off by", "without tooth friction", "law off by", "law off by, %")
    return f"""## 3. Friction experiment (Figure 6)

Constant-speed legs in both directions and time-reversed pairs within Table 1, {found.duration:.0f} s, planned by
`plan_friction_experiment` and played on the laboratory arm. Shown is what the pairs of Eq. 8 measure, the odd part; the
law is Eqs. 9-11 as the first two loops fit it with the experiment beside the exciting runs. What was simulated is the
friction of the motor; the friction of the teeth follows the gear's deflection and is not in it.

![Friction of joints 1 and 2](figures/figure_6.svg)

Root mean squares over the speeds of the pairs:

{table(header, rows)}"""


def _exciting(experiment: Experiment) -> str:
    coefficients = [(f"a_{k + 1}", row) for k, row in enumerate(tables.SIN_COEF)]
    coefficients += [(f"b_{k + 1}", row) for k, row in enumerate(tables.COS_COEF)]
    rows = [[name, *numbers(row, 4)] for name, row in (*coefficients, ("theta_0 [rad]", tables.OFFSET))]
    n_train = len(experiment.lab.train)
    return f"""## 4. Exciting trajectory (Figure 5)

The block design of seed 0. The arm is identified from {n_train} such designs (seeds 0 to {n_train - 1}); the next
seed's and the paper's own trajectory are held out.

![Exciting trajectory](figures/figure_5.svg)

**Table 3, as printed**: a and b in rad/s, for the fundamental of {tables.FUNDAMENTAL / (2 * np.pi):.2f} Hz.

{table(("", *JOINTS), rows)}"""


def _errors(experiment: Experiment) -> str:
    rmse = tables.RMSE
    rows = [[name, *numbers(rmse[key], 4)] for name, key in (("WLS", "wls"), ("theirs", "three loops"))]
    rows.append(["change, %", *percent(tables.table_4_change())])
    text = f"""## 5. Errors (Table 4, Figures 7 and 8)

**Table 4, as printed** [N m]; which run it is from is not said.

{table(("", *JOINTS), rows)}
**Ours, on the laboratory arm** [N m], from the exciting runs alone, and with the friction experiment beside them:

"""
    ours, slow = experiment.ours, experiment.outcomes[WITH_FRICTION]
    rows = []
    for runs in (TRAINING, DESIGNED, TABLE_3):
        rows += [
            [f"**{runs}**: WLS", *significant(ours.errors[runs][WLS])],
            ["three loops", *significant(ours.errors[runs][THIRD])],
            ["change, %", *percent(ours.change(runs))],
            ["three loops, with friction experiment", *significant(slow.errors[runs][THIRD])],
            ["change, %", *percent(slow.change(runs))],
        ]
    text += table(("", *JOINTS), rows) + _loops(ours, "laboratory arm, exciting runs alone")
    identifier = ours.identifier
    return (
        text
        + f"""
The loops ended after {identifier.n_iter_} rounds; the third was kept on {joints_where(identifier.residual_.kept)}.

Figure 7, weighted least squares on the held-out designed run:

![Weighted least squares](figures/figure_7.svg)

Figure 8, the three loops on the same run:

![Three loops](figures/figure_8.svg)
"""
    )


def _loops(outcome: Outcome, name: str) -> str:
    rows = []
    for runs in outcome.errors:
        for stage, before in ((FIRST, WLS), (SECOND, FIRST), (THIRD, SECOND)):
            rows.append([f"{runs}: {stage}", *percent(outcome.change(runs, stage, before))])
    joints = tuple(f"joint {j + 1}" for j in range(outcome.identifier.robot.n_joints))
    return f"\nWhat each loop gave, {name}, change in % against the stage before:\n\n{table(('', *joints), rows)}"


def _measured(experiment: Experiment) -> str:
    if not experiment.robots:
        return "## 6. Measured robots\n\nLeft out: their data was not at hand.\n"
    text = "## 6. Measured robots\n"
    for one in experiment.robots:
        outcome = one.outcome
        rows = []
        for runs, errors in outcome.errors.items():
            rows += [
                [f"**{runs}**: WLS", *significant(errors[WLS])],
                ["three loops", *significant(errors[THIRD])],
                ["change, %", *percent(outcome.change(runs))],
                ["of the torque's standard deviation, %", *numbers(100 * errors[THIRD] / outcome.torque_std[runs], 1)],
            ]
        trained = ", ".join(f"`{states.name}`" for states in outcome.states[TRAINING])
        text += f"\n**`{one.robot}`, {one.note}** [{one.unit}]; learned from {trained}:\n\n{table(('', *JOINTS), rows)}"
        text += _loops(outcome, f"`{one.robot}`")
        text += f"\nThe third loop was kept on {joints_where(outcome.identifier.residual_.kept)}.\n"
    return text


def _times(experiment: Experiment) -> str:
    times, found = experiment.times, experiment.friction
    clock, printed = times.identification, tables.SECONDS
    run = experiment.lab.timed
    loop_1 = f"{clock.seconds('friction'):.3f} s, all rounds; {found.clock.seconds(': friction'):.1f} s with the "
    loop_1 += f"{found.duration:.0f} s friction experiment"
    rows = [
        ["friction (first loop)", f"{printed['friction']:g} s", loop_1],
        [
            "trajectory optimisation",
            f"{printed['trajectory (with its 20 s of motion)']:g} s with its 20 s of motion",
            f"{np.median(times.designs):.1f} s, median of {len(times.designs)} designs, without motion",
        ],
        [
            "identification (second loop, with the weight of the prior that a lone run needs)",
            f"{printed['identification']:g} s",
            f"{clock.seconds('least squares') + clock.seconds('link dynamics'):.3f} s",
        ],
        ["mixture (third loop)", f"{printed['mixture']:g} s", f"{clock.seconds('residual'):.3f} s, all rounds"],
        ["all loops, filters included", "", f"{clock.total:.3f} s"],
        ["one online cycle", "1 ms", duration(times.cycle)],
    ]
    return f"""## 7. Run times

Theirs: MATLAB on an i7-11800H. Ours: {times.machine}, from one exciting run of {run.duration:.0f} s at {run.rate:g} Hz
where nothing else is said. These times come from the machine that wrote this page, with whatever else it
had to do, and are not tests. The online cycle is one sample of the torque model of all loops, a run evaluated sample
after sample.

{table(("", "the paper", "ours"), rows)}"""
