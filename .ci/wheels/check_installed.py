"""Check an installed wheel: which MuJoCo it steps, and which libraries came with it.

usage: check_installed.py [MINOR]         the minor version of MuJoCo that is expected
"""

import re
import sys
from pathlib import Path

import mujoco

import dashpot
from dashpot import _core


def main(expected: str | None) -> None:
    """Raise SystemExit with what is wrong."""
    minor = ".".join(mujoco.mj_versionString().split(".")[:2])
    if expected not in (None, minor):
        sys.exit(f"mujoco {minor} is installed, not {expected}")
    if f"_core_{minor.replace('.', '_')}." not in _core.__file__:
        sys.exit(f"with mujoco {minor} the extension {_core.__file__} was loaded")
    mapped = set(re.findall(r"/\S.*", Path("/proc/self/maps").read_text()))
    brought = re.compile(r"/lib(fcl|ccd|octo)[^/]*\.so")
    libraries = sorted(path for path in mapped if brought.search(path))
    own = Path(dashpot.__file__).parents[1] / "dashpot.libs"
    if not libraries or any(Path(path).parent != own for path in libraries):
        sys.exit(f"libraries of FCL are not those of the wheel: {libraries}")
    print(f"dashpot {dashpot.__version__}, mujoco {mujoco.mj_versionString()}, {_core.__file__}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
