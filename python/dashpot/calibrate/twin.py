"""Twin experiment: recover hidden contact parameters from noisy poses of a simulated body.

A box with a round nose is thrown onto a floor several times; it bounces, turns and slides to rest.
Stiffness, damping and sliding friction are hidden, poses get normal noise, and the fit starts from
values that are wrong by up to a factor of five, with initial poses and velocities unknown.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.fit import fit
from dashpot.calibrate.problem.parameters import MaterialField, Parameter
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.result import Fit
from dashpot.engine import Engine
from dashpot.materials import Material

Array = NDArray[np.float64]

POSITION_NOISE = 2e-4  # m
ROTATION_NOISE = 2e-3  # rad
FRAME_SPACING = 0.01  # s
FRAMES = 40
THROWS = 4
SUBSTEPS = 2
WINDOWS = (0.2,)  # s

_XML = """
<mujoco>
  <option timestep="0.002" cone="elliptic"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 0.1"/>
    <body name="body" pos="0 0 0.3">
      <freejoint/>
      <geom name="body" type="box" size="0.06 0.05 0.04" mass="0.5"/>
    </body>
  </worldbody>
</mujoco>
"""

BOUNDS = {
    "stiffness": (1e2, 1e6),
    "damping": (1e-1, 1e3),
    "sliding_friction": (0.01, 2.0),
}


@dataclass(frozen=True, eq=False)
class Twin:
    """A twin experiment: what was hidden, what was seen, what was recovered.

    Attributes
    ----------
    truth
        Hidden values by parameter name.
    start
        Where the fit started, by name.
    problem
        The calibration problem with the noisy trajectories.
    fit
        The result.
    """

    truth: dict[str, float]
    start: dict[str, float]
    problem: Problem
    fit: Fit

    @property
    def covered(self) -> dict[str, bool]:
        """Whether the truth lies in the interval, by name."""
        return {
            name: self.fit[name].lower <= value <= self.fit[name].upper
            for name, value in self.truth.items()
        }


def engine(values: dict[str, float]) -> Engine:
    """Return an engine whose body and floor touch with `values`."""
    result = Engine(mujoco.MjModel.from_xml_string(_XML))
    material = Material(
        values["stiffness"], damping=values["damping"], friction=values["sliding_friction"]
    )
    result.set_pair_material("body", "floor", material)
    return result


def draw(rng: np.random.Generator) -> tuple[dict[str, float], dict[str, float]]:
    """Draw hidden values and a wrong start, off by a factor of 2 to 5 (friction 1.5 to 2.5)."""
    truth = {
        "stiffness": float(np.exp(rng.uniform(np.log(2e3), np.log(2e4)))),
        "damping": float(np.exp(rng.uniform(np.log(4.0), np.log(20.0)))),
        "sliding_friction": float(rng.uniform(0.15, 0.5)),
    }
    start = {}
    for name, value in truth.items():
        most = 2.5 if name == "sliding_friction" else 5.0
        factor = np.exp(rng.uniform(np.log(0.5 * most), np.log(most)))
        start[name] = float(value * factor ** rng.choice([-1.0, 1.0]))
    return truth, start


def throws(truth: dict[str, float], rng: np.random.Generator) -> list[Trajectory]:
    """Simulate the throws and add the noise of a pose tracker."""
    system = engine(truth)
    model = system.model
    model.opt.timestep = FRAME_SPACING / SUBSTEPS
    result = []
    for throw in range(THROWS):
        data = system.make_data()
        axis = rng.normal(size=3)
        axis *= rng.uniform(0.1, 0.6) / np.linalg.norm(axis)
        mujoco.mju_quatIntegrate(data.qpos[3:7], axis, 1.0)
        data.qpos[2] = rng.uniform(0.12, 0.2)
        heading = rng.uniform(0.0, 2.0 * np.pi)
        data.qvel[:2] = rng.uniform(0.8, 1.6) * np.array([np.cos(heading), np.sin(heading)])
        data.qvel[3:] = rng.normal(size=3)
        position, quaternion = tracked_poses(system, data, FRAMES, SUBSTEPS, rng)
        result.append(
            Trajectory(
                name=f"throw {throw}",
                time=FRAME_SPACING * np.arange(FRAMES, dtype=np.float64),
                position=position,
                quaternion=quaternion,
                bodies=("body",),
            )
        )
    return result


def tracked_poses(
    system: Engine, data: mujoco.MjData, frames: int, substeps: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Step the first free body on and return its poses with the noise of a pose tracker.

    Returns
    -------
    (frames, 3) positions (m) and (frames, 4) quaternions (scalar first), `substeps` steps apart.
    """
    position, quaternion = np.empty((frames, 3)), np.empty((frames, 4))
    for frame in range(frames):
        if frame:
            system.step(data, substeps)
        position[frame] = data.qpos[:3] + POSITION_NOISE * rng.normal(size=3)
        quaternion[frame] = data.qpos[3:7]
        mujoco.mju_quatIntegrate(quaternion[frame], ROTATION_NOISE * rng.normal(size=3), 1.0)
    return position, quaternion


def run(*, seed: int = 0, nthread: int | None = None, progress: bool = False) -> Twin:
    """Run one twin experiment.

    Parameters
    ----------
    seed
        Of the hidden values, the wrong start, the throws and the noise.
    nthread, progress
        As in `dashpot.calibrate.fit`.
    """
    rng = np.random.default_rng(seed)
    truth, start = draw(rng)
    trajectories = throws(truth, rng)
    names: tuple[MaterialField, ...] = ("stiffness", "damping", "sliding_friction")
    problem = Problem(
        engine(start),
        [
            Parameter.pair("body", "floor", name, start=start[name], bounds=BOUNDS[name])
            for name in names
        ],
        trajectories,
        POSITION_NOISE,
        ROTATION_NOISE,
        substeps=SUBSTEPS,
        initial_state="pose_and_velocity",
    )
    result = fit(
        problem,
        windows=WINDOWS,
        starts=31,
        local_searches=8,
        max_evaluations=6000,
        seed=seed,
        nthread=nthread,
        progress=progress,
    )
    return Twin(truth, start, problem, result)
