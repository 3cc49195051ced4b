"""First frames that have a body deeper in the floor than its contact can give way."""

import math

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot.calibrate import Parameter, Problem, Trajectory, fit
from dashpot.calibrate.problem.buried_starts import buried_starts

SCENE = """<mujoco><worldbody><geom name="floor" type="plane" size="5 5 .1" {floor}/>
  <body name="part" pos="0 0 .3"><freejoint/><geom name="part" {geom} mass="1"/></body>
  </worldbody></mujoco>"""
BALL, BOX = 'size=".1"', 'type="box" size=".1 .1 .1"'
IDENTITY = [1.0, 0.0, 0.0, 0.0]
GRAVITY, NOISE = 9.81, 1e-3


def problem(height, geom=BALL, *, stiffness=1e5, floor="", quaternion=None, speed=0.0, more=()):
    time = 0.01 * np.arange(20)
    position = np.zeros((20, 3))
    position[:, 2] = height - speed * time
    turned = None if quaternion is None else np.tile(quaternion, (20, 1))
    trajectory = Trajectory("run", time, position, turned, "part")
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(SCENE.format(geom=geom, floor=floor)))
    if floor:
        unknown = Parameter.model("body_mass", "part", start=1.0, bounds=(0.5, 2.0))
    else:
        bounds = (stiffness / 10, stiffness * 10)
        unknown = Parameter.pair("part", "floor", "stiffness", start=stiffness, bounds=bounds)
    rotation = math.inf if quaternion is None else 0.01
    return Problem(
        engine, [unknown, *more], [trajectory], NOISE, rotation, initial_state="pose_and_velocity"
    )


def test_a_ball_that_starts_in_the_floor_is_told_by_how_much():
    said = buried_starts(problem(0.05))["run"]
    # 50 mm of the radius; four deviations of noise and the sag under a weight twice as large on a
    # fourth of the stiffness.
    explained = 4 * NOISE + 2 * GRAVITY / (1e5 / 4)
    assert said == (
        "geom 'part' is 50 mm deep in geom 'floor' in the first frames, of which noise and its "
        f"contact explain {1e3 * explained:.2g} mm"
    )
    with pytest.warns(UserWarning, match=r"trajectory 'run': geom 'part' is 50 mm deep .* units"):
        fit(problem(0.05), max_evaluations=20, starts=0)


@pytest.mark.parametrize(
    ("geom", "options"),
    [
        (BALL, {"height": 0.1 - 3 * NOISE}),
        (BALL, {"height": 0.05, "stiffness": 1e3}),  # a foam ball sags so far
        (
            BALL,
            {"height": 0.05, "speed": 5.0, "stiffness": 1e4},
        ),  # it may be in the midst of an impact
        (BALL, {"height": 0.05, "floor": 'solref=".05 1"'}),  # which gives way by the load
        (BALL, {"height": 0.05, "more": (Parameter.scale(bounds=(0.5, 2.0)),)}),
        (BOX, {"height": 0.05}),  # nobody knows how it is turned
        (BOX, {"height": 0.1, "quaternion": IDENTITY}),
    ],
)
def test_what_noise_contact_or_an_unknown_may_explain_is_not_told(geom, options):
    assert buried_starts(problem(geom=geom, **options)) == {}


def test_a_box_is_looked_at_as_it_was_turned():
    """On an edge it reaches farther down: sqrt(2) of its half side."""
    assert buried_starts(problem(0.12, BOX, quaternion=IDENTITY)) == {}
    eighth = [math.cos(math.pi / 8), math.sin(math.pi / 8), 0.0, 0.0]
    depth = 100 * math.sqrt(2) - 120
    said = buried_starts(problem(0.12, BOX, quaternion=eighth))["run"]
    assert said.startswith(f"geom 'part' is {depth:.3g} mm deep in geom 'floor'")
