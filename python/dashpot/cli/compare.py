"""``dashpot compare``: one scene stepped by dashpot and by MuJoCo."""

from __future__ import annotations

import argparse
from typing import Any

from dashpot.cli.options import (
    add_material,
    add_scene,
    add_threads,
    folder,
    load_engine,
    new_report,
    positive,
    progress_bar,
)


def add_to(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "compare",
        help="compare penetration and energy decay of a scene with MuJoCo",
        description="Step a scene from the same state with dashpot and with MuJoCo settings, and "
        "print penetration and energy of each run, measured alike.",
    )
    add_scene(parser)
    parser.add_argument("--duration", type=positive, metavar="S", help="seconds to simulate")
    parser.add_argument("--timestep", type=positive, metavar="S", help="default: the scene's")
    parser.add_argument(
        "--settings",
        metavar="A,B,...",
        help="dashpot, mujoco-default, elliptic, impratio, "
        "noslip, solref-direct, discrete; default: all but noslip",
    )
    add_material(parser)
    add_threads(parser)
    parser.add_argument(
        "--out", type=folder, metavar="DIR", help="write comparison.json and comparison.png there"
    )
    parser.add_argument(
        "--report", type=new_report, metavar="FILE", help="write a report as one HTML file"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    import json
    from pathlib import Path

    from rich.console import Console

    from dashpot import compare

    settings: tuple[str, ...] = compare.DEFAULT_SETTINGS
    if arguments.settings is not None:
        settings = tuple(name.strip() for name in arguments.settings.split(","))
    engine = load_engine(arguments.scene, arguments.material, arguments.threads)
    duration = arguments.duration
    if duration is None and arguments.scene in compare.SCENES:
        duration = compare.scene(arguments.scene).duration
    with progress_bar("stepping", len(settings)) as (bar, task):
        done: dict[str, float] = {}

        def report(setting: str, share: float) -> None:
            done[setting] = share
            bar.update(task, completed=sum(done.values()), description=setting)

        comparison = compare.run(
            engine,
            duration=duration,
            timestep=arguments.timestep,
            settings=settings,
            name=Path(arguments.scene).stem,
            progress=report,
        )
    Console().print(comparison.table())
    print(comparison.explanation())
    if arguments.out is not None:
        out: Path = arguments.out
        out.mkdir(parents=True, exist_ok=True)
        (out / "comparison.json").write_text(json.dumps(comparison.to_dict()), encoding="utf-8")
        comparison.plot(out / "comparison.png")
        print(f"wrote {out / 'comparison.json'} and {out / 'comparison.png'}")
    if arguments.report is not None:
        comparison.report(arguments.report)
        print(f"wrote {arguments.report}")
    return 0
