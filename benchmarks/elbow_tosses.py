"""Predict real tosses of two boxes on a hinge: fitted on 15, evaluated on 15 others.

Run ``python benchmarks/elbow_tosses.py``; ``DASHPOT_DATA`` or ``--data`` says where the tosses are.
Each toss starts as its recorded flight says (`dashpot.calibrate.with_flights`); no frame after the
first contact is used of those that are predicted. Errors are means over tosses of time means:
distance of the first box in percent of its length, and angles in degrees.

The axle bends: it holds one box beside the other by two stiff springs (N m/rad) about the axes
across it, whose damping is stiffness times a time. Nothing reads them, so they start unbent.

The recorded frame leans by 2.4 degrees: boxes that lie flat say so, and how high the table is. Its
lengths are 2 % short of gravity's, as those of the cube tosses, which have the same cameras.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.spatial.transform import Rotation

import dashpot
from dashpot.calibrate import Parameter, Problem, Trajectory, tosses, with_flights

Array = NDArray[np.float64]

RATE = 148.0  # 1/s
SCALE = 1.02
NORMAL = np.array([-0.031, 0.028, 1.0])  # of the table in the recorded frame
HALF = np.array([0.05, 0.025, 0.025])  # of either box, m
MASS = 0.37
HINGE, SECOND = np.array([-0.035, 0.06, 0.0]), np.array([0.035, 0.0, 0.0])
INERTIA = MASS / 3.0 * (HALF @ HALF - HALF**2)  # of a solid box
CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
GEOMS = tuple(f"{box}{i}" for box in ("first", "second") for i in range(8))
WIDTH = 2.0 * HALF[0]
# Of flights, m: recorded corners are up to 9 mm off when they hit the table.
CLEARANCE = 0.012


def text(numbers: Array) -> str:
    return " ".join(f"{number:.9g}" for number in numbers)


def engine(values: Mapping[str, float]) -> dashpot.Engine:
    """Return the boxes, spheres in their corners, over a table at z = 0."""
    radius = values["corner_radius"]
    inertia = INERTIA * [values["inertia_x"], values["inertia_y"], values["inertia_z"]]
    inner = CORNERS * (HALF - radius)
    stiff, lossy = values["axle_stiffness"], values["axle_stiffness"] * values["axle_time"]
    first, second = (
        f'<inertial pos="{text(middle)}" mass="{MASS}" diaginertia="{text(inertia)}"/>'
        + "".join(
            f'<geom name="{box}{i}" type="sphere" size="{radius}" pos="{text(middle + corner)}"/>'
            for i, corner in enumerate(inner)
        )
        for box, middle in (("first", np.zeros(3)), ("second", SECOND))
    )
    model = mujoco.MjModel.from_xml_string(
        f"""
        <mujoco>
          <option timestep="{1.0 / RATE / 4}" cone="elliptic"/>
          <worldbody>
            <geom name="table" type="plane" size="2 2 .1"/>
            <body name="first" pos="0 0 .2"><freejoint/>{first}
              <body name="second" pos="{text(HINGE)}">
                <joint name="bent_x" axis="1 0 0" stiffness="{stiff}" damping="{lossy}"/>
                <joint name="bent_z" axis="0 0 1" stiffness="{stiff}" damping="{lossy}"/>
                <joint name="hinge" axis="0 1 0" damping="{values["hinge_damping"]}"
                       frictionloss="{values["hinge_friction"]}"/>{second}
              </body>
            </body>
          </worldbody>
          <sensor><jointpos name="hinge" joint="hinge"/></sensor>
        </mujoco>
        """
    )
    made = dashpot.Engine(model)
    material = dashpot.Material(3e5, damping_ratio=0.5, friction=0.16)
    made.set_materials({**dict.fromkeys(GEOMS, material), "table": dashpot.Material(friction=0.0)})
    return made


def parameters() -> list[Parameter]:
    return [
        Parameter.material(GEOMS, "stiffness", start=3e5, bounds=(3e3, 3e6)),
        Parameter.material(GEOMS, "damping_ratio", start=0.5, bounds=(0.1, 3.0)),
        Parameter.material(GEOMS, "sliding_friction", start=0.16, bounds=(0.05, 0.6)),
        Parameter("hinge_friction", start=3e-4, bounds=(1e-5, 3e-2)),
        Parameter("hinge_damping", start=1.5e-3, bounds=(1e-6, 5e-3)),
        Parameter("axle_stiffness", start=300.0, bounds=(1.0, 3e3)),
        Parameter("axle_time", start=2e-3, bounds=(2e-4, 0.03)),
        Parameter("corner_radius", start=0.005, bounds=(2e-4, 0.01), transform="linear"),
        *(Parameter(f"inertia_{axis}", start=1.3, bounds=(0.5, 3.0)) for axis in "xyz"),
    ]


def levelled(rows: Array) -> tuple[Array, Array]:
    """Return positions (n, 3) and quaternions (n, 4) over a level table at z = 0."""
    level = Rotation.align_vectors([[0.0, 0.0, 1.0]], [NORMAL])[0]
    first = level * Rotation.from_quat(rows[:, [1, 2, 3, 0]])
    position = SCALE * level.apply(rows[:, 4:7])
    # The boxes at rest: either is half an edge above the table where it lies flat.
    turned = first[-1] * Rotation.from_rotvec([0.0, rows[-1, 7], 0.0])
    middles = position[-1], position[-1] + first[-1].apply(HINGE) + turned.apply(SECOND)
    heights, lowest = [], []
    for rotation, middle in zip((first[-1], turned), middles, strict=True):
        upright = np.abs(rotation.inv().apply([0.0, 0.0, 1.0]))
        edge = int(np.argmax(upright))
        height = middle[2] - HALF[edge]
        if upright[edge] > np.cos(0.06) and height < 0.02:
            heights.append(height)
        lowest.append(middle[2] - upright @ HALF)
    position[:, 2] -= np.mean(heights) if heights else min(lowest)
    return position, first.as_quat()[:, [3, 0, 1, 2]]


def recorded(folder: Path) -> list[Trajectory]:
    archive = np.load(folder / "elbow_tosses" / "elbow.npz")
    trajectories = []
    for name in archive.files:
        rows = archive[name].astype(float)
        position, quaternion = levelled(rows)
        trajectories.append(
            Trajectory(name, np.arange(len(rows)) / RATE, position, quaternion, "first",
                       sensors={"hinge": rows[:, 7]})
        )  # fmt: skip
    return trajectories


def toss_problem(trajectories: list[Trajectory], window: float | None = None) -> Problem:
    """Return the problem, weighed by what models leave: 5 % of the length and 5 degrees."""
    return Problem(
        engine, parameters(), trajectories, 0.005, np.deg2rad(5.0),
        sensor_sigma={"hinge": np.deg2rad(5.0)}, substeps=4, window=window,
        initial_state="pose_and_velocity",
    )  # fmt: skip


def row(position: float, rotation: float, hinge: float) -> str:
    return f"{position:.1f} %, {rotation:.1f}°, {hinge:.1f}°"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("DASHPOT_DATA", "data")))
    parser.add_argument("--fitted", type=int, default=15)
    parser.add_argument("--window", type=float, default=0.2, help="of the fit, s")
    parser.add_argument("--evaluations", type=int, default=700)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=None)
    arguments = parser.parse_args()

    problem = with_flights(
        toss_problem(recorded(arguments.data), arguments.window), clearance=CLEARANCE
    )
    study = tosses.fit_and_predict(
        problem,
        fitted=arguments.fitted,
        width=WIDTH,
        max_evaluations=arguments.evaluations,
        seed=arguments.seed,
        nthread=arguments.threads,
    )
    console = Console(width=100)
    console.print(study.fit.table())
    console.print(f"{study.fit.seconds:.0f} s")
    table = Table(title=f"Two boxes on a hinge, fitted on {arguments.fitted} tosses")
    for column in ("s from the first frame", "seen", "unseen", "unseen, median"):
        table.add_column(column, justify="right")
    parts = tosses.split(problem.trajectories, arguments.fitted, arguments.seed)
    for window in (0.2, 0.3, 0.4, None):
        seen, unseen = (
            tosses.errors_of(
                replace(problem, trajectories=part, window=window), study.fit.values, WIDTH
            )
            for part in parts
        )
        table.add_row(
            "all, 0.8" if window is None else f"{window:g}",
            *(row(e.mean_position, e.mean_rotation, e.mean_hinge) for e in (seen, unseen)),
            row(*(float(np.median(e)) for e in (unseen.position, unseen.rotation, unseen.hinge))),
        )
    console.print(table)
    console.print("position, rotation, angle of the hinge")


if __name__ == "__main__":
    main()
