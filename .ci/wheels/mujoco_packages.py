"""Download one package mujoco of each supported minor version, and unpack them.

Extensions are built against their headers. Folders that are there already stay.

usage: mujoco_packages.py FOLDER        prints what DASHPOT_MUJOCO is to hold
"""

import re
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "python" / "dashpot"))
from _mujoco_versions import SUPPORTED


def unpacked(minor: str, folder: Path) -> Path:
    """Return the folder of the package mujoco of a minor version, in `folder`."""
    package = folder / minor / "mujoco"
    if package.exists():
        return package
    # From 4.0 on the library and its headers are in mujoco-core.
    name = "mujoco" if minor.startswith("3.") else "mujoco-core"
    with tempfile.TemporaryDirectory() as download:
        pip = (sys.executable, "-m", "pip", "download", "--quiet", "--no-deps")
        what = ("--only-binary=:all:", "--dest", download, f"{name}=={minor}.*")
        subprocess.run([*pip, *what], check=True)
        (wheel,) = Path(download).glob("*.whl")
        with zipfile.ZipFile(wheel) as archive:
            needed = re.compile(r"mujoco/(include/|libmujoco\.so)")
            archive.extractall(folder / minor, filter(needed.match, archive.namelist()))
    return package


def packages(folder: Path) -> str:
    """Return the folders of all supported versions, as DASHPOT_MUJOCO holds them."""
    return ";".join(str(unpacked(minor, folder.resolve())) for minor in SUPPORTED)


if __name__ == "__main__":
    print(packages(Path(sys.argv[1])))
