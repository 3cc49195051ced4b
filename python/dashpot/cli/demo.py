"""``dashpot demo``: calibration and comparison on one page."""

from __future__ import annotations

import argparse
from typing import Any

from dashpot.cli.options import count, folder, seed


def add_to(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "demo",
        help="calibrate and compare on shipped scenes and real data, and write a report",
        description="Fit hidden contact parameters of a simulated body, fit real cube tosses where "
        "they are present, and compare penetration and energy decay of a pile with MuJoCo. Takes "
        "less than a minute on two cores; needs neither network nor display.",
    )
    parser.add_argument(
        "--out",
        type=folder,
        default="dashpot-report",
        metavar="DIR",
        help="folder of the report (%(default)s)",
    )
    parser.add_argument(
        "--data",
        metavar="PATH",
        help="cube tosses: file or folder; default: $DASHPOT_DATA, then the user's cache",
    )
    parser.add_argument("--seed", type=seed, default=0, help="of everything random (%(default)s)")
    parser.add_argument("--threads", type=count, help="default: one per core")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    from dashpot.demo import run_demo

    run_demo(arguments.out, data=arguments.data, seed=arguments.seed, threads=arguments.threads)
    return 0
