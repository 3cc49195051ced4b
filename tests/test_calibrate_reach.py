"""Calibration: intervals that reach as far as the cost itself allows, not its curvature alone."""

import math

import mujoco
import numpy as np
import pytest
from scipy import stats

import dashpot
from dashpot.calibrate import Parameter, Problem, Trajectory, fit
from dashpot.calibrate.inference.profiles import Place, reach
from dashpot.calibrate.residuals.objective import Objective

BALL = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body name="ball" pos="0 0 .3"><freejoint/><geom name="ball" size=".05" mass=".3"/>
      <site name="centre"/></body>
  </worldbody>
  <sensor><framelinvel name="velocity" objtype="site" objname="centre"/></sensor>
</mujoco>
"""
FRICTION, NOISE, FRAMES = 0.25, 5e-3, 80  # m/s; frames 10 ms apart
BOUNDS = (0.01, 2.0)


def ball(friction):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL))
    material = dashpot.Material(8e3, restitution=0.6, friction=friction)
    engine.set_pair_material("ball", "floor", material)
    return engine


def velocities(seed):
    """Record how fast a ball that spins flies: friction slows it in two short contacts."""
    engine, rng = ball(FRICTION), np.random.default_rng(seed)
    data = engine.make_data()
    data.qvel[:] = [0.8, 0.1, 0.0, 0.0, 20.0, 0.0]
    start = {"initial_qpos": data.qpos.copy(), "initial_qvel": data.qvel.copy()}
    seen = mujoco.MjData(engine.model)
    reading = np.empty((FRAMES, 3))
    for k in range(FRAMES):
        if k:
            engine.step(data, 5)
        seen.qpos[:], seen.qvel[:] = data.qpos, data.qvel
        mujoco.mj_forward(engine.model, seen)
        reading[k] = seen.sensor("velocity").data + NOISE * rng.normal(size=3)
    return Trajectory.of_sensors("throw", 0.01 * np.arange(FRAMES), {"velocity": reading}, **start)


def problem(seed):
    friction = Parameter.pair("ball", "floor", "sliding_friction", start=FRICTION, bounds=BOUNDS)
    return Problem(
        ball(FRICTION),
        [friction],
        [velocities(seed)],
        math.inf,
        math.inf,
        sensor_sigma={"velocity": NOISE},
    )


@pytest.mark.parametrize("seed", [101, 109, 124, 127])
def test_hardly_determined_friction_keeps_all_that_the_cost_allows(seed):
    """Friction of 0.08 to 0.25 and more holds the ball nearly as soon: the cost is flat there.

    Its curvature gives ends that differ by a factor of 3.3, with the truth outside.
    """
    posed = problem(seed)
    result = fit(posed, starts=0)
    friction = result["sliding_friction"]
    objective = Objective(posed)
    values = np.geomspace(*BOUNDS, 40)[1:-1]
    costs = 0.5 * np.sum(objective.residuals(np.log(values)[:, None]) ** 2, axis=1)
    quantile = stats.t.ppf(0.975, result.live_residuals - 1)
    rise = 0.5 * quantile**2 * result.residual_variance
    allowed = costs - result.cost < rise
    # Ends are interpolated over doubling distances: half of a value's step of 14 % is left to them.
    inside = (values > friction.lower / 1.07) & (values < friction.upper * 1.07)
    assert inside[allowed].all()
    assert not friction.identified
    # And no farther than need be: at the upper end the cost has risen by that, to a third.
    end = 0.5 * float(np.sum(objective.residuals(np.log([[friction.upper]])) ** 2)) - result.cost
    assert end == pytest.approx(rise, rel=0.33)


def walked(cost_at, ways, held=1):
    """Return a beginning at 0.5 and places that many units above it."""
    points = [np.array([9.0, 0.5 + way]) for way in (0.0, *ways)]
    places = [Place(p, np.empty(0), cost_at(p[held] - 0.5)) for p in points]
    return places[0], places[1:]


@pytest.mark.parametrize("wanted", [0.7, 1.9, 5.0])
def test_the_reach_on_a_parabola_is_exact(wanted):
    begin, places = walked(lambda x: 3.0 + 2.0 * x**2, [0.1, 0.2, 0.4, 0.8, 1.6, 3.2])
    assert reach(places, 1, begin, 3.0, wanted) == pytest.approx(math.sqrt(wanted / 2.0))


def test_the_reach_goes_on_to_the_last_place_that_is_low():
    """Over a hill to a second valley, and to the end of what is flat."""
    begin, places = walked({0.0: 1.0, 1.0: 9.0, 2.0: 1.0, 4.0: 17.0}.get, [1.0, 2.0, 4.0])
    # The root of the rise goes from 0 at 2 to 4 at 4.
    assert reach(places, 1, begin, 1.0, 4.0) == pytest.approx(3.0)
    begin, places = walked(lambda x: 1.0 + 0.1 * x, [1.0, 2.0, 4.0])
    assert reach(places, 1, begin, 1.0, 1.9) == 4.0
    assert reach(places, 1, begin, 1.0, 0.05) == 0.0
    assert reach([], 1, begin, 1.0, 1.9) == 0.0
