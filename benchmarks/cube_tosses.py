"""Predict real cube tosses: fitted on 60, evaluated on the others, dashpot beside MuJoCo.

Run ``python benchmarks/cube_tosses.py``; ``DASHPOT_DATA`` or ``--data`` says where the tosses are.
Errors are time means from before the first contact to rest, averaged over tosses: distance of the
centres in percent of the width, and angle in degrees. Both simulators are tuned by the same search
with the same budget. ``--body`` also fits inertia, corner radius and centre of mass.
"""

from __future__ import annotations

import argparse

from rich.console import Console
from rich.table import Table

from dashpot.calibrate import tosses
from dashpot.data import load_cube_tosses


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", default=None)
    parser.add_argument("--fitted", type=int, default=60)
    parser.add_argument("--evaluations", type=int, default=200)
    parser.add_argument("--substeps", type=int, default=4)
    parser.add_argument("--length-scale", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--body", action="store_true")
    arguments = parser.parse_args()

    data = load_cube_tosses(arguments.data)
    console = Console()
    table = Table(title=f"Cube tosses, fitted on {arguments.fitted} of {len(data)}")
    for column in ("", "seen position", "rotation", "unseen position", "rotation", "fit"):
        table.add_column(column, justify="right" if column else "left")
    for name, peer in (("dashpot", False), ("MuJoCo", True)):
        study = tosses.study(
            data.tosses,
            peer=peer,
            body=arguments.body,
            fitted=arguments.fitted,
            length_scale=arguments.length_scale,
            substeps=arguments.substeps,
            seed=arguments.seed,
            method="cma",
            starts=0,
            max_evaluations=arguments.evaluations,
        )
        table.add_row(
            name,
            f"{study.seen.mean_position:.1f} %",
            f"{study.seen.mean_rotation:.1f}°",
            f"{study.unseen.mean_position:.1f} %",
            f"{study.unseen.mean_rotation:.1f}°",
            f"{study.fit.seconds:.0f} s",
        )
        console.print(study.fit.table())
        for estimate in study.fit.estimates:
            console.print(f"  {estimate.name}: {estimate.statement}", highlight=False)
    console.print(table)


if __name__ == "__main__":
    main()
