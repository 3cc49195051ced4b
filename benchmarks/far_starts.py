"""How often a fit ends in a bad valley when its start is wrong by a factor of 3 to 30.

Run ``python benchmarks/far_starts.py``. Stiffness, restitution and friction of a ball and of a box
are fitted to four noisy throws of half a second each, initial states given (``--unknown-states``:
fitted too). An end counts as bad where the variance of the weighted residuals is above 1.5.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from rich.console import Console
from rich.table import Table

import dashpot
from dashpot.calibrate import Parameter, Problem, Trajectory, fit
from dashpot.calibrate.twin import POSITION_NOISE, ROTATION_NOISE, tracked_poses

SHAPES = {
    "ball": 'type="sphere" size="0.05" mass="0.3"',
    "box": 'type="box" size="0.06 0.05 0.04" mass="0.5"',
}
BOUNDS = {
    "stiffness": (1e2, 1e6),
    "restitution": (0.01, 0.99),
    "sliding_friction": (0.01, 2.0),
}
FRAMES, SPACING, SUBSTEPS = 50, 0.01, 5
THROWS = 4
BAD = 1.5
OPTIONS: dict[str, dict[str, Any]] = {
    "starts=0": {"starts": 0},
    "starts=4": {"starts": 4},
    'method="cma"': {"method": "cma"},
    "default": {},
}


def engine(shape: str, values: Mapping[str, float]) -> dashpot.Engine:
    """Return an engine whose body and floor touch with `values`."""
    result = dashpot.Engine(
        mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="0.002"/><worldbody>
          <geom name="floor" type="plane" size="5 5 0.1"/>
          <body name="body" pos="0 0 0.3"><freejoint/><geom name="body" {SHAPES[shape]}/></body>
        </worldbody></mujoco>""")
    )
    material = dashpot.Material(
        values["stiffness"], restitution=values["restitution"], friction=values["sliding_friction"]
    )
    result.set_pair_material("body", "floor", material)
    return result


def draw(rng: np.random.Generator) -> tuple[dict[str, float], dict[str, float]]:
    """Draw hidden values and a start off by a factor of 3 to 30, restitution 1.1 in its logit."""
    truth = {
        "stiffness": math.exp(rng.uniform(math.log(3e3), math.log(5e4))),
        "restitution": rng.uniform(0.3, 0.85),
        "sliding_friction": rng.uniform(0.15, 0.6),
    }
    start: dict[str, float] = {}
    for name in ("stiffness", "sliding_friction"):
        low, high = BOUNDS[name]
        while not 1.1 * low < start.get(name, 0.0) < 0.9 * high:
            factor = math.exp(rng.uniform(math.log(3.0), math.log(30.0)))
            start[name] = truth[name] * factor ** rng.choice([-1, 1])
    far = False
    while not far:
        start["restitution"] = rng.uniform(0.03, 0.97)
        far = abs(_logit(start["restitution"]) - _logit(truth["restitution"])) > 1.1
    return truth, start


def problem(shape: str, seed: int, unknown_states: bool) -> Problem:
    """Return the calibration of one seed."""
    rng = np.random.default_rng(seed)
    truth, start = draw(rng)
    true_engine = engine(shape, truth)
    parameters = [
        Parameter.pair("body", "floor", name, start=start[name], bounds=bounds)
        for name, bounds in BOUNDS.items()
    ]
    return Problem(
        engine(shape, start),
        parameters,
        [throw(true_engine, rng, i, unknown_states) for i in range(THROWS)],
        POSITION_NOISE,
        ROTATION_NOISE,
        initial_state="pose_and_velocity" if unknown_states else "given",
    )


def throw(
    system: dashpot.Engine, rng: np.random.Generator, index: int, unknown_states: bool
) -> Trajectory:
    """Return the noisy poses of a throw in any direction, orientation and spin."""
    data = system.make_data()
    orientation = rng.normal(size=4)
    data.qpos[2] = rng.uniform(0.12, 0.25)
    data.qpos[3:7] = orientation / np.linalg.norm(orientation)
    heading = rng.uniform(0.0, 2.0 * np.pi)
    data.qvel[:2] = rng.uniform(0.5, 2.0) * np.array([np.cos(heading), np.sin(heading)])
    data.qvel[2] = rng.uniform(-1.0, 0.0)
    data.qvel[3:] = 2.0 * rng.normal(size=3)
    state: dict[str, Any] = {"initial_qpos": data.qpos.copy(), "initial_qvel": data.qvel.copy()}
    position, quaternion = tracked_poses(system, data, FRAMES, SUBSTEPS, rng)
    return Trajectory(
        f"throw {index}",
        SPACING * np.arange(FRAMES),
        position,
        quaternion,
        ("body",),
        **({} if unknown_states else state),
    )


def _logit(share: float) -> float:
    return math.log(share / (1.0 - share))


def main() -> None:
    """Fit from every start with every option and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repetitions", type=int, default=30)
    parser.add_argument("--unknown-states", action="store_true")
    parser.add_argument("--options", nargs="+", choices=OPTIONS, default=list(OPTIONS))
    parser.add_argument("--nthread", type=int, default=None)
    arguments = parser.parse_args()

    table = Table(title=f"Ends of {arguments.repetitions} fits from far starts")
    for heading in ("shape", "options", "bad", "of them said so", "simulations", "seconds"):
        table.add_column(heading, justify="left" if heading in ("shape", "options") else "right")
    for shape in SHAPES:
        problems = [
            problem(shape, seed, arguments.unknown_states) for seed in range(arguments.repetitions)
        ]
        for name in arguments.options:
            fits = [fit(p, nthread=arguments.nthread, **OPTIONS[name]) for p in problems]
            bad = [f for f in fits if f.residual_variance > BAD]
            table.add_row(
                shape,
                name,
                f"{len(bad)}",
                f"{sum(not f.noise_explains for f in bad)}",
                f"{np.median([f.evaluations for f in fits]):.0f}",
                f"{np.median([f.seconds for f in fits]):.2f}",
            )
    Console().print(table)


if __name__ == "__main__":
    main()
