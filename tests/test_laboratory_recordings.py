"""Recordings of laboratories: a load cell and a foam pad, and the sounds of bouncing balls."""

from __future__ import annotations

import csv
import os
from collections import defaultdict
from pathlib import Path

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot.calibrate import Parameter, Problem, Trajectory, fit
from twin_scenes.carts import CART

G = 9.81
BALL = """
<mujoco>
  <option timestep="0.01" density="{density}"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body name="ball" pos="0 0 {radius}">
      <freejoint/>
      <geom name="ball" type="sphere" size="{radius}" mass="{mass}"
            fluidshape="ellipsoid" fluidcoef=".25 0 0 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""


def folder(name):
    found = Path(os.environ.get("DASHPOT_DATA", "")) / name
    if not os.environ.get("DASHPOT_DATA") or not found.is_dir():
        pytest.skip(f"no {name}: set DASHPOT_DATA")
    return found


def runs_into_foam(thickness, wanted):
    """Return time (s), load (N) and place (m) half a second either side of the greatest load."""
    rows = defaultdict(list)
    with open(folder("foam_pads") / f"pad_{thickness}mm.csv") as file:
        for row in csv.DictReader(file):
            numbers = (row["time_s"], row["force_N"], row["position_m"], row["velocity_m_s"])
            rows[int(row["run"])].append([float(n or "nan") for n in numbers])
    for run in wanted:
        time, load, place, speed = np.array(rows[run]).T
        peak = time[np.nanargmin(load)]
        kept = np.abs(time - peak) < 0.5 + 1e-9
        # The motion sensor looks from either end of the track.
        towards = np.sign(np.nanmedian(speed[kept & (time < peak - 0.15)]))
        yield time[kept] - time[kept][0], -load[kept], towards * place[kept]


def tilt(system, value):
    system.model.opt.gravity[:] = value, 0.0, -G


def shift(system, value):
    system.model.body("pad").pos[0] = value


def cart_into_foam(runs, *, slope):
    """Return a problem of some runs; speeds are left out, as they are computed from places."""
    trajectories, origin = [], None
    for run, (time, load, place) in zip(runs, runs_into_foam(40, runs), strict=True):
        seen = np.flatnonzero(~np.isnan(place))
        if origin is None:
            origin = np.interp(time[np.argmax(load)], time[seen], place[seen])
        first, second = seen[:2]
        speed = (place[second] - place[first]) / (time[second] - time[first])
        trajectories.append(
            Trajectory.of_sensors(
                f"run {run}", time, {"load": load, "place": place - origin},
                initial_qpos=[place[first] - origin - speed * time[first]], initial_qvel=[speed],
            )
        )  # fmt: skip
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(CART.format(timestep=0.01)))
    engine.set_pair_material("bumper", "pad", dashpot.Material(stiffness=100.0, damping=0.5))
    unknown = [
        Parameter.pair("bumper", "pad", "stiffness", start=100.0, bounds=(5.0, 5e3)),
        Parameter.pair("bumper", "pad", "damping", start=0.5, bounds=(1e-3, 20.0)),
        Parameter.model("body_mass", "cart", start=0.55, bounds=(0.2, 1.5), name="mass"),
        Parameter.model("dof_frictionloss", "rail", start=0.02, bounds=(1e-4, 0.5)),
        Parameter(
            "pad", start=-0.06, bounds=(-0.15, 0.05), transform="linear", apply=shift,
            changes_model=True,
        ),
        Parameter.offset("load", bounds=(-0.5, 0.5), per="trajectory"),
        Parameter(
            "slope", start=0.01, bounds=(-1.0, 1.0), transform="linear", apply=tilt,
            changes_model=True,
        ),
    ]  # fmt: skip
    return Problem(
        engine, unknown if slope else unknown[:-1], trajectories,
        sensor_sigma={"load": 0.05, "place": 0.005},
        initial_state="pose_and_velocity", noise="estimate",
    )  # fmt: skip


def test_a_load_cell_and_a_slope_tell_the_stiffness_of_foam_and_the_mass_of_its_cart():
    """Values are those of an independent fit of the equation of motion: 77.7 N/m and 0.525 kg."""
    result = fit(cart_into_foam((1, 2, 3), slope=True), starts=0, max_evaluations=1500)
    assert result["stiffness"].value == pytest.approx(77.7, rel=0.02)
    assert result["mass"].value == pytest.approx(0.525, rel=0.02)
    for name, value in (("stiffness", 77.7), ("mass", 0.525)):
        assert result[name].grade in ("identified", "within misfit")
        assert result[name].lower < value < result[name].upper


def test_without_the_slope_the_motion_sensor_is_said_to_be_described_wrongly():
    result = fit(cart_into_foam((1, 2), slope=False), starts=0, max_evaluations=1500)
    assert [misfit.channel for misfit in result.misfits] == ["place"]
    for name in ("stiffness", "mass"):
        assert result[name].grade != "identified"
        assert "place (correlation" in result[name].statement
    # What it would be trusted for is wrong by more than 4 %.
    assert result["stiffness"].value > 1.04 * 77.7
    assert result["mass"].value > 1.04 * 0.525


def air(system, coefficient):
    """Put in a drag of a sphere, of which the coefficient of a blunt ellipsoid is half."""
    system.model.geom_fluid[system.model.geom("ball").id, 1] = 0.5 * coefficient


def bounces(ball, *, throws, radius, mass, guess, density=0.0):
    """Return a problem of sounds alone: where and how fast a ball was before is not known."""
    intervals = defaultdict(dict)
    with open(folder("bounce_intervals") / "intervals.csv") as file:
        for row in csv.DictReader(file):
            if row["ball"] == ball:
                throw = intervals[f"height {row['drop_height']}, throw {row['throw']}"]
                throw[int(row["bounce"])] = float(row["interval_s"])
    lead = 0.05  # s before the first sound
    unknown_fall = [0.0, 0.0, np.inf, 0.0, 0.0, 0.0]
    trajectories = []
    for name in list(intervals)[:: len(intervals) // throws]:
        times = [intervals[name][bounce] for bounce in sorted(intervals[name])]
        speed = 0.5 * G * times[0] / guess
        trajectories.append(
            Trajectory.of_events(
                name, {"impact": lead + np.cumsum([0.0, *times])}, bodies="ball",
                initial_qpos=[0, 0, radius + lead * speed - 0.5 * G * lead**2, 1, 0, 0, 0],
                initial_qvel=[0, 0, G * lead - speed, 0, 0, 0],
                initial_qpos_sigma=unknown_fall, initial_qvel_sigma=unknown_fall,
            )
        )  # fmt: skip
    scene = BALL.format(radius=radius, mass=mass, density=density)
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(scene))
    material = dashpot.Material(stiffness=1e5, restitution=guess)
    engine.set_pair_material("ball", "floor", material)
    unknown = [Parameter.pair("ball", "floor", "restitution", start=guess, bounds=(0.05, 0.999))]
    if density:
        unknown.append(
            Parameter("drag", start=0.4, bounds=(0.05, 3.0), apply=air, changes_model=True)
        )
    return Problem(
        engine, unknown, trajectories, event_sigma={"impact": 1e-3},
        initial_state="pose_and_velocity", noise="estimate",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("ball", "radius", "mass", "restitution"), [("tennis", 0.033, 0.058, 0.761)]
)
def test_sounds_alone_tell_restitution(ball, radius, mass, restitution):
    """Without drag it is the ratio of successive intervals."""
    problem = bounces(ball, throws=4, radius=radius, mass=mass, guess=0.8)
    estimate = fit(problem, starts=0)["restitution"]
    assert estimate.value == pytest.approx(restitution, abs=0.005)
    assert estimate.identified
    assert estimate.upper - estimate.lower < 0.02


def test_sounds_of_a_light_ball_tell_its_drag_too():
    """Of a sphere it is 0.4 to 0.5 at the Reynolds numbers of 3e3 to 1e4 that it has here."""
    problem = bounces("table_tennis", throws=4, radius=0.02, mass=0.0027, guess=0.95, density=1.2)
    result = fit(problem, starts=0)
    assert 0.944 < result["restitution"].value < 0.965
    assert result["drag"].lower < 0.5
    assert result["drag"].upper > 0.4
    assert all(estimate.identified for estimate in result.estimates)
    # A ball that bounces better and is slowed down more sounds much alike.
    assert result.correlation[0, 1] > 0.7
