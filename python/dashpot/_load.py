"""Loads the extension module, or says how to repair an installation where that fails.

The extension is linked to one version of MuJoCo, which `import mujoco` loads, and to the system's
FCL. Whatever is missing or does not match is an ImportError that names the remedy.
"""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from types import ModuleType

__all__ = ["__version__", "core"]


def _import_mujoco() -> ModuleType:
    try:
        return importlib.import_module("mujoco")
    except ModuleNotFoundError as error:
        if error.name != "mujoco":
            raise
        raise ImportError(
            "dashpot needs the package mujoco, which is not installed. "
            "Install dashpot with its requirements:  pip install ."
        ) from error


def _wrong_mujoco(built: str, present: str) -> str:
    return (
        f"dashpot was built against mujoco {built}, but mujoco {present} is installed; the layout "
        f"of mjModel and mjData differs between versions. Remedy:  pip install mujoco=={built}"
    )


def _remedy(error: ImportError, mujoco_version: str) -> str | None:
    """Return what to tell the user about a failed import of the extension, if that is known."""
    if isinstance(error, ModuleNotFoundError) and error.name == "dashpot._core":
        folder = Path(__file__).parent
        others = sorted(file.name for file in folder.glob("_core.*.so"))
        if others:
            return (
                f"the extension in {folder} is built for another Python ({', '.join(others)}). "
                "Install dashpot for this one, in its source folder:  pip install ."
            )
        return (
            f"{folder} holds no built extension module dashpot._core: it is a source tree, not an "
            "installation. In the folder of pyproject.toml:  pip install ."
        )
    mujoco_library = re.search(r"libmujoco\.so\.(\d+\.\d+\.\d+): cannot open", str(error))
    if mujoco_library:
        return _wrong_mujoco(mujoco_library[1], mujoco_version)
    system_library = re.search(r"(lib(?:fcl|ccd|octomap|octomath))\.so\S*: cannot open", str(error))
    if system_library:
        return (
            f"dashpot needs the shared library {system_library[1]}, which is not installed. "
            "On Debian 12:  apt-get install libfcl0.7  (elsewhere install libfcl-dev, then rebuild "
            "dashpot:  pip install --force-reinstall --no-deps .)"
        )
    return None


def _load_core() -> ModuleType:
    # MuJoCo comes first: the extension then binds to the library that is already loaded.
    mujoco = _import_mujoco()
    try:
        extension = importlib.import_module("dashpot._core")
    except ImportError as error:
        remedy = _remedy(error, mujoco.__version__)
        if remedy is None:
            raise
        raise ImportError(remedy, name="dashpot._core") from error
    if mujoco.mj_versionString() != extension.__mujoco_version__:
        raise ImportError(
            _wrong_mujoco(extension.__mujoco_version__, mujoco.mj_versionString()),
            name="dashpot._core",
        )
    return extension


core = _load_core()
__version__: str = core.__version__
