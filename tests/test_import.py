"""Room _load: importing dashpot works in any order, and a broken installation names its remedy."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import mujoco
import pytest

import dashpot
from dashpot import _core
from dashpot._load import _check_structs
from dashpot._mujoco_versions import SUPPORTED, minor_version, requirement

PACKAGE = Path(dashpot.__file__).parent
EXTENSION = Path(_core.__file__).resolve()


def run_python(code: str, *paths: Path) -> subprocess.CompletedProcess[str]:
    """Run code in a fresh interpreter that finds modules in `paths` before any others."""
    environment = dict(os.environ)
    inherited = environment.get("PYTHONPATH", "")
    environment["PYTHONPATH"] = os.pathsep.join([*map(str, paths), inherited]).rstrip(os.pathsep)
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False
    )


def import_error(code: str, *paths: Path) -> str:
    """Run code, which must raise ImportError; return the error's line."""
    result = run_python(code, *paths)
    assert result.returncode == 1, result.stdout + result.stderr
    last_line = result.stderr.strip().splitlines()[-1]
    assert last_line.startswith("ImportError: "), result.stderr
    return last_line


@pytest.fixture
def package_copy(tmp_path: Path) -> Path:
    """Return a folder with a copy of the Python sources of dashpot, without the extension."""
    shutil.copytree(PACKAGE, tmp_path / "dashpot", ignore=shutil.ignore_patterns("*.so", "*.pyc"))
    return tmp_path


def copy_extension(folder: Path, library: bytes) -> None:
    """Copy the extension into folder and make it need a library that no machine has."""
    content = EXTENSION.read_bytes()
    assert content.count(library) == 1
    absent = library[:-1] + b"_"  # of the same length: the tables of an ELF file hold offsets
    (folder / "dashpot" / EXTENSION.name).write_bytes(content.replace(library, absent))


def other_mujoco(folder: Path, version: str) -> Path:
    """Make a package mujoco that says it is of this version; return its folder."""
    (folder / "mujoco").mkdir()
    (folder / "mujoco" / "__init__.py").write_text(
        f"__version__ = {version!r}\ndef mj_versionString(): return __version__\n"
    )
    return folder


def test_versions_are_those_of_the_build() -> None:
    assert minor_version(_core.__mujoco_version__) == minor_version(mujoco.mj_versionString())
    assert dashpot.__version__ == _core.__version__


def test_dashpot_can_be_imported_before_mujoco() -> None:
    result = run_python("import dashpot, mujoco; print(mujoco.mj_versionString())")
    assert result.stdout.strip() == mujoco.mj_versionString(), result.stderr


def test_the_extension_is_found_as_a_module() -> None:
    result = run_python("import dashpot._core as a; from dashpot import _core as b; print(a is b)")
    assert result.stdout.strip() == "True", result.stderr


def test_mujoco_missing() -> None:
    message = import_error("import sys; sys.modules['mujoco'] = None; import dashpot")
    assert "needs the package mujoco" in message
    assert "pip install" in message


@pytest.mark.parametrize("version", ["3.14.0", "5.0.0"])
def test_mujoco_that_is_not_supported(tmp_path: Path, version: str) -> None:
    message = import_error("import dashpot", other_mujoco(tmp_path, version))
    assert f"mujoco {version} is installed" in message
    assert minor_version(_core.__mujoco_version__) in message
    assert "pip install 'mujoco" in message


def test_supported_mujoco_for_which_there_is_no_extension(
    package_copy: Path, tmp_path: Path
) -> None:
    built = minor_version(_core.__mujoco_version__)
    other = next(minor for minor in SUPPORTED if minor != built)
    shutil.copy(EXTENSION, package_copy / "dashpot" / EXTENSION.name)
    message = import_error("import dashpot", package_copy, other_mujoco(tmp_path, f"{other}.0"))
    assert f"built for mujoco {built}. Remedy:  pip install 'mujoco=={built}.*'" in message
    assert "--no-build-isolation" in message


def test_patch_release_counts_by_its_headers(tmp_path: Path) -> None:
    def check(folder: Path) -> None:
        patched = ModuleType("mujoco")
        patched.mj_versionString = lambda: "9.9.9"  # type: ignore[attr-defined]
        patched.__file__ = str(folder / "mujoco" / "__init__.py")
        _check_structs(patched, _core)

    headers = tmp_path / "mujoco" / "include" / "mujoco"
    shutil.copytree(Path(mujoco.__file__).parent / "include" / "mujoco", headers)
    data = headers / "mjdata.h"
    data.write_text("// comments do not count\n" + data.read_text())
    check(tmp_path)
    data.write_text(data.read_text().replace("mjtNum* qpos;", "mjtNum* more;\n  mjtNum* qpos;"))
    with pytest.raises(ImportError, match=r"mujoco 9\.9\.9 is installed, whose structs are not"):
        check(tmp_path)
    with pytest.raises(ImportError, match="pip install 'mujoco=="):
        check(tmp_path / "without headers")


def test_requirement_by_what_is_built() -> None:
    assert requirement(["3.17"]) == "mujoco==3.17.*"
    assert requirement(["4.0", "3.15", "3.17"]) == "mujoco>=3.15,<4.1"


def test_source_tree_without_extension(package_copy: Path) -> None:
    message = import_error("import dashpot", package_copy)
    assert str(package_copy / "dashpot") in message
    assert "pip install ." in message


def test_extension_of_another_python(package_copy: Path) -> None:
    (package_copy / "dashpot" / "_core_3_17.cpython-27-x86_64-linux-gnu.so").touch()
    message = import_error("import dashpot", package_copy)
    assert "built for another Python (_core_3_17.cpython-27-x86_64-linux-gnu.so)" in message


@pytest.mark.skipif(
    (EXTENSION.parents[1] / "dashpot.libs").is_dir(), reason="the wheel brings its own FCL"
)
def test_fcl_missing(package_copy: Path) -> None:
    copy_extension(package_copy, b"libfcl.so.0.7")
    message = import_error("import dashpot", package_copy)
    assert "needs the shared library libfcl" in message
    assert "apt-get install libfcl0.7" in message


# pinocchio brings another FCL (coal) and another version of octomap, whose symbols have the names
# of those that the system's libfcl needs. RTLD_GLOBAL is the worst case: pinocchio's symbols then
# come first for every library that is loaded later.
QUERY = """
import numpy
model = mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
  <body><freejoint/><geom name="box" type="box" size=".1 .2 .3"/></body>
  <body pos="1 0 0"><freejoint/><geom name="capsule" type="capsule" size=".1 .2"/></body>
</worldbody></mujoco>''')
engine = dashpot.Engine(model)
data = engine.make_data()
mujoco.mj_forward(engine.model, data)
distance = dashpot.distance(engine, data, "box", "capsule").distance
assert abs(distance - 0.8) < 1e-6, distance
pairs = dashpot.closest(engine, data, radius=1.0)  # by a tree of libfcl
assert pairs.distance.shape == (1,), pairs
"""
PINOCCHIO = """
import pinocchio, coal
box, pose = coal.Box(0.2, 0.4, 0.6), coal.Transform3s()
pose.setTranslation(numpy.array([1.0, 0.0, 0.0]))
near = coal.DistanceResult()
coal.distance(box, coal.Transform3s(), box, pose, coal.DistanceRequest(), near)
assert abs(near.min_distance - 0.8) < 1e-6, near.min_distance
print('both work')
"""


@pytest.mark.skipif(importlib.util.find_spec("pinocchio") is None, reason="needs the package pin")
@pytest.mark.parametrize(
    "imports",
    [
        "import mujoco, dashpot, pinocchio",
        "import pinocchio, mujoco, dashpot",
        "import os, sys; sys.setdlopenflags(os.RTLD_NOW | os.RTLD_GLOBAL)\n"
        "import pinocchio, coal, mujoco, dashpot",
    ],
    ids=["dashpot first", "pinocchio first", "pinocchio first and global"],
)
def test_beside_pinocchio(imports: str) -> None:
    result = run_python(imports + QUERY + PINOCCHIO)
    assert result.stdout.strip() == "both work", result.stderr


def test_names_that_are_imported_when_first_used_can_be_listed():
    listed = dir(dashpot)
    assert {"Engine", "calibrate", "compare", "law", "__version__"} <= set(listed)
    assert "TYPE_CHECKING" not in listed
