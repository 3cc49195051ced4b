"""A body that sinks through a geom in the simulation with an estimate is named."""

import warnings

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot.calibrate import Parameter, Problem, Trajectory, fit

SCENE = """<mujoco><option timestep="0.005"/><worldbody>
  <geom name="table" {table}/>
  <body name="body" pos="0 0 {height}"><freejoint/><geom name="{name}" {shape} mass="1"/></body>
</worldbody></mujoco>"""
PLANE = 'type="plane" size="2 2 .1"'
SLAB = 'type="box" size="1 1 .01" pos="0 0 -.01"'
BALL, BOX = 'size=".05"', 'type="box" size=".05 .05 .05"'


def at_rest(model, frames=30):
    """Return what is seen of a body that rests where the model has it."""
    data = mujoco.MjData(model)
    return Trajectory(
        "rest",
        0.02 * np.arange(frames),
        np.tile(data.qpos[:3], (frames, 1)),
        np.tile(data.qpos[3:], (frames, 1)),
        "body",
        initial_qpos=data.qpos,
        initial_qvel=data.qvel,
    )


def said_by_fit(table, shape, name, bounds, mujoco_steps=False):
    height = 0.0499
    xml = SCENE.format(table=table, shape=shape, name=name, height=height)
    model = mujoco.MjModel.from_xml_string(xml)
    start = 0.5 * (bounds[0] + bounds[1])
    if mujoco_steps:
        system = model
        stiff = Parameter.model(
            "geom_solref", ["table", name], index=0, start=-start, bounds=(-bounds[1], -bounds[0]),
            transform="linear",
        )  # fmt: skip
        model.geom_solref[:, 1] = -1.0
    else:
        system = dashpot.Engine(model)
        system.set_pair_material("table", name, dashpot.Material(start, damping_ratio=1.0))
        stiff = Parameter.pair("table", name, "stiffness", start=start, bounds=bounds)
    problem = Problem(system, [stiff], [at_rest(model)], 1e-3, 1e-2)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        fit(problem, starts=0, max_evaluations=20)
    assert all(w.filename == __file__ for w in caught)
    return [str(w.message) for w in caught]


@pytest.mark.parametrize("table", [PLANE, SLAB])
@pytest.mark.parametrize(("shape", "name"), [(BALL, "ball"), (BOX, "cube")])
def test_a_body_on_a_contact_that_is_too_soft_is_named(table, shape, name):
    """1 kg on at most 4 N/m comes to rest metres below, or beyond a slab."""
    (text,) = said_by_fit(table, shape, name, (0.5, 4.0))
    assert text.startswith("trajectory 'rest': geom ")
    assert f"'{name}'" in text
    assert "stiffness = " in text
    assert "into geom 'table'" in text or "falls past all geoms" in text


def test_a_body_that_sinks_in_mujoco_is_named():
    (text,) = said_by_fit(PLANE, BALL, "ball", (0.5, 4.0), mujoco_steps=True)
    assert "'ball' sinks" in text


@pytest.mark.parametrize("table", [PLANE, SLAB])
@pytest.mark.parametrize(("shape", "name"), [(BALL, "ball"), (BOX, "cube")])
def test_a_body_that_stays_up_is_not(table, shape, name):
    assert said_by_fit(table, shape, name, (3e3, 1e6)) == []


def test_a_pad_that_gives_way_is_not():
    """1 kg on 400 N/m sinks in by 25 mm, half of its radius."""
    assert said_by_fit(PLANE, BALL, "ball", (300.0, 500.0)) == []


def test_small_corners_of_a_large_body_may_sink_in():
    """Balls of 3 mm at the corners of a cube of 10 cm, 5 to 8 mm deep."""
    corners = "".join(
        f'<geom size=".003" pos="{x} {y} {z}" mass=".1"/>'
        for x in (-0.05, 0.05) for y in (-0.05, 0.05) for z in (-0.05, 0.05)
    )  # fmt: skip
    xml = SCENE.format(table=PLANE, shape=BALL, name="ball", height=0.053)
    ball = xml[xml.index('<geom name="ball"') : xml.index("</body>")]
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml.replace(ball, corners)))
    geoms = list(range(1, 9))
    engine.set_materials(dict.fromkeys(["table", *geoms], dashpot.Material(600.0)))
    soft = Parameter.material(geoms, "stiffness", start=600.0, bounds=(400.0, 900.0))
    problem = Problem(engine, [soft], [at_rest(engine.model)], 1e-3, 1e-2)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        fit(problem, starts=0, max_evaluations=20)


def test_a_body_that_was_seen_to_fall_is_not():
    """It begins beside the slab, and falls past it as recorded."""
    xml = SCENE.format(table=SLAB, shape=BALL, name="ball", height=0.05)
    model = mujoco.MjModel.from_xml_string(xml)
    model.qpos0[0] = 2.0
    engine = dashpot.Engine(model)
    engine.set_pair_material("table", "ball", dashpot.Material(1e4))
    data = engine.make_data()
    seen = at_rest(engine.model)
    fall = np.array(seen.position[:, 0])
    fall[:, 2] -= 0.5 * 9.81 * seen.time**2
    falling = Trajectory(
        "fall", seen.time, fall, seen.quaternion[:, 0], "body",
        initial_qpos=data.qpos, initial_qvel=data.qvel,
    )  # fmt: skip
    stiff = Parameter.pair("table", "ball", "stiffness", start=1e4, bounds=(1e3, 1e5))
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        fit(Problem(engine, [stiff], [falling], 1e-3, 1e-2), starts=0, max_evaluations=20)
