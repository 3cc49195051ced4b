"""Loads the extension that fits the MuJoCo that is there, or says what to install.

There is one extension for each minor version of MuJoCo: wheels hold one for every supported
version, a build from source one for the version it was built against. All are the module
`dashpot._core`. They take MuJoCo's functions from the library that `import mujoco` loads. Whatever
is missing or does not match is an ImportError that names the remedy.
"""

from __future__ import annotations

import ctypes
import importlib
import importlib.machinery
import importlib.util
import os
import re
import sys
from pathlib import Path
from types import ModuleType

from dashpot._mujoco_versions import SUPPORTED, header_digest, minor_version, requirement

__all__ = ["__version__", "core"]

_NAME = "dashpot._core"
_FOLDER = Path(__file__).parent


def _import_mujoco() -> ModuleType:
    try:
        return importlib.import_module("mujoco")
    except ModuleNotFoundError as error:
        if error.name != "mujoco":
            raise
        raise ImportError(
            "dashpot needs the package mujoco, which is not installed. Install it:  "
            f"pip install '{requirement(_built_for() or list(SUPPORTED))}'"
        ) from error


def _extension_file(minor: str) -> Path | None:
    for suffix in importlib.machinery.EXTENSION_SUFFIXES:
        file = _FOLDER / f"_core_{minor.replace('.', '_')}{suffix}"
        if file.exists():
            return file
    return None


def _built_for() -> list[str]:
    """Return the minor versions of MuJoCo for which there is an extension."""
    return [minor for minor in SUPPORTED if _extension_file(minor)]


def _no_extension() -> str:
    """Return what to tell the user for whose Python there is no extension."""
    others = sorted(file.name for file in _FOLDER.glob("_core_*.so"))
    if others:
        return (
            f"the extension in {_FOLDER} is built for another Python ({', '.join(others)}). "
            "Install dashpot for this one, in its source folder:  pip install ."
        )
    return (
        f"{_FOLDER} holds no built extension module {_NAME}: it is a source tree, not an "
        "installation. In the folder of pyproject.toml:  pip install ."
    )


def _no_extension_for(mujoco_version: str, built_for: list[str]) -> str:
    """Return what to tell the user whose MuJoCo no extension fits."""
    message = (
        f"mujoco {mujoco_version} is installed, but this dashpot was built for mujoco "
        f"{', '.join(built_for)}. Remedy:  pip install '{requirement(built_for)}'"
    )
    if minor_version(mujoco_version) in SUPPORTED:
        message += (
            "  (or build dashpot for the one installed, in its source folder:  "
            "pip install scikit-build-core pybind11; "
            "pip install --no-build-isolation --no-deps --force-reinstall .)"
        )
    elif len(built_for) < len(SUPPORTED):
        message += f"  (dashpot supports mujoco {', '.join(SUPPORTED)})"
    return message


def _check_structs(mujoco: ModuleType, extension: ModuleType) -> None:
    """Raise ImportError where a release of the same minor version has other structs."""
    version = mujoco.mj_versionString()
    if version == extension.__mujoco_version__:
        return
    try:
        digest = header_digest(Path(mujoco.__file__ or "").parent)
    except OSError:
        digest = "unknown"
    if digest != extension.__mujoco_headers__:
        built = extension.__mujoco_version__
        raise ImportError(
            f"mujoco {version} is installed, whose structs are not those of mujoco {built}, for "
            f"which dashpot was built. Remedy:  pip install 'mujoco=={built}'",
            name=_NAME,
        )


def _missing(error: ImportError, mujoco_version: str) -> str | None:
    """Return what to tell the user about a failed import of the extension, if that is known."""
    function = re.search(r"undefined symbol: (_?mj\w+)", str(error))
    if function:
        return (
            f"mujoco {mujoco_version} is installed, which has no {function[1]}. Remedy:  "
            f"pip install 'mujoco=={minor_version(mujoco_version)}.0'"
        )
    library = re.search(r"(lib(?:fcl|ccd|octomap|octomath))\.so\S*: cannot open", str(error))
    if not library:
        return None
    return (
        f"dashpot needs the shared library {library[1]}, which is not installed. "
        "On Debian 12:  apt-get install libfcl0.7  (elsewhere install libfcl-dev, then rebuild "
        "dashpot:  pip install --force-reinstall --no-deps .)"
    )


def _load_core() -> ModuleType:
    mujoco = _import_mujoco()
    version = mujoco.mj_versionString()
    file = _extension_file(minor_version(version))
    if file is None:
        built_for = _built_for()
        problem = _no_extension_for(version, built_for) if built_for else _no_extension()
        raise ImportError(problem, name=_NAME)
    # The extension finds MuJoCo's functions among global symbols: the name of the library, which it
    # would otherwise be linked to, has the full version.
    try:
        ctypes.CDLL(f"libmujoco.so.{version}", mode=os.RTLD_NOLOAD | os.RTLD_GLOBAL)
    except OSError as error:
        raise ImportError(f"import mujoco loaded no libmujoco.so.{version}", name=_NAME) from error
    spec = importlib.util.spec_from_file_location(_NAME, file)
    assert spec is not None
    assert spec.loader is not None
    try:
        extension = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(extension)
    except ImportError as error:
        remedy = _missing(error, version)
        if remedy is None:
            raise
        raise ImportError(remedy, name=_NAME) from error
    _check_structs(mujoco, extension)
    # As the import system leaves a module: `import dashpot._core` finds it.
    sys.modules[_NAME] = extension
    setattr(sys.modules["dashpot"], "_core", extension)  # noqa: B010
    return extension


core = _load_core()
__version__: str = core.__version__
