"""``dashpot simulate``: step a scene and store its states."""

from __future__ import annotations

import argparse
from typing import Any

from dashpot.cli.options import (
    add_material,
    add_scene,
    add_threads,
    load_engine,
    new_archive,
    new_table,
    positive,
    progress_bar,
)


def add_to(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "simulate",
        help="step a scene with dashpot and store its states",
        description="Step a scene from its first keyframe (or reference pose), print what happens, "
        "and write time, qpos, qvel, energies and contact counts of every step to a numpy .npz "
        "file.",
    )
    add_scene(parser)
    parser.add_argument(
        "--duration",
        "--seconds",
        type=positive,
        default=2.0,
        metavar="S",
        help="seconds (%(default)g)",
    )
    parser.add_argument("--timestep", type=positive, metavar="S", help="default: the scene's")
    parser.add_argument(
        "--fit",
        metavar="FILE",
        help="step with the values of a fit, as Fit.save or `dashpot calibrate --save` wrote it",
    )
    parser.add_argument(
        "--trajectory",
        metavar="NAME",
        help="of the fit: whose values count, where parameters have one for each",
    )
    add_material(parser)
    add_threads(parser)
    parser.add_argument(
        "--save",
        type=new_table,
        metavar="FILE",
        help="write the poses of the moving bodies as a .csv table that `calibrate` reads",
    )
    parser.add_argument(
        "--out",
        type=new_archive,
        default="states.npz",
        metavar="FILE",
        help="where to write (%(default)s)",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    import numpy as np
    from rich.console import Console

    from dashpot.cli.motion import happenings, write_poses
    from dashpot.compare.runner import start
    from dashpot.features import Report

    engine = load_engine(
        arguments.scene, arguments.material, arguments.threads, arguments.fit, arguments.trajectory
    )
    if arguments.timestep is not None:
        engine.model.opt.timestep = arguments.timestep
    step = float(engine.model.opt.timestep)
    steps = round(arguments.duration / step)
    if steps < 1:
        raise ValueError(f"--duration {arguments.duration:g} s is less than a time step, {step:g}")
    print(Report(engine.report().of("mapped")))
    data = start(engine.model)
    rows: dict[str, list[Any]] = {
        name: []
        for name in (
            "time",
            "qpos",
            "qvel",
            "kinetic",
            "potential",
            "elastic",
            "dissipated",
            "contacts",
            "penetration",
        )
    }

    def record(contacts: int, penetration: float) -> None:
        energy = engine.energy(data)
        values = (
            data.time,
            np.array(data.qpos),
            np.array(data.qvel),
            energy.kinetic,
            energy.potential,
            energy.elastic,
            energy.dissipated,
            contacts,
            penetration,
        )
        for column, value in zip(rows.values(), values, strict=True):
            column.append(value)

    record(0, 0.0)
    with progress_bar("stepping", steps) as (bar, task):
        for _ in range(steps):
            stats = engine.step(data)
            record(stats.touching, stats.max_penetration)
            bar.advance(task)
    arrays: dict[str, Any] = {name: np.array(column) for name, column in rows.items()}
    Console().print(happenings(arrays))
    if arguments.save is not None:
        write_poses(arguments.save, engine.model, arrays)
        print(f"wrote {arguments.save}")
    with arguments.out.open("wb") as stream:
        np.savez_compressed(stream, **arrays)
    print(
        f"{steps} steps of {1e3 * step:g} ms: {rows['contacts'][-1]} contacts at the end, "
        f"deepest penetration {1e3 * max(rows['penetration']):.3g} mm, "
        f"energy dissipated {rows['dissipated'][-1]:.4g} J; wrote {arguments.out}"
    )
    return 0
