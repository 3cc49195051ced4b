"""Grinding with a UR5e: how right the force of contact is, and what a plan on it makes of a part.

    python benchmarks/grinding.py                # all; minutes
    python benchmarks/grinding.py force          # or some: force, plan, trial

`force`: a ball nose slides over a lying cylinder of 0.4 m at 0.1 to 0.2 m/s with friction 0.3 and
an imbalance of 47 Hz (1.7 N). It prints root mean square and mean of the error of the normal force.
The reference is the same engine in steps of 0.05 ms; MuJoCo's settings have dashpot's beside it. On
a table it prints force over compression, over the stiffness.

`plan`: 50 um off the cylinder by a ball nose that spins at 47 Hz, tilted by 20 degrees: evenness,
time, and processor time of the plan on one core, checked at 0.25 ms; a constant feed and offset
beside it.

`trial`: the contact is 20 % softer or stiffer than thought: what a plan leaves, what a press says
of stiffness and damping, and what the plan anew leaves. All checked at 0.25 ms.

Needs the extra dashpot[grinding].
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from dashpot import grinding
from dashpot.grinding.checks import check_in, mujoco_models
from dashpot.grinding.motion import Command, Motion
from dashpot.grinding.removal import depth_along
from dashpot.grinding.simulation import Simulator
from dashpot.grinding.time_law import TimeLaw

Array = NDArray[np.float64]

FINE = 5e-5
CHECK = 2.5e-4
STEPS = (1e-3, 2e-3, 5e-3)
STIFFNESSES = (2e4, 2e5)
DEPTH, PRESTON, MAX_FORCE, FEED = 50e-6, 4.7e-10, 90.0, (0.05, 0.2)
TRUE_DAMPING = 130.0


def cylinder() -> grinding.Work:
    """Return the lying cylinder of 0.4 m, its top 0.25 m above the arm's foot."""
    return grinding.Work.primitive("cylinder", (0.2, 0.4), (0, 0.5, 0.05), (1, 0, 1, 0))


def sliding_cell(stiffness: float, integrator: str, work: grinding.Work) -> grinding.Cell:
    """Return a cell whose ball nose does not spin: it slides at the feed."""
    return grinding.Cell.ur5e(
        tool=grinding.BallNose(0.02),
        work=work,
        stiffness=stiffness,
        imbalance=grinding.Imbalance(47.0, 1e-3),
        integrator=integrator,
    )


def steady(path: grinding.Path, stiffness: float, force: float = 50.0) -> Command:
    """Return a command that rises to a force over 80 mm and goes on at it."""
    way = np.linspace(0.0, path.length, 440)
    law = TimeLaw.of_feed(way, np.linspace(0.1, 0.2, len(way)), 2.0)
    rise = np.clip(np.minimum(way, path.length - way) / 0.08, 0.0, 1.0)
    rise = rise**3 * (10 - 15 * rise + 6 * rise**2)
    return Command(law, force * rise / stiffness - 2e-4 * (1 - rise), force * rise)


def means(load: Array, count: int) -> Array:
    """Return means of successive steps."""
    whole = len(load) // count
    return np.asarray(load[: whole * count].reshape(whole, count).mean(axis=1))


def force_errors() -> Table:
    """Return the errors of the force by engine, stiffness and time step."""
    table = Table(title="Normal force while sliding, against steps of 0.05 ms")
    for column in ("engine", "N/m", *(f"{1e3 * s:g} ms: rms N, mean %" for s in STEPS)):
        table.add_column(column)
    for stiffness in STIFFNESSES:
        for integrator in ("discrete", "implicitfast"):
            cell = sliding_cell(stiffness, integrator, cylinder())
            path = grinding.Path.on_surface(cell, grinding.line((-0.2, 0.45), (0.18, 0.55)))
            motion, command = Motion(cell, path), steady(path, stiffness)
            right = Simulator(motion, timestep=FINE, nthread=1).run([command])[0].total
            table.add_row(
                f"dashpot, {integrator}",
                f"{stiffness:g}",
                *(_error(motion, command, right, step, None) for step in STEPS),
            )
        for setting in mujoco_models(cell):
            own = _run(motion, command, FINE, setting)
            for told, reference in (("its own", own), ("dashpot's", right)):
                table.add_row(
                    f"{setting}, against {told}",
                    f"{stiffness:g}",
                    *(_error(motion, command, reference, step, setting) for step in STEPS),
                )
    return table


def _run(motion: Motion, command: Command, step: float, setting: str | None) -> Array:
    model = None if setting is None else mujoco_models(motion.cell)[setting]
    simulator = Simulator(motion, timestep=step, nthread=1)
    return simulator.run([command], mujoco_model=model)[0].total


def _error(motion: Motion, command: Command, right: Array, step: float, name: str | None) -> str:
    expected = means(right, round(step / FINE))
    error = _run(motion, command, step, name)[: len(expected)] - expected
    rms, mean = np.sqrt(np.mean(error**2)), 100 * error.mean() / expected.mean()
    return f"{rms:.3f}, {mean:+.3f}"


def sliding_stiffness() -> Table:
    """Return force over compression, over the stiffness, while a ball slides on a table."""
    table = Table(title="Force over compression while sliding on a table, over the stiffness")
    for column in (
        "engine",
        *(f"{k:g} N/m, {how}" for how in ("at the feed", "spinning") for k in STIFFNESSES),
    ):
        table.add_column(column)
    rows: dict[str, list[str]] = {}
    work = grinding.Work.primitive("box", (0.3, 0.2, 0.05), (0, 0.5, 0.1))
    for spin in (0.0, 47.0):
        for stiffness in STIFFNESSES:
            cell = sliding_cell(stiffness, "implicitfast", work).with_changes(
                imbalance=None, tool=grinding.BallNose(0.02, spin=spin)
            )
            path = grinding.Path.on_surface(
                cell, grinding.line((-0.15, 0.5), (0.15, 0.5)), tilt=math.radians(20)
            )
            motion, command = Motion(cell, path), steady(path, stiffness)
            for step in (2.5e-4, 1e-3, 2e-3):
                for setting in (None, *mujoco_models(cell)):
                    name = f"{setting or 'dashpot'}, {1e3 * step:g} ms"
                    ratio = _stiffness_ratio(motion, command, step, setting)
                    rows.setdefault(name, []).append(f"{ratio:.4f}")
    for name, cells in sorted(rows.items()):
        table.add_row(name, *cells)
    return table


def _stiffness_ratio(motion: Motion, command: Command, step: float, setting: str | None) -> float:
    """Return mean force over mean overlap, over the stiffness, in the middle of a pass."""
    cell = motion.cell
    model = None if setting is None else mujoco_models(cell)[setting]
    simulator = Simulator(motion, timestep=step, nthread=1)
    found = simulator.run([command], mujoco_model=model)[0]
    # Over the top of the table, at 0.15 m.
    overlap = np.nan_to_num(2 * (0.15 - found.place[:, 0, 2]))
    middle = slice(len(overlap) // 3, 2 * len(overlap) // 3)
    mean = 0.5 * (overlap[:-1] + overlap[1:])[middle]
    return float(found.total[:-1][middle].mean() / mean.mean() / cell.stiffness)


def grinding_cell(stiffness: float = 2e4, timestep: float = 2e-3) -> grinding.Cell:
    """Return a cell whose ball nose spins at 47 Hz."""
    return grinding.Cell.ur5e(
        tool=grinding.BallNose(0.02, spin=47.0),
        work=cylinder(),
        stiffness=stiffness,
        imbalance=grinding.Imbalance(47.0, 1e-3),
        timestep=timestep,
    )


def across(cell: grinding.Cell) -> grinding.Path:
    """Return the path of 0.39 m, and 20 mm of run-in at either end."""
    curve = grinding.line((-0.2, 0.45), (0.18, 0.55))
    return grinding.Path.on_surface(cell, curve, tilt=math.radians(20))


def plans() -> Table:
    """Return what plans at 2 and 5 ms leave, and what a constant feed and offset does."""
    table = Table(title="50 um off a cylinder, checked at 0.25 ms")
    for column in ("plan", "pass s", "std %", "largest %", "peak N", "processor s", "rollouts"):
        table.add_column(column)
    for stiffness in STIFFNESSES:
        for timestep, feed in ((2e-3, FEED), (5e-3, FEED), (2e-3, (0.05, 0.215))):
            cell = grinding_cell(stiffness, timestep)
            path = across(cell)
            begun = time.process_time()
            plan = grinding.plan(
                cell, path, DEPTH, preston=PRESTON, max_force=MAX_FORCE, feed=feed, nthread=1
            )
            spent = time.process_time() - begun
            fine = check_in(plan, cell, "", timestep=CHECK)
            table.add_row(
                f"{1e3 * timestep:g} ms, {stiffness:g} N/m, to {feed[1]:g} m/s",
                f"{plan.duration:.3f}",
                f"{100 * fine.uniformity:.2f}",
                f"{100 * fine.largest:.2f}",
                f"{fine.peak_force:.1f}",
                f"{spent:.1f}",
                f"{plan.rollouts}",
            )
    for fed in (False, True):
        uniformity, largest, duration = constant(feeds_force=fed)
        told = "load fed forward" if fed else "as servos do"
        table.add_row(
            f"constant feed and offset, {told}",
            f"{duration:.3f}",
            f"{100 * uniformity:.2f}",
            f"{100 * largest:.2f}",
        )
    return table


def constant(*, feeds_force: bool) -> tuple[float, float, float]:
    """Return evenness and time of a constant feed and the constant offset of the right mean.

    Depth is judged along the track that the tool takes, beside the path where load bends the arm.
    """
    cell = grinding_cell().with_changes(control=grinding.Control(feeds_force=feeds_force))
    path = across(cell)
    motion = Motion(cell, path)
    way = np.linspace(0.0, path.length, 440)
    law = TimeLaw.of_feed(way, np.full(len(way), 0.17), 2.0)
    edge = np.clip(np.minimum(way, path.length - way) / 0.015, 0.0, 1.0)
    rise = edge**2 * (3 - 2 * edge)
    force, worn = 50.0, np.ones(1)
    for _ in range(6):
        offset = force / cell.stiffness * (1.0 if feeds_force else 4.0)
        command = Command(law, offset * rise - 1e-3 * (1 - rise), force * rise)
        found = Simulator(motion, timestep=CHECK, nthread=1).run([command])[0]
        place, _, _ = law.at(found.time)
        judged = (place > path.run_in) & (place < path.length - path.run_in)
        track = np.flatnonzero(judged & np.isfinite(found.place[:, 0, 0]))[::20]
        worn = depth_along(
            found,
            found.place[track, 0],
            found.normal[track, 0],
            preston=PRESTON,
            footprint=cell.tool.footprint,
        )
        force *= DEPTH / worn.mean()
    share = worn / worn.mean()
    return float(share.std()), float(np.abs(share - 1).max()), law.duration


def trials() -> Table:
    """Return what a press says of a contact that is not as stiff as thought, and what it mends."""
    table = Table(title="Stiffness wrong, a press, and the plan anew; checked at 0.25 ms")
    for column in (
        "truth",
        "reads",
        "largest % before",
        "stiffness, of the truth",
        "inside",
        "damping, of the truth",
        "inside",
        "told",
        "largest % after",
        "std %",
    ):
        table.add_column(column)
    thought = grinding_cell()
    path = across(thought)
    options = {"preston": PRESTON, "max_force": MAX_FORCE, "feed": FEED, "nthread": 1}
    plan = grinding.plan(thought, path, DEPTH, **options)
    for factor in (0.8, 1.2):
        true = thought.with_changes(stiffness=factor * 2e4, damping=TRUE_DAMPING)
        before = check_in(plan, true, "", timestep=CHECK)
        for reads in ("mean", "instant"):
            log = grinding.record_press(
                true, path.points[len(path) // 2], sampling=reads, seed=len(table.rows)
            )
            trial = grinding.press_trial(thought, log, nthread=1)
            again = trial.plan_again(plan, nthread=1)
            after = check_in(again, true, "", timestep=CHECK)
            low, high = trial.stiffness_interval
            least, most = trial.damping_interval
            table.add_row(
                f"{true.stiffness:g} N/m",
                reads,
                f"{100 * before.largest:.2f}",
                f"{trial.stiffness / true.stiffness:.4f}",
                "yes" if low <= true.stiffness <= high else "no",
                f"{trial.damping / TRUE_DAMPING:.4f}",
                "yes" if least <= TRUE_DAMPING <= most else "no",
                f"{trial.sampling}" if trial.told else "not told",
                f"{100 * after.largest:.2f}",
                f"{100 * after.uniformity:.2f}",
            )
    return table


PARTS: dict[str, tuple[Callable[[], Table], ...]] = {
    "force": (force_errors, sliding_stiffness),
    "plan": (plans,),
    "trial": (trials,),
}


def main() -> None:
    """Print the tables of the parts that are named."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", help=f"some of {', '.join(PARTS)}; all by default")
    chosen = parser.parse_args().parts or list(PARTS)
    for name in chosen:
        if name not in PARTS:
            parser.error(f"{name!r} is none of {', '.join(PARTS)}")
        for part in PARTS[name]:
            Console(width=140).print(part())


if __name__ == "__main__":
    main()
