"""Passes of a tool, simulated: forces, places and speeds where it touches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

import dashpot
from dashpot.engine import Engine
from dashpot.grinding.cell import Cell
from dashpot.grinding.cell_model import CONTACT_WIDTH
from dashpot.grinding.motion import Command, Motion, held_means, servo_lead

__all__ = ["Pass", "Simulator"]

Array = NDArray[np.float64]

_SMALL = 1e-3  # m, a change of the offset within which set points are linear in it


@dataclass(frozen=True, eq=False)
class Pass:
    """What happened in a pass, by step: forces are means over the step.

    Attributes
    ----------
    time
        (n,) starts of the steps, s.
    force
        (n, points) normal force of each point of the tool, N.
    friction
        (n, points) size of the friction force, N.
    place
        (n, points, 3) where it touches, world, m; NaN where it does not.
    normal
        (n, points, 3) outward normal of the workpiece there.
    slide
        (n, points) sliding speed, m/s, with what the tool spins; 0 where it does not touch.
    angles, speeds
        (n, joints) of the arm after the step, rad and rad/s.
    tip
        (n, 3) place of the tip at the start of the step, m.

    Examples
    --------
    >>> found = plan.passes[0].found
    >>> found.time.shape == found.force[:, 0].shape
    True
    """

    time: Array
    force: Array
    friction: Array
    place: Array
    normal: Array
    slide: Array
    angles: Array
    speeds: Array
    tip: Array

    @property
    def timestep(self) -> float:
        """Length of a step, s."""
        return float(self.time[1] - self.time[0])

    @property
    def total(self) -> Array:
        """(n,) normal force of all points together, N."""
        return np.asarray(self.force.sum(axis=1))


class Simulator:
    """Runs passes of a cell along a path, many at once.

    Parameters
    ----------
    motion
        The path, and set points along it, of the cell as the controller knows it.
    cell
        The cell as it is. None: the same.
    timestep
        Of the simulation, s. None: the cell's.
    nthread
        Threads that share the passes. None: one per core.
    """

    def __init__(
        self,
        motion: Motion,
        *,
        cell: Cell | None = None,
        timestep: float | None = None,
        nthread: int | None = None,
    ) -> None:
        self.motion = motion
        self.cell = motion.cell if cell is None else cell
        self.timestep = float(self.cell.timestep if timestep is None else timestep)
        self.engine: Engine = self.cell.engine()
        self.engine.model.opt.timestep = self.timestep
        self._nthread = nthread

    def run(
        self, commands: Sequence[Command], *, mujoco_model: mujoco.MjModel | None = None
    ) -> list[Pass]:
        """Simulate passes; with a model, by MuJoCo's own step."""
        steps = max(math.ceil(c.law.duration / self.timestep - 1e-9) for c in commands)
        starts = np.stack([self._start(command) for command in commands])
        if self.cell.control.kind == "force":
            return self._run_by_force(commands, starts, steps, mujoco_model)
        lead = servo_lead(self.cell, of_mujoco=mujoco_model is not None)
        controls = np.stack([self.controls(command, steps, lead) for command in commands])
        if mujoco_model is None:
            states, sensors = dashpot.rollout(self.engine, starts, controls, nthread=self._nthread)
        else:
            states, sensors = _stepped(mujoco_model, starts, controls, self.timestep)
        return self._read_all(commands, states, sensors)

    def _run_by_force(
        self,
        commands: Sequence[Command],
        starts: Array,
        steps: int,
        mujoco_model: mujoco.MjModel | None,
    ) -> list[Pass]:
        """Simulate passes whose offset follows the force, read and corrected once a period."""
        control, parts = self.cell.control, self.cell.parts
        stride = max(1, round(control.period / self.timestep))
        states, sensors = [], []
        present = starts
        correction, read = np.zeros(len(commands)), np.zeros(len(commands))
        times = np.asarray(self.timestep * np.arange(steps + 1), dtype=np.float64)
        ticks = times[:-1:stride]
        wanted = np.stack([command.wanted(ticks) for command in commands])
        told = np.stack([self.motion.set_points(command, ticks) for command in commands])
        lower = np.stack(
            [self.motion.set_points(command, ticks, lower=_SMALL) for command in commands]
        )
        slope = (lower - told) / _SMALL
        lead = servo_lead(self.cell, of_mujoco=mujoco_model is not None)
        told += np.stack([self._ahead(command, ticks, lead) for command in commands])
        turning = None if self.cell.imbalance is None else self.cell.imbalance.mean_forces(times)
        for tick in range(len(ticks)):
            first = tick * stride
            count = min(stride, steps - first)
            # Before it touches, and where nothing is wanted, the offset is the plan's.
            follows = (wanted[:, tick] > 0) & (read > 0)
            missing = np.where(follows, wanted[:, tick] - read, 0.0)
            correction += control.gain * count * self.timestep * missing
            held = np.zeros((len(commands), count, parts.model.nu))
            sent = told[:, tick] + correction[:, None] * slope[:, tick]
            held[:, :, parts.actuators] = sent[:, None]
            if turning is not None:
                held[:, :, parts.turning] = turning[first : first + count]
            if mujoco_model is None:
                last = np.empty((len(commands), _state_size(self.engine.model, _INTEGRATION)))
                chunk, sensed = dashpot.rollout(
                    self.engine, present, held, nthread=self._nthread, final_state=last
                )
                present = last
            else:
                chunk, sensed = _stepped(mujoco_model, present, held, self.timestep)
                present = chunk[:, -1]
            states.append(chunk)
            sensors.append(sensed)
            loads = sensed[:, :, 1 : self._contact_width : CONTACT_WIDTH]
            read = loads.sum(axis=2).mean(axis=1)
        joined = np.concatenate(states, axis=1), np.concatenate(sensors, axis=1)
        return self._read_all(commands, *joined)

    def _read_all(self, commands: Sequence[Command], states: Array, sensors: Array) -> list[Pass]:
        found = []
        for command, state, sensed in zip(commands, states, sensors, strict=True):
            count = math.ceil(command.law.duration / self.timestep - 1e-9)
            found.append(self._read(state[:count], sensed[:count]))
        return found

    def controls(self, command: Command, steps: int, lead: float) -> Array:
        """Return (steps, nu) controls: means over steps of the set points that are held.

        `lead` is that of `dashpot.grinding.motion.servo_lead`.
        """
        parts = self.cell.parts
        times = np.asarray(self.timestep * np.arange(steps + 1), dtype=np.float64)
        controls = np.zeros((steps, parts.model.nu))
        period = self.cell.control.period
        ticks = period * np.arange(math.ceil(times[-1] / period - 1e-9) + 1)
        held = self.motion.set_points(command, ticks)
        controls[:, parts.actuators] = held_means(
            held, period, times[:-1], self.timestep
        ) + self._ahead(command, times[:-1], lead)
        if self.cell.imbalance is not None:
            controls[:, parts.turning] = self.cell.imbalance.mean_forces(times)
        return controls

    def _ahead(self, command: Command, times: Array, lead: float) -> Array:
        """Return what makes up for where in steps from `times` on servos find the angles."""
        middle = times + 0.5 * self.timestep
        return lead * self.timestep * self.motion.path_speeds(command, middle)

    @property
    def _contact_width(self) -> int:
        """Numbers of the sensors of contacts, which come first."""
        return len(self.cell.parts.points) * self.cell.parts.slots * CONTACT_WIDTH

    def _start(self, command: Command) -> Array:
        model = self.engine.model
        state = np.zeros(1 + model.nq + model.nv)
        state[1 : 1 + model.nq] = self.motion.start(float(command.offset[0]))
        return state

    def _read(self, state: Array, sensed: Array) -> Pass:
        parts, tool = self.cell.parts, self.cell.tool
        width = self._contact_width
        contact = sensed[:, :width].reshape(len(sensed), len(parts.points), parts.slots, -1)
        tip, axis = sensed[:, width : width + 3], sensed[:, width + 3 : width + 6]
        load = contact[..., 1]
        force = load.sum(axis=2)
        share = load / np.where(force > 0, force, 1.0)[:, :, None]
        # Of several facets the mean by load, or of all where none bears any.
        touches = (contact[..., 0] > 0).any(axis=2)

        def mean(first: int) -> Array:
            return np.asarray(np.einsum("tps,tpsc->tpc", share, contact[..., first : first + 3]))

        place, normal, tangent, velocity = mean(4), mean(7), mean(10), mean(13)
        bears = force > 0
        second = np.cross(normal, tangent)
        moved = velocity[..., 1:2] * tangent + velocity[..., 2:3] * second
        arm = place - tip[:, None]
        spun = 2 * math.pi * tool.spin * np.cross(axis[:, None], arm)
        spun -= np.sum(spun * normal, axis=2, keepdims=True) * normal
        slide = np.linalg.norm(moved + spun, axis=2)
        sideways = np.linalg.norm(contact[..., 2:4].sum(axis=2), axis=2)
        model = self.engine.model
        return Pass(
            time=np.asarray(self.timestep * np.arange(len(state)), dtype=np.float64),
            force=force,
            friction=sideways,
            place=np.where((touches & bears)[..., None], place, np.nan),
            normal=normal,
            slide=np.where(bears, slide, 0.0),
            angles=state[:, 1 + parts.joints],
            speeds=state[:, 1 + model.nq + parts.joints],
            tip=tip,
        )


_INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION


def _state_size(model: mujoco.MjModel, kind: mujoco.mjtState) -> int:
    return int(mujoco.mj_stateSize(model, kind))


def _stepped(
    model: mujoco.MjModel, starts: Array, controls: Array, timestep: float
) -> tuple[Array, Array]:
    """Return states and sensors of MuJoCo's own rollouts, as `dashpot.rollout` returns them."""
    from mujoco import rollout

    model.opt.timestep = timestep
    full = _state_size(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    starts = np.pad(starts, ((0, 0), (0, full - starts.shape[1])))
    states, sensors = rollout.rollout(model, mujoco.MjData(model), starts, controls)
    return np.asarray(states), np.asarray(sensors)
