"""How robosuite 1.5 calls MuJoCo, whose names and enumerations changed since.

Two of its calls fail with MuJoCo 3.10 and later: ``mj_fullM(model, dense, data.qM)``, which is
``mj_fullM(model, data, dense)`` now, and addresses of joints, whose types no longer equal numpy's
integers. Its classes make them where nothing of a single environment could be put in between.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import mujoco
import numpy as np

_POSITIONS = {mujoco.mjtJoint.mjJNT_FREE.value: 7, mujoco.mjtJoint.mjJNT_BALL.value: 4}
_VELOCITIES = {mujoco.mjtJoint.mjJNT_FREE.value: 6, mujoco.mjtJoint.mjJNT_BALL.value: 3}


def accept_calls_of_older_mujoco() -> None:
    """Let robosuite, where it is imported, make the calls that it makes; a second time is none."""
    bindings = sys.modules.get("robosuite.utils.binding_utils")
    controllers = sys.modules.get("robosuite.controllers.parts.controller")
    if bindings is None or controllers is None or isinstance(controllers.mujoco, _OlderMujoco):
        return
    # The data themselves stand for their inertia: the function that takes it needs all of them.
    bindings.MjData.qM = property(lambda data: data._data)
    bindings.MjModel.get_joint_qpos_addr = _qpos_address
    bindings.MjModel.get_joint_qvel_addr = _qvel_address
    controllers.mujoco = _OlderMujoco("mujoco")  # type: ignore[attr-defined]


class _OlderMujoco(ModuleType):
    """MuJoCo with ``mj_fullM`` as it is called before and after 3.10."""

    def __getattr__(self, name: str) -> Any:
        return getattr(mujoco, name)

    @staticmethod
    def mj_fullM(model: mujoco.MjModel, first: Any, second: Any) -> None:  # noqa: N802
        older = isinstance(first, np.ndarray)
        mujoco.mj_fullM(model, *((second, first) if older else (first, second)))


def _qpos_address(model: Any, name: str) -> Any:
    """Return where positions of a joint are: an index, or a first one and that behind the last."""
    joint = model.joint_name2id(name)
    return _address(model.jnt_qposadr[joint], _POSITIONS.get(int(model.jnt_type[joint]), 1))


def _qvel_address(model: Any, name: str) -> Any:
    """Return where velocities of a joint are, as positions."""
    joint = model.joint_name2id(name)
    return _address(model.jnt_dofadr[joint], _VELOCITIES.get(int(model.jnt_type[joint]), 1))


def _address(first: Any, count: int) -> Any:
    return first if count == 1 else (first, first + count)
