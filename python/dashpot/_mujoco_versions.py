"""What the build and the import of the extensions have to agree on about versions of MuJoCo.

MuJoCo's structs change with every minor release, so there is one extension per minor version. A
release with another last number may change them too: its headers tell.

This file imports nothing but the standard library. As a program it tells CMake about a folder of
the package mujoco, and for pyproject.toml it adds the requirement of MuJoCo.

    usage: _mujoco_versions.py FOLDER          ("installed": what this Python has)
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

__all__ = ["SUPPORTED", "header_digest", "minor_version", "requirement"]

SUPPORTED = ("3.15", "3.16", "3.17", "4.0")
_HEADERS = ("mjtype.h", "mjmodel.h", "mjdata.h")


def minor_version(version: str) -> str:
    """Return "3.17" of "3.17.0"."""
    return ".".join(version.split(".")[:2])


def requirement(minor_versions: list[str]) -> str:
    """Return what pip may install for extensions built for these minor versions."""
    if len(minor_versions) == 1:
        return f"mujoco=={minor_versions[0]}.*"
    in_order = sorted(minor_versions, key=lambda minor: tuple(map(int, minor.split("."))))
    major, minor = in_order[-1].split(".")
    return f"mujoco>={in_order[0]},<{major}.{int(minor) + 1}"


def header_digest(folder: Path) -> str:
    """Return a digest of the structs and enums that MuJoCo's headers declare.

    `folder` is that of the package mujoco. Comments and white space do not count.
    """
    digest = hashlib.sha256()
    for name in _HEADERS:
        text = (folder / "include" / "mujoco" / name).read_text(encoding="utf-8")
        text = re.sub(r"//.*|/\*(?s:.*?)\*/", "", text)
        digest.update(" ".join(text.split()).encode())
    return digest.hexdigest()[:16]


def _installed() -> Path:
    # The package is located without importing it, which would load OpenGL.
    spec = importlib.util.find_spec("mujoco")
    if spec is None or not spec.submodule_search_locations:
        sys.exit(
            f"dashpot builds against the package mujoco, which {sys.executable} does not have.\n"
            f"Install it with:  {sys.executable} -m pip install 'mujoco==3.17.*'"
        )
    return Path(spec.submodule_search_locations[0])


def _version_in(folder: Path) -> str:
    """Return the version of the package mujoco in a folder, which dashpot must support."""
    libraries = sorted(folder.glob("libmujoco.so.*"))
    if len(libraries) != 1:
        sys.exit(f"{folder} holds {len(libraries)} files libmujoco.so.*, where one is expected.")
    version = libraries[0].name.removeprefix("libmujoco.so.")
    if minor_version(version) not in SUPPORTED:
        sys.exit(
            f"{folder} holds mujoco {version}; dashpot builds against {', '.join(SUPPORTED)}.\n"
            f"Install one of them, such as:  {sys.executable} -m pip install 'mujoco==3.17.*'"
        )
    return version


def dynamic_metadata(settings: Mapping[str, Any], project: Mapping[str, Any]) -> dict[str, Any]:
    """Return the dependencies of what is built, as scikit-build-core asks for them."""
    folders = os.environ.get("DASHPOT_MUJOCO", "")
    of_wheel = [Path(folder) for folder in folders.split(";") if folder] or [_installed()]
    minor_versions = [minor_version(_version_in(folder)) for folder in of_wheel]
    return {"dependencies": [requirement(minor_versions), *settings["dependencies"]]}


def dynamic_wheel(settings: Mapping[str, Any]) -> dict[str, bool]:
    """Return the fields of which a wheel's may differ from those of the source archive."""
    return {"dependencies": True}


def _main(argument: str) -> None:
    """Print version, minor version, folder and digest of the headers as a list of CMake."""
    folder = _installed() if argument == "installed" else Path(argument)
    version = _version_in(folder)
    print(version, minor_version(version), folder, header_digest(folder), sep=";")


if __name__ == "__main__":
    _main(sys.argv[1])
