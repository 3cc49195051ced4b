"""The ``dashpot`` command: demo, calibrate, compare, grind, simulate, view and data.

Exit codes: 0, done; 1, the input or the run failed, said in one line on standard error; 2, the
command line itself was wrong; 130, interrupted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import metadata

from dashpot.cli import calibrate, compare, data, demo, grind, simulate, view

_COMMANDS = (demo, calibrate, compare, grind, simulate, view, data)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code.

    Parameters
    ----------
    arguments
        Words after the program's name; None takes the process's own.
    """
    parsed = parser().parse_args(arguments)
    try:
        return int(parsed.run(parsed))
    except KeyboardInterrupt:
        print("dashpot: interrupted", file=sys.stderr)
        return 130
    except (ValueError, TypeError, KeyError, OSError, RuntimeError) as error:
        print(f"dashpot: error: {_one_line(error)}", file=sys.stderr)
        return 1


def parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    root = argparse.ArgumentParser(
        prog="dashpot",
        description="Closed-form contact dynamics for MuJoCo models.",
        epilog="`dashpot COMMAND --help` tells more of a command.",
    )
    root.add_argument("--version", action="version", version=f"dashpot {_version()}")
    commands = root.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for module in _COMMANDS:
        module.add_to(commands)
    return root


def _version() -> str:
    try:
        return metadata.version("dashpot")
    except metadata.PackageNotFoundError:
        return "(not installed)"


def _one_line(error: Exception) -> str:
    text = error.args[0] if isinstance(error, KeyError) and error.args else error
    return " ".join(str(text).split()) or type(error).__name__
