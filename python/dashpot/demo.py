"""The demonstration: calibration on a twin and on real data, and comparison with MuJoCo."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

from dashpot import compare
from dashpot.calibrate import tosses as toss_calibration
from dashpot.calibrate import twin
from dashpot.colours import COLOURS, colours_of
from dashpot.data import CubeTosses, load_cube_tosses
from dashpot.figures import ShownFigure, clean, legend_above
from dashpot.report import Picture, Section, Table, Text, write_report
from dashpot.versions import now, versions

__all__ = ["run_demo"]

FITTED_TOSSES = 60
TOSS_SUBSTEPS = 4
# CMA-ES: the cost of whole rollouts has many valleys. A MuJoCo step takes less time than dashpot's,
# so its search is given twice the budget.
TOSS_EVALUATIONS = {"dashpot": 90, "MuJoCo": 180}
PILE_SETTINGS = ("dashpot", "mujoco-default", "elliptic", "impratio", "solref-direct", "discrete")

_UNITS = {"stiffness": "N/m", "damping": "N s/m"}


def run_demo(
    out: str | os.PathLike[str] = "dashpot-report",
    *,
    data: str | os.PathLike[str] | None = None,
    seed: int = 0,
    threads: int | None = None,
    console: Console | None = None,
) -> Path:
    """Run the demonstration and write its report.

    Parameters
    ----------
    out
        Folder for ``report.html`` and the pictures; made where missing.
    data
        Where the cube tosses are, see :func:`dashpot.data.load_cube_tosses`. None looks in the
        usual places and goes on without them where they are not there.
    seed
        Of the hidden parameters, the noise and the choice of tosses.
    threads
        For calibration; None is one per core. Results do not depend on it.
    console
        Where to tell what is found; None is standard output.

    Returns
    -------
    Path
        The report.

    Raises
    ------
    FileNotFoundError
        If `data` is given and not there.
    ValueError
        If the data are damaged.
    """
    screen = Console(markup=False) if console is None else console
    begin = time.perf_counter()
    tosses = _find_tosses(data)

    screen.rule("1. twin experiment")
    twin_section = _twin_section(seed, threads, screen)
    screen.rule("2. real cube tosses")
    toss_section = _toss_section(tosses, seed, threads, screen)
    screen.rule("3. pile")
    pile_section = _pile_section(screen)

    report = write_report(
        out,
        title="dashpot: calibration and comparison",
        summary="Contact stiffness, damping and friction fitted to trajectories, and penetration "
        "and energy decay beside MuJoCo.",
        sections=[twin_section, toss_section, pile_section],
        footer=f"Made by `dashpot demo --seed {seed}` on {now()} in "
        f"{time.perf_counter() - begin:.0f} s, with "
        + ", ".join(f"{name} {version}" for name, version in versions().items())
        + ".",
    )
    screen.print(f"\n{time.perf_counter() - begin:.0f} s; report: {report}")
    return report


def _find_tosses(data: str | os.PathLike[str] | None) -> CubeTosses | None:
    try:
        return load_cube_tosses(data)
    except FileNotFoundError:
        if data is not None:
            raise
        return None


def _twin_section(seed: int, threads: int | None, screen: Console) -> Section:
    screen.print("fitting a simulated body whose stiffness, damping and friction are hidden")
    experiment = twin.run(seed=seed, nthread=threads)
    screen.print(experiment.fit.table(experiment.truth))
    rows = []
    for estimate in experiment.fit.estimates:
        unit = _UNITS.get(estimate.name)
        rows.append(
            [
                estimate.name.replace("_", " ") + (f" [{unit}]" if unit else ""),
                f"{experiment.truth[estimate.name]:.5g}",
                f"{experiment.start[estimate.name]:.3g}",
                f"{estimate.value:.5g}",
                estimate.interval,
                "yes" if experiment.covered[estimate.name] else "no",
                "yes" if estimate.identified else "no",
            ]
        )
    missed = _missed_truths(experiment)
    if missed:
        screen.print(missed)
    header = ["", "truth", "start", "estimate", "95 % interval", "truth inside", "identified"]
    return Section(
        "Twin experiment: hidden parameters recovered",
        [
            Text(
                f"A box is thrown {twin.THROWS} times onto a floor; it bounces, turns and slides "
                "to rest. Its contact parameters are hidden, its poses get "
                f"{1e3 * twin.POSITION_NOISE:g} mm and {1e3 * twin.ROTATION_NOISE:g} mrad of "
                "noise. The fit knows neither the parameters nor the initial states and starts "
                "from values that are wrong by up to a factor of five."
            ),
            Table(header, rows),
            *([Text(missed)] if missed else []),
            Picture(
                "twin",
                _twin_figure(experiment),
                "Left: estimates and 95 % intervals in thousandths of the truth. Right: the lowest "
                "cost as the search goes on, first of a short window after the start, then of "
                "all frames. The two are sums over different numbers of frames.",
            ),
        ],
    )


def _missed_truths(experiment: twin.Twin) -> str:
    """Say which intervals miss the truth, by how much, and how often that has to be."""
    estimates = experiment.fit.estimates
    missed = [
        f"{estimate.name.replace('_', ' ')} by "
        f"{abs(estimate.value - experiment.truth[estimate.name]) / estimate.standard_error:.1f} "
        f"standard errors, {100 * abs(estimate.value / experiment.truth[estimate.name] - 1):.2g} %"
        for estimate in estimates
        if not experiment.covered[estimate.name]
    ]
    if not missed:
        return ""
    return (
        "A 95 % interval misses the truth in one fit of twenty. At least one of "
        f"{len(estimates)} does in {100 * (1 - 0.95 ** len(estimates)):.0f} % of fits. "
        f"Off here: {'; '.join(missed)}."
    )


def _twin_figure(experiment: twin.Twin) -> Figure:
    figure = ShownFigure(figsize=(10, 3.4), layout="constrained")
    intervals, cost = figure.subplots(1, 2)
    for index, estimate in enumerate(experiment.fit.estimates):
        truth = experiment.truth[estimate.name]
        centre, low, high = (
            1e3 * (value / truth - 1) for value in (estimate.value, estimate.lower, estimate.upper)
        )
        intervals.errorbar(
            centre,
            index,
            xerr=[[centre - low], [high - centre]],
            fmt="o",
            color=COLOURS[0],
            capsize=4,
        )
    intervals.axvline(0, color="black", linewidth=0.8)
    names = [estimate.name.replace("_", " ") for estimate in experiment.fit.estimates]
    intervals.set_yticks(range(len(names)), names)
    intervals.set_ylim(len(names) - 0.5, -0.5)
    intervals.set_xlabel("estimate / truth − 1  [‰]")
    # In one window the lowest cost never rises.
    history = experiment.fit.cost_history
    windows = np.split(np.arange(len(history)), np.flatnonzero(np.diff(history) > 0) + 1)
    names = [*(f"first {window:g} s" for window in twin.WINDOWS), "all frames"]
    for index, window in enumerate(windows):
        label = names[index] if len(windows) == len(names) else f"window {index + 1}"
        cost.semilogy(window, history[window], color=COLOURS[index], label=label)
    cost.set_xlabel("batch of simulations")
    cost.set_ylabel("lowest cost so far")
    cost.legend(frameon=False, fontsize="small")
    clean(intervals, cost)
    return figure


def _toss_section(
    tosses: CubeTosses | None, seed: int, threads: int | None, screen: Console
) -> Section:
    title = "Real cube tosses: fitted on some, predicting the others"
    if tosses is None or len(tosses) <= FITTED_TOSSES:
        missing = (
            "The cube tosses are not on this machine. `dashpot data cube-tosses` downloads them, "
            "or set DASHPOT_DATA to the folder that holds them; then run the demo again."
        )
        screen.print(missing)
        return Section(title, [Text(missing)])
    screen.print(f"fitting {FITTED_TOSSES} of {len(tosses)} tosses, predicting the others")
    studies = {
        name: toss_calibration.study(
            tosses.tosses,
            peer=peer,
            load=not peer,
            fitted=FITTED_TOSSES,
            substeps=TOSS_SUBSTEPS,
            method="cma",
            starts=0,
            max_evaluations=TOSS_EVALUATIONS[name],
            seed=seed,
            nthread=threads,
        )
        for name, peer in (("dashpot", False), ("MuJoCo", True))
    }
    errors = [
        [
            name,
            f"{study.seen.mean_position:.1f}",
            f"{study.seen.mean_rotation:.1f}",
            f"{study.unseen.mean_position:.1f}",
            f"{study.unseen.mean_rotation:.1f}",
        ]
        for name, study in studies.items()
    ]
    table = Table(
        ["", "fitted [% of width]", "fitted [°]", "unseen [% of width]", "unseen [°]"],
        errors,
        f"Errors of whole rollouts from the release; {FITTED_TOSSES} tosses fitted, "
        f"{len(tosses) - FITTED_TOSSES} unseen",
        strong=[0],
    )
    for row in errors:
        screen.print(f"{row[0]}: unseen tosses off by {row[3]} % of the width and {row[4]}°")
    estimates = [
        [
            f"{name}: {estimate.name.replace('_', ' ')}",
            f"{estimate.value:.4g}",
            estimate.interval,
            estimate.statement,
        ]
        for name, study in studies.items()
        for estimate in study.fit.estimates
    ]
    for name, study in studies.items():
        alike: dict[str, list[str]] = {}
        for estimate in study.fit.estimates:
            told = f"{estimate.name.replace('_', ' ')} {estimate.value:.4g}"
            alike.setdefault(estimate.statement, []).append(told)
        for statement, told_of in alike.items():
            screen.print(f"{name}: {', '.join(told_of)}: {statement}")
    return Section(
        title,
        [
            Text(
                "A 0.37 kg cube thrown by hand onto a table and tracked at 148 Hz (ContactNets). "
                "Each toss is simulated from its first frame, with a start state fitted to its "
                "flight. Both simulators are tuned on the same tosses by the same search, MuJoCo "
                "with twice the budget. Body properties are fitted too. The centre of mass shows "
                "in the flights. Inertia and corner radius are searched for together with the "
                "contact's parameters, in dashpot also how friction falls with load."
            ),
            table,
            Picture(
                "tosses",
                _toss_figure(studies),
                "Share of the unseen tosses whose error stays below a value, position (left) and "
                "rotation (right).",
            ),
            Table(["parameter", "estimate", "95 % interval", "what the data say"], estimates),
        ],
    )


def _toss_figure(studies: dict[str, toss_calibration.Study]) -> Figure:
    figure = ShownFigure(figsize=(10, 3.6), layout="constrained")
    colours = colours_of(studies)
    for axes, field, label in zip(
        figure.subplots(1, 2, sharey=True),
        ("position", "rotation"),
        ("mean position error [% of width]", "mean rotation error [°]"),
        strict=True,
    ):
        for name, study in studies.items():
            values = np.sort(getattr(study.unseen, field))
            share = 100 * np.arange(1, len(values) + 1) / len(values)
            axes.plot(values, share, color=colours[name], label=name)
        axes.set_xlabel(label)
        axes.set_xlim(left=0)
        clean(axes)
    figure.axes[0].set_ylabel("unseen tosses [%]")
    legend_above(figure, figure.axes[0])
    return figure


def _pile_section(screen: Console) -> Section:
    screen.print("stepping a pile with dashpot and with MuJoCo")
    comparison = compare.run("pile", settings=PILE_SETTINGS)
    screen.print(comparison.table())
    screen.print(comparison.explanation())
    header, rows = comparison.rows()
    return Section(
        "Pile: penetration and energy decay",
        [
            Text(
                "Forty boxes, spheres, capsules, cylinders and ellipsoids fall into a bin, stepped "
                f"at {1e3 * comparison.timestep:g} ms by dashpot (rigid materials) and by MuJoCo "
                "with several settings. Every state of every run is measured alike: overlap from "
                "collision detection, energies from the unchanged model. The last quarter of the "
                f"{comparison.duration:g} s counts as settled."
            ),
            Table(header, rows, strong=[0]),
            *map(Text, comparison.notes()),
            Picture(
                "pile",
                comparison.plot(),
                "Penetration of the touching contacts and mechanical energy above the lowest "
                "state reached.",
            ),
            Table(
                ["setting", "meaning"],
                [[run.name, run.description] for run in comparison.runs[1:]],
            ),
        ],
    )
