"""Scenes large enough for threads to share every pass of a step, and all that a step leaves."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import mujoco
import numpy as np

from dashpot import Engine, Material
from piles import random_quat, walls
from query_geoms import hull_mesh, hull_points
from scene import free_body

SHAPES = (
    'type="sphere" size=".04"',
    'type="box" size=".05 .03 .04"',
    'type="capsule" size=".025 .03"',
    'type="cylinder" size=".035 .04"',
    'type="ellipsoid" size=".05 .035 .03"',
    'type="mesh" mesh="hull"',
    'type="box" size=".04 .04 .03"',
)
Start = tuple[Engine, mujoco.MjData]
STATE = mujoco.mjtState.mjSTATE_INTEGRATION
SPACING = 0.1  # m
FLOOR = '<geom name="floor" type="plane" size="0 0 1"/>'
HILLS = '<geom name="floor" type="hfield" hfield="hills"/>'
HEIGHTS = " ".join(str((3 * i % 7 + 5 * j % 6) / 11) for i in range(16) for j in range(16))
ASSETS = f"""<asset>{hull_mesh(hull_points(24, (0.05, 0.04, 0.03)))}
  <hfield name="hills" nrow="16" ncol="16" size=".45 .45 .06 .1" elevation="{HEIGHTS}"/></asset>"""


def pile(count: int, shapes: tuple[str, ...] = SHAPES, *, height: float = 0.06) -> str:
    """Return bodies close above each other in a bin, some in random attitudes, with touch sites."""
    rng = np.random.default_rng(count)
    bodies = []
    for i in range(count):
        layer, place = divmod(i, 36)
        x, y = (np.array(divmod(place, 6)) - 2.5) * SPACING + rng.uniform(-0.01, 0.01, 2)
        quat = random_quat(rng) if i % 3 == 0 else None
        geom = f'{shapes[i % len(shapes)]} density="1000"/><site name="skin{i}" size=".1"'
        position = (x, y, height + 0.085 * layer)
        bodies.append(free_body(f"body{i}", geom, position, quat=quat))
    return walls(3.2 * SPACING, 0.2 + count / 300) + "".join(bodies)


def scene(
    bodies: str, *, ground: str = FLOOR, rest: str = "", geoms: str = "", memory: str = "64M"
) -> mujoco.MjModel:
    """Compile bodies on a ground, and two touch sensors, for which contacts have rows."""
    return mujoco.MjModel.from_xml_string(f"""
<mujoco><option timestep=".004"/><size memory="{memory}"/><default><geom {geoms}/></default>{ASSETS}
<worldbody>{ground}{bodies}</worldbody>{rest}
<sensor><touch site="skin0"/><touch site="skin7"/></sensor></mujoco>""")


def at_rest(engine: Engine) -> Start:
    return engine, engine.make_data()


def bin_of_all_shapes(nthread: int) -> Start:
    return at_rest(Engine(scene(pile(252)), nthread=nthread))


def bin_with_rolling_friction(nthread: int) -> Start:
    return at_rest(Engine(scene(pile(216), geoms='condim="6"'), nthread=nthread))


def bin_of_materials(nthread: int) -> Start:
    engine = Engine(scene(pile(216)), nthread=nthread)
    for i in range(0, 216, 2):
        engine.set_material(f"body{i}", Material(10.0 ** (4 + i % 3), restitution=0.1 * (i % 8)))
    for i in range(0, 180, 3):
        rubber = Material(2e4, damping_ratio=0.3, friction=1.5)
        engine.set_pair_material(f"body{i}", f"body{i + 36}", rubber)
        engine.set_pair_material(f"body{i}", "floor", Material(friction=0.1))
    return at_rest(engine)


def bin_on_hills(nthread: int) -> Start:
    return at_rest(Engine(scene(pile(180, height=0.15), ground=HILLS), nthread=nthread))


def brick_wall(nthread: int) -> Start:
    """Stack so many bricks that their one island goes into four slices."""
    bricks = ""
    for i in range(240):
        row, place = divmod(i, 40)
        position = (0.1 * place + 0.05 * (row % 2), 0.0, 0.03 + 0.06 * row)
        bricks += free_body(
            f"body{i}", f'type="box" size=".05 .04 .03"/><site name="skin{i}" size=".1"', position
        )
    return at_rest(Engine(scene(bricks), nthread=nthread))


def loop_on_a_bin(nthread: int) -> Start:
    """Drop a ring of capsules on the pile, held end to end by connects and a weld."""
    count, links, joined = 30, "", '<weld body1="link0" body2="link1"/>'
    for i in range(count):
        x, y = (0.3 * f(2 * np.pi * i / count) for f in (np.cos, np.sin))
        links += f"""<body name="link{i}" pos="{x} {y} .45" euler="0 0 {360 * i / count}">
          <freejoint/><geom type="capsule" fromto="0 -.03 0 0 .03 0" size=".012"/></body>"""
        after = (i + 1) % count
        joined += f'<connect body1="link{i}" body2="link{after}" anchor="0 .0314 0"/>'
    apart = "".join(
        f'<exclude body1="link{i}" body2="link{(i + 1) % count}"/>' for i in range(count)
    )
    rest = f"<equality>{joined}</equality><contact>{apart}</contact>"
    return at_rest(Engine(scene(pile(180) + links, rest=rest), nthread=nthread))


def arms_in_a_bin(nthread: int) -> Start:
    """Drop boxes and hulls on arms with servos, limits and dry friction."""
    arms, servos = "", ""
    for i in range(16):
        x, y = (np.array(divmod(i, 4)) - 1.5) * 0.16
        arms += f'<body pos="{x + 0.05} {y + 0.05} .05">'
        for k, axis in enumerate(("0 0 1", "0 1 0", "1 0 0")):
            arms += f"""<body pos="0 0 {0.08 * (k > 0)}"><joint name="j{i}_{k}" axis="{axis}"
              damping=".02" range="-60 60" frictionloss="{0.01 * (i % 2)}" armature=".001"/>
              <geom type="capsule" fromto="0 0 .02 0 0 .07" size=".014"/>"""
            servos += f'<position joint="j{i}_{k}" kp="4" kv=".1"/>'
        arms += "</body>" * 4
    boxes = tuple(shape for shape in SHAPES if "box" in shape or "mesh" in shape)
    falling = pile(180, boxes, height=0.4)
    return at_rest(
        Engine(scene(arms + falling, rest=f"<actuator>{servos}</actuator>"), nthread=nthread)
    )


def robots_apart(nthread: int) -> Start:
    """Drop things on arms that do not reach each other, some of them closed to loops."""
    arms, servos, loops = "", "", ""
    for i in range(48):
        x, y = 0.6 * np.array(divmod(i, 8))
        arms += f"""<body name="foot{i}" pos="{x} {y} .1"><joint name="a{i}" axis="0 1 0"
          range="-30 30" damping=".02" frictionloss="{0.01 * (i % 2)}" armature=".001"/>
          <geom type="capsule" fromto="-.1 0 0 .1 0 0" size=".03"/>
          <body name="top{i}" pos=".1 0 .05"><joint name="b{i}" axis="0 1 0" damping=".01"/>
          <geom type="box" size=".06 .06 .01"/></body></body>"""
        arms += free_body(
            f"body{2 * i}",
            SHAPES[i % 7] + f'/><site name="skin{2 * i}" size=".1"',
            (x + 0.08, y, 0.24),
        )
        arms += free_body(
            f"body{2 * i + 1}",
            SHAPES[(i + 3) % 7] + f'/><site name="skin{2 * i + 1}" size=".1"',
            (x - 0.08, y, 0.24),
        )
        servos += f'<position joint="a{i}" kp="4" kv=".1"/>'
        if i % 3 == 0:
            loops += f'<connect body1="top{i}" body2="foot{i}" anchor=".05 0 0"/>'
    rest = f"<actuator>{servos}</actuator><equality>{loops}</equality>"
    return at_rest(Engine(scene(arms, rest=rest), nthread=nthread))


def stored(engine: Engine, data: mujoco.MjData) -> np.ndarray:
    found = np.empty(mujoco.mj_stateSize(engine.model, STATE))
    mujoco.mj_getState(engine.model, data, found, STATE)
    return found


@functools.cache
def settled_bin() -> np.ndarray:
    """Return the state of a bin some time after its bodies fell in."""
    engine, data = at_rest(Engine(scene(pile(180))))
    engine.step(data, nstep=200)
    return stored(engine, data)


def settled(model: mujoco.MjModel, nthread: int, **options: Any) -> Start:
    engine, data = at_rest(Engine(model, nthread=nthread, **options))
    mujoco.mj_setState(engine.model, data, settled_bin(), STATE)
    return engine, data


def bin_that_is_shot_at(nthread: int) -> Start:
    engine, data = settled(scene(pile(180)), nthread, impact="cut")
    data.qvel[6 * 175 + 2] = -5.0  # a ball on top
    return engine, data


def state(engine: Engine, data: mujoco.MjData, stats: Any = None) -> dict[str, Any]:
    """Return all that a step leaves behind, bit for bit."""
    names = ("time", "qpos", "qvel", "qacc", "userdata", "sensordata", "qfrc_constraint")
    found: dict[str, Any] = {name: np.array(getattr(data, name)).tobytes() for name in names}
    found["efc_force"] = data.efc_force.tobytes()
    found["warnings"] = [warning.number for warning in data.warning]
    for name in ("dist", "pos", "frame", "geom", "friction", "dim", "mu", "exclude", "efc_address"):
        found[f"contact.{name}"] = np.array(getattr(data.contact, name)).tobytes()
    contacts = engine.contacts(data)
    for field in dataclasses.fields(contacts):
        found[f"contacts.{field.name}"] = getattr(contacts, field.name).tobytes()
    return found | {"energy": repr(engine.energy(data)), "statistics": repr(stats)}
