"""Set points of a controller that leads a tool along a path at an offset."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from dashpot.grinding.cell import Cell
from dashpot.grinding.cell_model import REFERENCE
from dashpot.grinding.path import Path
from dashpot.grinding.time_law import TimeLaw

__all__ = ["Command", "Motion"]

Array = NDArray[np.float64]

# Of the integrator `discrete`: found with an arm in free motion, whose tip then is where it is at
# short steps.
_OF_DISCRETE = 1.0


@dataclass(frozen=True, eq=False)
class Command:
    """What one pass is told: a motion, an offset along it, and the force expected.

    Attributes
    ----------
    law
        When the tool is where.
    offset
        Depth below the surface of the unloaded tip along the way: (n,) values at the nodes of
        `law`, m.
    force
        Normal force expected at the nodes, (n,), N, which is fed forward with its friction; None:
        none.
    """

    law: TimeLaw
    offset: Array
    force: Array | None = None

    def wanted(self, times: Array) -> Array:
        """Return the force expected at times (n,), N."""
        if self.force is None:
            return np.zeros(len(times))
        way, _, _ = self.law.at(times)
        return np.interp(way, self.law.distance, self.force)


class Motion:
    """Set points along a path: inverse dynamics of the arm, along it, in closed form.

    Along a path ``q(s)`` the torque is ``a(s) s'' + b(s) s'^2 + c(s) s' + g(s)`` (Bobrow, Dubowsky
    and Gibson 1985); the four are splines through the path's points.

    Parameters
    ----------
    cell
        The cell; its spindle counts as rigid here.
    path
        The path.
    """

    def __init__(self, cell: Cell, path: Path) -> None:
        self.cell, self.path = cell, path
        way = path.distance
        self._angles = [CubicSpline(way, level) for level in path.angles]
        self._torque = CubicSpline(way, self._torques())
        parts = cell.rigid
        model = parts.model
        if cell.control.kind == "impedance":
            self._pose = [CubicSpline(way, self._poses(level)) for level in path.angles]
        ids = parts.actuators
        self._stiffness = model.actuator_gainprm[ids, 0]
        self._damping = -model.actuator_biasprm[ids, 2]

    def start(self, offset: float) -> Array:
        """Return the state ``qpos`` (nq,) at rest at the start of the path, at an offset in m."""
        parts = self.cell.parts
        qpos = np.zeros(parts.model.nq)
        qpos[parts.joints] = self._level(self._angles, np.zeros(1), np.array([offset]))[0]
        if self.cell.spindle is not None:
            assert parts.spindle is not None
            data = mujoco.MjData(parts.model)
            data.qpos[:] = qpos
            mujoco.mj_forward(parts.model, data)
            dof = parts.spindle
            weight = data.qfrc_passive[dof] - data.qfrc_bias[dof]
            qpos[dof] = weight / self.cell.spindle.stiffness
        return qpos

    def set_points(self, command: Command, times: Array, *, lower: float = 0.0) -> Array:
        """Return (n, actuators) set points at times (n,), s, for a tip that is `lower` m lower."""
        way, speed, rate = command.law.at(times)
        offset = lower + np.interp(way, command.law.distance, command.offset)
        slope = np.interp(
            way, command.law.distance, np.gradient(command.offset, command.law.distance)
        )
        expected = np.zeros(len(way))
        if command.force is not None and self.cell.control.feeds_force:
            expected = np.interp(way, command.law.distance, command.force)
        return self.set_points_at(way, speed, rate, offset, slope * speed, expected)

    def set_points_at(
        self,
        way: Array,
        speed: Array,
        rate: Array,
        offset: Array,
        offset_speed: Array,
        force: Array,
    ) -> Array:
        """Return (n, actuators) set points for a state of motion, all (n,)."""
        levels = self._pose if self.cell.control.kind == "impedance" else self._angles
        position = self._level(levels, way, offset)
        velocity = (
            self._level(levels, way, offset, derivative=1) * speed[:, None]
            + self._level_slope(levels, way, offset) * offset_speed[:, None]
        )
        torque = self._torque(way)
        if self.cell.control.kind == "impedance":
            turning = np.zeros((len(way), 3))
            held = np.concatenate([-force[:, None] * torque[:, 5], turning], axis=1)
        else:
            held = (
                torque[:, 0] * rate[:, None]
                + torque[:, 1] * speed[:, None] ** 2
                + torque[:, 2] * speed[:, None]
                + torque[:, 3]
                - torque[:, 4] * force[:, None]
            )
        return np.asarray(position + (self._damping * velocity + held) / self._stiffness)

    def path_speeds(self, command: Command, times: Array) -> Array:
        """Return (n, actuators) speeds of the set points along the path, at times (n,), s."""
        way, speed, _ = command.law.at(times)
        offset = np.interp(way, command.law.distance, command.offset)
        levels = self._pose if self.cell.control.kind == "impedance" else self._angles
        return np.asarray(self._level(levels, way, offset, derivative=1) * speed[:, None])

    def joint_speeds(self, command: Command) -> Array:
        """Return (n, joints) speeds of the joints at the nodes of a command, rad/s."""
        law = command.law
        along = self._level(self._angles, law.distance, command.offset, derivative=1)
        return np.asarray(along * law.speed[:, None])

    def angles(self, way: Array, offset: Array) -> Array:
        """Return (n, joints) angles at places of the path, rad."""
        return self._level(self._angles, way, offset)

    def _level(
        self, levels: list[CubicSpline], way: Array, offset: Array, *, derivative: int = 0
    ) -> Array:
        """Interpolate between the three levels of a path by the parabola through them."""
        weights = _parabola(self.path.offsets, offset)
        values = [level(way, derivative) for level in levels]
        return np.asarray(sum(w[:, None] * v for w, v in zip(weights, values, strict=True)))

    def _level_slope(self, levels: list[CubicSpline], way: Array, offset: Array) -> Array:
        weights = _parabola(self.path.offsets, offset, slope=True)
        values = [level(way) for level in levels]
        return np.asarray(sum(w[:, None] * v for w, v in zip(weights, values, strict=True)))

    def _torques(self) -> Array:
        """Return (n, 6, joints): a, b, c, g, torque per newton of load, and that force."""
        parts, path = self.cell.rigid, self.path
        model, joints = parts.model, parts.joints
        data = mujoco.MjData(model)
        spline = CubicSpline(path.distance, path.angles[1])
        first, second = spline(path.distance, 1), spline(path.distance, 2)
        result = np.zeros((len(path), 6, max(len(joints), 3)))
        jacobian, mass = np.zeros((3, model.nv)), np.zeros((model.nv, model.nv))
        for index in range(len(path)):
            data.qpos[:], data.qvel[:] = path.angles[1, index], 0.0
            mujoco.mj_forward(model, data)
            mujoco.mj_fullM(model, data, mass)
            weight = data.qfrc_bias - data.qfrc_passive
            data.qvel[:] = first[index]
            mujoco.mj_forward(model, data)
            coriolis = data.qfrc_bias - (weight + 0.0)
            resisted = -data.qfrc_passive
            push = path.normals[index] + self._friction(index, data)
            mujoco.mj_jac(
                model, data, jacobian, None, path.points[index], model.site_bodyid[parts.tip]
            )
            rows = (
                mass @ first[index],
                mass @ second[index] + coriolis,
                resisted,
                weight,
                jacobian.T @ push,
            )
            for row, value in enumerate(rows):
                result[index, row, : len(joints)] = value[: len(joints)]
            if self.cell.control.kind == "impedance":
                # In the frame in which its springs act.
                result[index, 5, :3] = data.site(REFERENCE).xmat.reshape(3, 3).T @ push
        if self.cell.control.kind != "impedance":
            return result[:, :, : len(joints)]
        return result[:, :, :3]

    def _friction(self, index: int, data: mujoco.MjData) -> Array:
        """Return the friction on the tool at a point of the path per newton of normal force."""
        path, tool = self.path, self.cell.tool
        axis = path.frames[index, :, 2]
        arm = path.points[index] - data.site_xpos[self.cell.rigid.tip]
        # At a feed that is slow beside a tool that spins; else along the path.
        slide = 2 * math.pi * tool.spin * np.cross(axis, arm) + 0.1 * path.tangents[index]
        normal = path.normals[index]
        slide -= (slide @ normal) * normal
        length = float(np.linalg.norm(slide))
        return np.asarray(-self.cell.friction * slide / length)

    def _poses(self, angles: Array) -> Array:
        """Return (n, 6) poses of the tip in the frame of the impedance's reference."""
        parts = self.cell.rigid
        data = mujoco.MjData(parts.model)
        poses = np.empty((len(angles), 6))
        for index, each in enumerate(angles):
            data.qpos[:] = each
            mujoco.mj_fwdPosition(parts.model, data)
            poses[index] = data.actuator_length[parts.actuators]
        return poses


def held_means(held: Array, period: float, times: Array, timestep: float) -> Array:
    """Return (n, k) means over steps of set points that are held for a period each.

    Parameters
    ----------
    held
        (m, k) set points from 0, one per period; the last one is held on.
    period, timestep
        s.
    times
        (n,) starts of the steps, s, from 0.
    """
    edges = period * np.arange(len(held) + 1)
    integral = np.concatenate([np.zeros((1, held.shape[1])), np.cumsum(period * held, axis=0)])

    def until(time: Array) -> Array:
        inside = np.stack([np.interp(time, edges, column) for column in integral.T], axis=1)
        return np.asarray(inside + np.maximum(time - edges[-1], 0.0)[:, None] * held[-1])

    return (until(times + timestep) - until(times)) / timestep


def servo_lead(cell: Cell, *, of_mujoco: bool = False) -> float:
    """Return where in a step servos find the angles that they compare with set points.

    In steps after the middle of the step. Set points are means over the step; what a servo sees
    too early or too late of an even motion is added to them. MuJoCo steps with ``implicitfast``.
    """
    return _OF_DISCRETE if cell.integrator == "discrete" and not of_mujoco else -0.5


def _parabola(nodes: Array, at: Array, *, slope: bool = False) -> list[Array]:
    """Return Lagrange's three weights, or their slopes, at places between nodes."""
    weights = []
    for i in range(3):
        a, b = (nodes[j] for j in range(3) if j != i)
        scale = (nodes[i] - a) * (nodes[i] - b)
        weights.append(((2 * at - a - b) if slope else (at - a) * (at - b)) / scale)
    return weights
