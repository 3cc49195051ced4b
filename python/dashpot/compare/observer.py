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
