"""Inverse dynamics and regressor of an arm as CasADi's expression graph, in the form that makes the shortest C.

Newton's and Euler's equations in the links' frames, with first moments and inertias about the frames' origins. A row of
the regressor is the joint's axis, carried to the link's frame, times what each parameter adds to the link's wrench:
cheaper than carrying wrenches back. Numbers that are rounding become zeros, so that CasADi leaves their products out.
"""

from __future__ import annotations

import casadi as ca
import numpy as np


def functions(model):
    """`torques(q, dq, ddq)` and the nonzeros of `regressor(q, dq, ddq)`, parameters in Pinocchio's order."""
    n = model.nv
    q, dq, ddq = (ca.SX.sym(name, n) for name in ("q", "dq", "ddq"))
    links = list(motion(model, q, dq, ddq))
    state = [q, dq, ddq]
    return (
        ca.Function("torques", state, [ca.cse(torques(model, links))]),
        ca.Function("regressor", state, [ca.cse(regressor(links))]),
    )


def motion(model, q, dq, ddq):
    """Per link: axis, rotation and position in the frame before, velocity, angular acceleration, the origin's."""
    speed = turning = ca.SX(3, 1)
    acceleration = -ca.SX(model.gravity.linear)
    for j in range(model.nv):
        axis, placement = axis_of(model, j), model.jointPlacements[j + 1]
        rotation = exact(placement.rotation) @ about(axis, q[j])
        position = exact(placement.translation)
        moved = acceleration + ca.cross(turning, position) + ca.cross(speed, ca.cross(speed, position))
        carried = rotation.T @ speed
        turning = rotation.T @ turning + axis * ddq[j] + ca.cross(carried, axis * dq[j])
        speed = carried + axis * dq[j]
        acceleration = rotation.T @ moved
        yield axis, rotation, position, speed, turning, acceleration


def torques(model, links):
    """Forces and moments from the last link to the first."""
    force = moment = ca.SX(3, 1)
    out = []
    for j in reversed(range(len(links))):
        axis, rotation, position, speed, turning, acceleration = links[j]
        body = model.inertias[j + 1]
        first = ca.SX(body.mass * body.lever)
        inertia = ca.SX(
            body.inertia + body.mass * (body.lever @ body.lever * np.eye(3) - np.outer(body.lever, body.lever))
        )
        force += body.mass * acceleration + ca.cross(turning, first) + ca.cross(speed, ca.cross(speed, first))
        moment += inertia @ turning + ca.cross(speed, inertia @ speed) + ca.cross(first, acceleration)
        out.append(ca.dot(axis, moment))
        force = rotation @ force
        moment = rotation @ moment + ca.cross(position, force)
    return ca.vertcat(*reversed(out))


def regressor(links):
    """Row per joint, ten columns per link; what is zero in every state is no entry."""
    n = len(links)
    rows = [[ca.SX(1, 10)] * n for _ in range(n)]
    for i, (_, _, _, speed, turning, acceleration) in enumerate(links):
        first = ca.skew(turning) + ca.skew(speed) @ ca.skew(speed)
        inertia = six(turning) + ca.skew(speed) @ six(speed)
        axis, arm = links[i][0], ca.SX(3, 1)
        for j in reversed(range(i + 1)):
            # Axis j and the velocity it gives to link i's origin, both in link i's frame.
            axis, arm = carried_axis(links, j, i)
            mass = ca.dot(arm, acceleration)
            moments = first.T @ arm + ca.cross(acceleration, axis)
            rows[j][i] = ca.horzcat(mass, moments.T, (inertia.T @ axis).T)
    return ca.vertcat(*(ca.horzcat(*row) for row in rows))


def carried_axis(links, j, i):
    """Axis j in link i's frame, and its moment arm there."""
    axis, arm = links[j][0], ca.SX(3, 1)
    for _, rotation, position, *_ in links[j + 1 : i + 1]:
        axis, arm = rotation.T @ axis, rotation.T @ (arm + ca.cross(axis, position))
    return axis, arm


def six(x):
    """`I x` as a matrix times `(I_xx, I_xy, I_yy, I_xz, I_yz, I_zz)`."""
    zero = ca.SX(1, 1)
    return ca.vertcat(
        ca.horzcat(x[0], x[1], zero, x[2], zero, zero),
        ca.horzcat(zero, x[0], x[1], zero, x[2], zero),
        ca.horzcat(zero, zero, zero, x[0], x[1], x[2]),
    )


def axis_of(model, j):
    """Of a revolute joint."""
    joint = model.joints[j + 1]
    data = joint.createData()
    joint.calc(data, np.zeros(1))
    subspace = np.ravel(data.S)
    assert not subspace[:3].any(), "revolute joints only"
    return exact(subspace[3:])


def about(axis, angle):
    """Rotation about a unit axis."""
    sine, cosine = ca.sin(angle), ca.cos(angle)
    if ca.DM(axis).nnz() == 1:  # along a coordinate axis: no 1 - cos that would have to cancel
        square = axis @ axis.T
        return cosine * (ca.SX.eye(3) - square) + square + sine * ca.skew(axis)
    return ca.SX.eye(3) + sine * ca.skew(axis) + (1 - cosine) * (ca.skew(axis) @ ca.skew(axis))


def exact(numbers):
    """Without what is left where a sine of pi was rounded, and without zeros."""
    near = np.round(numbers)
    clean = np.where(np.abs(numbers - near) < 1e-12, near, numbers)
    return ca.sparsify(ca.SX(ca.DM(clean)))
