"""Contacts of a step, chosen by geom, body and pair."""

from __future__ import annotations

import mujoco
import pytest

import dashpot


def test_contacts_filtered_by_geom_body_and_pair():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
        <body name="low" pos="0 0 .05"><freejoint/><geom name="low" type="box" size=".1 .1 .05"/>
        </body>
        <body name="high" pos="0 0 .15"><freejoint/><geom name="high" type="box" size=".1 .1 .05"/>
        </body></worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    data = engine.make_data()
    engine.step(data, nstep=50)
    everything = engine.contacts(data)
    assert len(everything) == 8
    assert len(engine.contacts(data, geom="floor")) == 4
    assert len(engine.contacts(data, geom="low")) == 8
    assert len(engine.contacts(data, body="high")) == 4
    assert len(engine.contacts(data, body="low", geom="floor")) == 4
    assert len(engine.contacts(data, pair=("floor", "high"))) == 0
    between = engine.contacts(data, pair=("high", "low"))
    names = [{model.geom(g).name for g in pair} for pair in between.geom]
    assert names == [{"low", "high"}] * 4
    # Each interface carries the weight above it; statics settle to far better than 1e-3.
    weight = model.body_mass[2] * 9.81
    assert between.force[:, 0].sum() == pytest.approx(weight, rel=1e-3)
    assert engine.contacts(data, geom="floor").force[:, 0].sum() == pytest.approx(
        2 * weight, rel=1e-3
    )
    singles = list(between)
    assert sum(contact.force[0] for contact in singles) == pytest.approx(weight, rel=1e-3)
    assert between[0].position.shape == (3,)
    with pytest.raises(TypeError, match="single contact"):
        len(between[0])
    for bad in ({"geom": "flor"}, {"body": "mid"}, {"pair": ("low", "low")}, {"pair": ("low",)}):
        with pytest.raises(ValueError, match=r"did you mean|no body|same geom|two geoms"):
            engine.contacts(data, **bad)
