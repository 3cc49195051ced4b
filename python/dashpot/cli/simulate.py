"""``dashpot simulate``: step a scene and store its states."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dashpot.cli.options import (
    add_material,
    add_scene,
    add_threads,
    apply_materials,
    load_engine,
    new_archive,
    new_table,
    positive,
    progress_bar,
)

if TYPE_CHECKING:
    from dashpot.engine import Engine


def add_to(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "simulate",
        help="step a scene with dashpot and store its states",
        description="Step a scene from its first keyframe (or reference pose) and print what "
        "happens. Writes time, qpos, qvel, energies and contact counts of every step to a numpy "
        ".npz file, or the poses of bodies to a table.",
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
        help="write the poses of the moving bodies as a .csv table that `calibrate` reads, and "
        "without --out nothing else",
    )
    parser.add_argument(
        "--out",
        type=new_archive,
        metavar="FILE",
        help="write all states as an .npz file; without --save the default is states.npz",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    import numpy as np
    from rich.console import Console

    from dashpot.cli.motion import happenings, write_poses
    from dashpot.compare.runner import start
    from dashpot.features import Report

    engine = load_engine(arguments.scene, [], arguments.threads)
    fitted = None
    if arguments.fit is not None:
        engine, fitted = with_fit(engine, arguments.fit, arguments.trajectory)
    apply_materials(engine, arguments.material)
    if arguments.timestep is not None:
        engine.model.opt.timestep = arguments.timestep
    step = float(engine.model.opt.timestep)
    if fitted is not None and not math.isclose(step, fitted, rel_tol=1e-6):
        print(
            f"steps are {1e3 * step:g} ms, those of the fit {1e3 * fitted:g} ms: "
            f"--timestep {fitted:g} steps as the fit did"
        )
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
    archive = arguments.out
    if archive is None and arguments.save is None:
        archive = Path("states.npz")
    if archive is not None:
        with archive.open("wb") as stream:
            np.savez_compressed(stream, **arrays)
    wrote = " and ".join(str(file) for file in (arguments.save, archive) if file is not None)
    print(
        f"{steps} steps of {1e3 * step:g} ms: {rows['contacts'][-1]} contacts at the end, "
        f"deepest penetration {1e3 * max(rows['penetration']):.3g} mm, "
        f"energy dissipated {rows['dissipated'][-1]:.4g} J; wrote {wrote}"
    )
    return 0


def with_fit(engine: Engine, file: str, trajectory: str | None) -> tuple[Engine, float]:
    """Return the engine with the options, materials and values of a saved fit, and its time step.

    Both are those of one trajectory of the fit, the first where none is named.
    """
    from dashpot.calibrate import Fit
    from dashpot.calibrate.saved import apply_fit, setup_of

    try:
        fit = Fit.load(file)
        print(f"fitted: {', '.join(f'{name} = {value:.6g}' for name, value in fit.values.items())}")
        engine = apply_fit(fit, engine.model, trajectory=trajectory, nthread=engine.nthread)
    except ValueError as error:
        raise ValueError(f"{file}: {str(error).removeprefix(f'{file}: ')}") from error
    names = [known.name for known in fit.problem.trajectories]
    return engine, setup_of(fit).timesteps[names.index(trajectory) if trajectory else 0]
