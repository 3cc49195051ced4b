"""``dashpot grind``: plan a pass of an arm on the force of contact."""

from __future__ import annotations

import argparse
from typing import Any

from dashpot.cli.options import count, new_file, new_picture, new_report, new_table


def add_to(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "grind",
        help="plan a pass of an arm with a tool over a workpiece",
        description="Plan feed and force of a tool along a path, so that a depth comes off evenly "
        "in the least time; print what came out. Needs the extra dashpot[grinding].",
        epilog="`dashpot grind --format` prints what a cell file looks like.",
    )
    parser.add_argument("cell", nargs="?", help="cell file, .toml")
    parser.add_argument("--format", action="store_true", help="print the format of cell files")
    parser.add_argument(
        "--check",
        action="store_true",
        help="simulate the plan at a smaller step, with another friction and stiffness, and in "
        "MuJoCo",
    )
    parser.add_argument(
        "--save", type=new_table, metavar="FILE", help="write set points as a .csv table"
    )
    parser.add_argument("--plot", type=new_picture, metavar="FILE", help="draw the depth")
    parser.add_argument(
        "--report", type=new_report, metavar="FILE", help="write a report as one HTML file"
    )
    parser.add_argument("--video", type=new_file, metavar="FILE", help="write an animation, .gif")
    parser.add_argument("--threads", type=count, help="default: one per core")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    import sys

    from rich.console import Console

    from dashpot import grinding
    from dashpot.cli.cell_file import FORMAT, read_task

    if arguments.format:
        print(FORMAT, end="")
        return 0
    if arguments.cell is None:
        raise ValueError("grind: no cell file; `dashpot grind --format` prints what one looks like")
    task = read_task(arguments.cell)
    shown = sys.stderr.isatty()
    cell, path = task.cell, task.path
    options: dict[str, Any] = {"nthread": arguments.threads, "progress": shown}
    if task.log is not None:
        trial = grinding.press_trial(cell, task.log, **options)
        print(trial)
        cell = trial.cell
    made = grinding.plan(cell, path, **task.options, **options)
    print(made)
    checks = made.check(nthread=arguments.threads) if arguments.check else None
    if checks is not None:
        Console().print(checks.table())
    if arguments.save is not None:
        print(f"wrote {made.save(arguments.save)}")
    if arguments.plot is not None:
        made.plot(arguments.plot)
        print(f"wrote {arguments.plot}")
    if arguments.report is not None:
        print(f"wrote {made.report(arguments.report, checks=checks)}")
    if arguments.video is not None:
        print(f"wrote {made.video(arguments.video)}")
    return 0 if made.met else 1
