"""A load cell: a cart that runs into a pad, and a weight that falls on a plate."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

import dashpot
from dashpot.calibrate import Parameter, Problem, Trajectory

from .case import Case, draw, means_before, on_lines, simulate

Array = NDArray[np.float64]

STEP = 0.01
LOAD, PLACE = 0.05, 1e-3  # noise, N and m
CART = """
<mujoco>
  <option timestep="{timestep}"/>
  <worldbody>
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0" frictionloss="0.02"/>
      <geom name="cart" type="box" size=".08 .04 .02" mass=".55" contype="0" conaffinity="0"/>
      <geom name="bumper" type="sphere" size=".01" pos=".09 0 0" mass="0"/>
      <site name="cell" pos=".09 0 0" size=".03"/>
    </body>
    <body name="pad"><geom name="pad" type="box" size=".2 .5 .5" pos=".3 0 0"/></body>
  </worldbody>
  <sensor><touch name="load" site="cell"/><jointpos name="place" joint="rail"/></sensor>
</mujoco>
"""
PLATE = """
<mujoco>
  <option timestep="0.004"/>
  <worldbody>
    <body name="weight">
      <joint name="guide" type="slide" axis="0 0 1"/>
      <geom name="weight" type="sphere" size=".03" mass="1"/>
      <site name="cell" size=".05"/>
    </body>
    <geom name="plate" type="plane" size="1 1 .1" pos="0 0 -.03"/>
  </worldbody>
  <sensor><touch name="load" site="cell"/></sensor>
</mujoco>
"""


def tilt(system: dashpot.Engine, along: float) -> None:
    """Let gravity pull along the track, m/s^2."""
    system.model.opt.gravity[:] = along, 0.0, -9.81


def shift(system: dashpot.Engine, place: float) -> None:
    """Put the pad elsewhere, m."""
    system.model.body("pad").pos[0] = place


STIFFNESS = Parameter.pair("bumper", "pad", "stiffness", start=100.0, bounds=(5.0, 5e3))
DAMPING = Parameter.pair("bumper", "pad", "damping", start=0.5, bounds=(1e-3, 20.0))
FRICTION = Parameter.pair("bumper", "pad", "sliding_friction", start=0.5, bounds=(0.01, 3.0))
MASS = Parameter.model("body_mass", "cart", start=0.55, bounds=(0.2, 1.5), name="mass")
RAIL = Parameter.model(
    "dof_frictionloss", "rail", start=0.02, bounds=(1e-4, 0.5), name="rail_friction"
)
PAD = Parameter(
    "pad", start=-0.06, bounds=(-0.15, 0.05), transform="linear", apply=shift, changes_model=True
)
SLOPE = Parameter(
    "slope", start=0.01, bounds=(-1, 1), transform="linear", apply=tilt, changes_model=True
)


def cart(stiffness: float = 100.0, damping: float = 0.5) -> dashpot.Engine:
    """Return an engine of the cart and its pad."""
    made = dashpot.Engine(mujoco.MjModel.from_xml_string(CART.format(timestep=STEP)))
    material = dashpot.Material(stiffness=stiffness, damping=damping)
    made.set_pair_material("bumper", "pad", material)
    return made


def runs(
    values: Mapping[str, float],
    rng: np.random.Generator,
    count: int,
    *,
    every: int,
    late: float = 0.0,
) -> list[Trajectory]:
    """Return runs of a cart: loads at 100 Hz, means of 10 ms, and every so many frames a place."""
    seen = []
    for run in range(count):
        system = cart(values["stiffness"], values["damping"])
        system.model.body("cart").mass[:] = values["mass"]
        system.model.dof_frictionloss[:] = values["rail_friction"]
        shift(system, values["pad"])
        tilt(system, values.get("slope", 0.0))
        start, speed = rng.uniform(-0.38, -0.32), rng.uniform(0.75, 0.9)
        # A moment longer, for loads that come late.
        path, read = simulate(system, np.array([start]), np.array([speed]), STEP, 101)
        time = 0.01 * np.arange(101)
        load = means_before(read[:, 0], time - late, 0.01, STEP) + LOAD * rng.normal(size=101)
        place = on_lines(path, time, STEP)[:, 0] + PLACE * rng.normal(size=101)
        place[np.arange(101) % every != run % every] = np.nan
        first, second = np.flatnonzero(~np.isnan(place))[[0, 4]]
        rate = (place[second] - place[first]) / (time[second] - time[first])
        seen.append(
            Trajectory.of_sensors(
                f"run {run}", time, {"load": load, "place": place},
                initial_qpos=[place[first] - rate * time[first]], initial_qvel=[rate],
            )
        )  # fmt: skip
    return seen


def foam(rng: np.random.Generator, slope: float) -> dict[str, float]:
    """Return hidden values like those of a foam pad and its cart."""
    return {
        "stiffness": draw(rng, 60.0, 100.0),
        "damping": draw(rng, 0.3, 1.0),
        "mass": draw(rng, 0.45, 0.6),
        "rail_friction": draw(rng, 0.05, 0.1),
        "pad": rng.uniform(-0.07, -0.06),
        "slope": slope,
    }


def late_force(rng: np.random.Generator) -> list[Case]:
    """Two runs into a pad that stands where it is known, with loads some 20 ms late."""
    values = {**foam(rng, 0.0), "pad": -0.06}
    late = rng.uniform(0.015, 0.025)
    seen = runs(values, rng, 2, every=2, late=late)
    unknown = [
        STIFFNESS,
        DAMPING,
        MASS,
        RAIL,
        Parameter.delay("load", bounds=(-0.01, 0.05), name="delay"),
        FRICTION,
    ]
    system = cart()
    shift(system, -0.06)
    made = Problem(
        system, unknown, seen, sensor_sigma={"load": LOAD, "place": PLACE},
        initial_state="pose_and_velocity",
    )  # fmt: skip
    truth = {name: values[name] for name in ("stiffness", "damping", "mass", "rail_friction")}
    return [Case(made, {**truth, "delay": late}, ("sliding_friction",))]


def sloping_track(rng: np.random.Generator) -> list[Case]:
    """Three runs on a track that slopes by two degrees, fitted with the slope and without."""
    values = foam(rng, rng.choice([-1.0, 1.0]) * 0.3)
    values["pad"] = -0.06
    seen = runs(values, rng, 3, every=4)
    cases = []
    for unknown in ([SLOPE], []):
        made = Problem(
            cart(), [STIFFNESS, DAMPING, MASS, RAIL, PAD, *unknown], seen,
            sensor_sigma={"load": 0.05, "place": 5 * PLACE},
            initial_state="pose_and_velocity", noise="estimate",
        )  # fmt: skip
        truth = values if unknown else {}
        cases.append(Case(made, truth, options={"starts": 0}, wrong=not unknown))
    return cases


def falling_weight(rng: np.random.Generator) -> list[Case]:
    """Let a weight drop on a load cell from known heights, in loads at 250 Hz alone.

    Where the gain of the cell is unknown too, loads tell neither it, nor mass, nor stiffness: all
    three may grow by the same factor.
    """
    truth = {
        "stiffness": draw(rng, 3e3, 1e4),
        "restitution": draw(rng, 0.3, 0.8),
        "mass": draw(rng, 0.7, 1.4),
    }
    seen = []
    time = 0.004 * np.arange(101)
    for i, height in enumerate((0.04, 0.08)):
        system = plate(truth["stiffness"], truth["restitution"])
        system.model.body("weight").mass[:] = truth["mass"]
        _, read = simulate(system, np.array([height]), np.zeros(1), 0.004, 100)
        load = means_before(read[:, 0], time, 0.004, 0.004) + 2.0 * rng.normal(size=101)
        load[0] = np.nan
        seen.append(
            Trajectory.of_sensors(
                f"drop {i}", time, {"load": load}, initial_qpos=[height], initial_qvel=[0.0],
                initial_qpos_sigma=[0.002], initial_qvel_sigma=[0.0],
            )
        )  # fmt: skip
    told = [
        Parameter.pair("weight", "plate", "stiffness", start=5e3, bounds=(1e2, 1e6)),
        Parameter.pair("weight", "plate", "restitution", start=0.5, bounds=(0.05, 0.98)),
        Parameter.model("body_mass", "weight", start=1.0, bounds=(0.1, 10.0), name="mass"),
    ]
    friction = Parameter.pair("weight", "plate", "sliding_friction", start=0.5, bounds=(0.01, 3.0))
    gain = Parameter.gain("load", bounds=(0.1, 10.0), name="gain")
    cases = []
    for more, known, silent in (
        (friction, truth, ("sliding_friction",)),
        (gain, {"restitution": truth["restitution"]}, ("stiffness", "mass", "gain")),
    ):
        made = Problem(
            plate(), [*told, more], seen, sensor_sigma={"load": 2.0},
            initial_state="pose_and_velocity",
        )  # fmt: skip
        cases.append(Case(made, known, silent))
    return cases


def plate(stiffness: float = 5e3, restitution: float = 0.5) -> dashpot.Engine:
    """Return an engine of the weight over its plate."""
    made = dashpot.Engine(mujoco.MjModel.from_xml_string(PLATE))
    material = dashpot.Material(stiffness=stiffness, restitution=restitution)
    made.set_pair_material("weight", "plate", material)
    return made
