"""Models that are given compiled, as a specification, as a file or as text."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TypeAlias

import mujoco

__all__ = ["ModelLike", "compiled", "read_model"]

ModelLike: TypeAlias = "mujoco.MjModel | mujoco.MjSpec | str | os.PathLike[str]"


def compiled(model: ModelLike) -> mujoco.MjModel:
    """Return the compiled model of what stands for one.

    Parameters
    ----------
    model
        Compiled already, an ``MjSpec``, the path of a file, or MJCF text, which begins with "<".

    Raises
    ------
    TypeError
        If it is none of these.
    FileNotFoundError
        If there is no such file.
    ValueError
        If it cannot be compiled; the message is MuJoCo's.
    """
    if isinstance(model, mujoco.MjModel):
        return model
    if isinstance(model, mujoco.MjSpec):
        return model.compile()
    if isinstance(model, str) and model.lstrip().startswith("<"):
        return mujoco.MjModel.from_xml_string(model)
    if isinstance(model, str | os.PathLike):
        return read_model(model)
    raise TypeError(
        f"model is {type(model).__name__}; it must be a mujoco.MjModel, a mujoco.MjSpec, "
        "the path of a file or MJCF text"
    )


def read_model(path: str | os.PathLike[str]) -> mujoco.MjModel:
    """Compile an MJCF or URDF file, or read a ``.mjb``.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it cannot be compiled; the message has the path and what MuJoCo says.
    """
    path = Path(path)
    if not os.path.isfile(path):
        raise FileNotFoundError(f"no model file {path}")
    try:
        if path.suffix == ".mjb":
            return mujoco.MjModel.from_binary_path(str(path))
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from error
