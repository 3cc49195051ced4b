"""Check how the installed extension was linked.

It must take MuJoCo from what is loaded, show nothing but its entry point, and not remember a folder
of the machine it was built on.

usage: check_extension.py FOLDER...      folders that the extension must not mention
"""

import re
import subprocess
import sys

from dashpot import _core


def output(*command: str) -> str:
    """Return what the command prints."""
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def main(folders: list[str]) -> None:
    """Check the installed extension; raise SystemExit with what is wrong."""
    path = _core.__file__
    dynamic = output("readelf", "-d", path)
    run_paths = re.findall(r"R(?:UN)?PATH.*\[(.*)\]", dynamic)
    if run_paths:
        sys.exit(f"{path} looks for libraries in {run_paths}")
    needed = re.findall(r"NEEDED.*\[(.*)\]", dynamic)
    if any(name.startswith("libmujoco") for name in needed):
        sys.exit(f"{path} is bound to one version of MuJoCo: {needed}")
    visible = [line.split()[-1] for line in output("nm", "-D", "--defined-only", path).splitlines()]
    if visible != ["PyInit__core"]:
        sys.exit(f"{path} shows the symbols {visible}")
    with open(path, "rb") as file:
        content = file.read()
    remembered = [folder for folder in folders if folder.encode() in content]
    if remembered:
        sys.exit(f"{path} mentions {remembered}")
    print(f"{path}\nneeds", ", ".join(needed))


if __name__ == "__main__":
    main(sys.argv[1:])
