"""Predict real cube tosses: fitted on some, evaluated on the others, dashpot beside MuJoCo.

Run ``python benchmarks/cube_tosses.py``; ``DASHPOT_DATA`` or ``--data`` says where the tosses are.
Errors are means over tosses of time means, from the release and from the first contact to rest:
distance of the centres in percent of the width, and angle in degrees. Both simulators start from
the same states, have the same body properties and are tuned by the same search with the same
budget. ``contact``: contact parameters alone, with published body properties; ``body``: also the
centre of mass, seen in flight, inertia and corner radius; ``load``: also friction that falls with
load, which MuJoCo does not have.
"""

from __future__ import annotations

import argparse

import numpy as np
from rich.console import Console
from rich.table import Table

from dashpot.calibrate import tosses
from dashpot.data import load_cube_tosses

# What is fitted and where, and the budget of each search: the more unknowns, the more.
EVALUATIONS = {"contact": 140, "body": 340, "load": 500}
MODELS = {
    "contact": {"dashpot": {"body": False}, "MuJoCo": {"body": False, "peer": True}},
    "body": {"dashpot": {"body": True}, "MuJoCo": {"body": True, "peer": True}},
    "load": {"dashpot": {"body": True, "load": True}},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", default=None)
    parser.add_argument("--models", nargs="+", choices=MODELS, default=list(MODELS))
    parser.add_argument("--fitted", type=int, default=100)
    parser.add_argument("--evaluations", type=int, default=None)
    parser.add_argument("--substeps", type=int, default=4)
    parser.add_argument("--length-scale", type=float, default=tosses.LENGTH_SCALE)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=None)
    arguments = parser.parse_args()

    data = load_cube_tosses(arguments.data)
    console = Console(width=100)
    table = Table(title=f"Cube tosses, fitted on {arguments.fitted} of {len(data)}")
    for column in ("", "seen", "unseen", "median", "from contact", "fit"):
        table.add_column(column, justify="right" if column else "left")
    for model in arguments.models:
        for name, options in MODELS[model].items():
            study = tosses.study(
                data.tosses,
                **options,
                fitted=arguments.fitted,
                length_scale=arguments.length_scale,
                substeps=arguments.substeps,
                seed=arguments.seed,
                max_evaluations=arguments.evaluations or EVALUATIONS[model],
                nthread=arguments.threads,
            )
            seen, unseen = study.seen, study.unseen
            table.add_row(
                f"{name}, {model}",
                f"{seen.mean_position:.1f} %, {seen.mean_rotation:.1f}°",
                f"{unseen.mean_position:.1f} %, {unseen.mean_rotation:.1f}°",
                f"{np.median(unseen.position):.1f} %, {np.median(unseen.rotation):.1f}°",
                f"{unseen.contact_position.mean():.1f} %, {unseen.contact_rotation.mean():.1f}°",
                f"{study.fit.seconds:.0f} s",
            )
            console.print(f"{name}, {model}")
            if options["body"] and study.cube is not None:
                offset = ", ".join(f"{1e3 * component:.2f}" for component in study.cube.offset)
                console.print(f"centre of mass: ({offset}) mm", highlight=False)
            console.print(study.fit.table())
            for estimate in study.fit.estimates:
                console.print(f"  {estimate.name}: {estimate.statement}", highlight=False)
    console.print(table)


if __name__ == "__main__":
    main()
