"""Measures any state in one and the same way, whatever stepped it there."""

from __future__ import annotations

import copy

import mujoco
import numpy as np
from numpy.typing import NDArray


class Observer:
    """Penetration and mechanical energy of states of one model.

    Every state is put into a copy of the pristine model, collision and energies are evaluated
    afresh: nothing that a solver reports of itself enters. Penetration is the geometric overlap
    of a contact, ``-dist`` where ``dist < 0``; margins do not count.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = copy.deepcopy(model)
        self._data = mujoco.MjData(self._model)
        self._driven = bool(model.nu or model.ngravcomp)
        self._before: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None

    def measure(self, state: mujoco.MjData) -> tuple[NDArray[np.float64], float, float]:
        """Return the depths (m) of all touching contacts, kinetic and potential energy (J).

        Parameters
        ----------
        state
            Data of a model of the same bodies. Time, positions and velocities and the poses of
            mocap bodies are read: kinematics, collision and energies depend on nothing else.
        """
        model, data = self._model, self._data
        data.time = state.time
        data.qpos[:] = state.qpos
        data.qvel[:] = state.qvel
        data.mocap_pos[:] = state.mocap_pos
        data.mocap_quat[:] = state.mocap_quat
        mujoco.mj_fwdKinematics(model, data)
        mujoco.mj_makeM(model, data)
        mujoco.mj_collision(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        distances = np.asarray(data.contact.dist)
        potential, kinetic = data.energy
        return -distances[distances < 0], float(kinetic), float(potential)

    def work(self, state: mujoco.MjData) -> float:
        """Return what actuators and gravity compensation did since the last call, J.

        It is their mean force at both states, of the pristine model, times the way between them.
        `measure` comes first. 0 in the first call, and of models that nothing drives.
        """
        if not self._driven:
            return 0.0
        model, data = self._model, self._data
        data.ctrl[:] = state.ctrl
        data.act[:] = state.act
        mujoco.mj_transmission(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        force = data.qfrc_actuator + data.qfrc_gravcomp
        before, self._before = self._before, (np.array(data.qpos), force)
        if before is None:
            return 0.0
        way = np.empty(model.nv)
        mujoco.mj_differentiatePos(model, way, 1.0, before[0], data.qpos)
        return float(0.5 * (before[1] + force) @ way)

    def begin(self) -> None:
        """Forget the last state: another run begins."""
        self._before = None
