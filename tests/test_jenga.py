"""A block is pushed out of a tower: what slides by does not shake what rests."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dashpot import Engine

FRICTION, MASS, GRAVITY = 0.4, 0.02, 9.81
LAYERS, WIDE, BETWEEN = 3, 0.025, 1e-4  # m: blocks of a layer lie a tenth of a millimetre apart
SPEED, SETTLED, PUSHED, END = 0.05, 0.3, 0.45, 0.8  # m/s; s


def block(layer: int, place: int) -> str:
    """Return a block of a tower whose layers lie across each other."""
    across, height = (place - 1) * (WIDE + BETWEEN), 0.0075 + 0.015 * layer
    at, size = f"0 {across}", ".0375 .0125 .0075"
    if layer % 2:
        at, size = f"{across} 0", ".0125 .0375 .0075"
    name = f"block{layer}{place}"
    return f"""<body name="{name}" pos="{at} {height}"><freejoint/>
      <geom name="{name}" type="box" size="{size}" mass="{MASS}" friction="{FRICTION}"/></body>"""


TOWER = f"""<mujoco><option integrator="implicitfast"/><worldbody>
  <geom type="plane" size="1 1 .1" friction="{FRICTION}"/>
  {"".join(block(layer, place) for layer in range(LAYERS) for place in range(3))}
  <body pos="-.0581 0 .0075" gravcomp="1"><joint name="rod" type="slide" axis="1 0 0"/>
    <geom name="rod" type="capsule" size=".004" fromto="-.05 0 0 .0155 0 0" mass=".02"/></body>
</worldbody><actuator><position joint="rod" kp="2000" kv="40"/></actuator></mujoco>"""


@pytest.mark.parametrize("timestep", [0.0005, 0.001, 0.002])
def test_a_block_is_pushed_out_of_a_quiet_tower(timestep) -> None:
    """Its sides came within reach of others and left it, and stiffness changed with that.

    The tower above hopped, at 2 mm/s, and the rod pushed with 0.27 +- 0.14 N. A third of what lies
    above presses on the block, and with its own weight on the floor. The bound on the speed is a
    hundredth of what weight gives in 0.5 ms.
    """
    engine = Engine(mujoco.MjModel.from_xml_string(TOWER))
    engine.model.opt.timestep = timestep
    data = engine.make_data()
    rod, above = engine.model.geom("rod").id, engine.model.body("block11").dofadr[0] + 2
    forces, speeds = [], []
    for _ in range(round(END / timestep)):
        data.ctrl[0] = max(0.0, SPEED * (data.time - SETTLED))
        engine.step(data)
        if data.time < PUSHED:
            continue
        contacts = engine.contacts(data)
        forces.append(contacts.force[(contacts.geom == rod).any(axis=1), 0].sum())
        speeds.append(data.qvel[above])
    pressing = (LAYERS - 1) * MASS * GRAVITY
    expected = FRICTION * (pressing + pressing + MASS * GRAVITY)
    # The block moves on from under what presses on its end: the share changes by 2 % on the way.
    assert np.mean(forces) == pytest.approx(expected, rel=0.02)
    assert np.std(forces) < 0.02 * expected
    assert np.sqrt(np.mean(np.square(speeds))) < 5e-5
