"""Contacts of a step, chosen by geom, body and pair."""

from __future__ import annotations

import copy

import mujoco
import numpy as np
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


@pytest.mark.parametrize("sensors", [True, False])
def test_data_hold_contacts_that_touch_not_those_that_detection_sees_ahead(sensors):
    """A ball and a box on a rail pass half a millimetre above the floor; a third rests on it."""
    read = """<sensor><contact geom1="flies" data="found"/><contact geom1="slides" data="found"/>
      <contact geom1="rests" data="found force"/></sensor>"""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="0.002"/><worldbody>
      <geom name="floor" type="plane" size="5 5 .1"/>
      <body pos="0 0 .1005" gravcomp="1"><freejoint/><geom name="flies" size=".1"/></body>
      <body pos="0 1 .0505"><joint type="slide" axis="1 0 0"/><joint axis="0 0 1"/>
        <geom name="slides" type="box" size=".05 .05 .05"/></body>
      <body pos="0 2 .1"><freejoint/><geom name="rests" size=".1" mass="1"/></body>
    </worldbody>{read * sensors}</mujoco>""")
    engine = dashpot.Engine(model)
    data, theirs = engine.make_data(), mujoco.MjData(model)
    for start in (data, theirs):
        start.qvel[[0, 3, 6]] = 3.0, 5.0, 1.0
    for _ in range(50):
        stats = engine.step(data)
        mujoco.mj_step(model, theirs)
    assert stats.contacts > 1
    assert data.ncon == theirs.ncon == 1
    rests = model.geom("rests").id
    assert data.contact.geom.tolist() == engine.contacts(data).geom.tolist() == [[0, rests]]
    assert engine.contacts(data).force[0, 0] == pytest.approx(9.81, rel=1e-6)
    # What names a row's contact finds it, and rows of all others bear nothing.
    rows = data.contact.efc_address
    force = np.zeros(6)
    mujoco.mj_contactForce(engine.model, data, 0, force)
    assert force[0] == pytest.approx(9.81, rel=1e-6)
    assert data.efc_id[rows[0]] == 0
    assert data.efc_force[: rows[0]].tolist() == [0.0] * rows[0]
    left_out = data.efc_id >= data.ncon
    assert left_out.any()
    frictionless = mujoco.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS
    assert (data.efc_type[left_out] == frictionless).all()
    # What goes on from the rows of a copy does not look for contacts that it does not have.
    mujoco.mj_forwardSkip(model, copy.copy(data), mujoco.mjtStage.mjSTAGE_POS, True)
    if sensors:
        assert data.sensordata[:3].tolist() == theirs.sensordata[:3].tolist() == [0.0, 0.0, 1.0]
        assert data.sensordata[3] == pytest.approx(9.81, rel=1e-6)


def test_contacts_are_chosen_and_gone_through_one_by_one():
    """A box on its four corners: each bears a quarter of the weight."""
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="plane" size="1 1 .1"/><body pos="0 0 .1"><freejoint/>'
        '<geom type="box" size=".1 .1 .1" mass="4"/></body></worldbody></mujoco>'
    )
    engine = dashpot.Engine(model)
    data = engine.make_data()
    engine.step(data, 200)
    contacts = engine.contacts(data)
    each = [contact.force[0] for contact in contacts]
    assert each == pytest.approx([9.81] * 4, rel=1e-6)
    for chosen in ([0, 2], np.array([0, 2]), [True, False, True, False], slice(0, 3, 2)):
        np.testing.assert_array_equal(contacts[chosen].position, contacts.position[[0, 2]])
    with pytest.raises(TypeError, match="single contact"):
        list(contacts[0])
