"""``dashpot data``: reference data."""

from __future__ import annotations

import argparse
from typing import Any

from dashpot.cli.options import progress_bar


def add_to(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "data",
        help="download reference data",
        description="Download published reference data, check and convert them.",
    )
    sets = parser.add_subparsers(title="data sets", metavar="DATA", required=True)
    tosses = sets.add_parser(
        "cube-tosses",
        help="real tosses of a cube onto a table (ContactNets, 148 Hz, BSD-3-Clause)",
        description="Download the cube tosses that ContactNets published, from a fixed commit of "
        "its repository, without executing the pickles that they are. The converted poses of 400 "
        "tosses are pinned by SHA-256 and refused if they differ; the other 170 have no pin and "
        "come only with --all, checked for structure.",
    )
    tosses.add_argument(
        "--out", metavar="DIR", help="default: the user's cache, where dashpot looks for them"
    )
    tosses.add_argument("--all", action="store_true", help="also the 170 tosses without a pin")
    tosses.add_argument("--base-url", metavar="URL", help="folder of the N.pt files, for a mirror")
    tosses.set_defaults(run=run_cube_tosses)


def run_cube_tosses(arguments: argparse.Namespace) -> int:
    """Run ``dashpot data cube-tosses``."""
    from dashpot.data import download_cube_tosses, load_cube_tosses

    with progress_bar("downloading", 1.0) as (bar, task):
        file = download_cube_tosses(
            arguments.out,
            base_url=arguments.base_url,
            tosses="all" if arguments.all else "pinned",
            progress=lambda done, total: bar.update(task, completed=done / total),
        )
    print(f"{len(load_cube_tosses(file))} tosses in {file}")
    return 0
