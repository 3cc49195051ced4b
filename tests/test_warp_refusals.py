"""What dashpot.warp has not is refused by name; its own names and MuJoCo Warp's are there."""

import subprocess
import sys

import mujoco_warp
import pytest

import dashpot
from scene import free_body, mjcf
from warp_worlds import dw, model_of

BODY = free_body("b", 'type="box" size=".1 .1 .1"', (0, 0, 1))
FLEX = (
    '<mujoco><worldbody><flexcomp name="f" type="grid" count="3 3 1" spacing=".1 .1 .1" dim="2" '
    'mass="1" radius="0.01"/></worldbody></mujoco>'
)
ROPE = mjcf(
    '<body mocap="true"><site name="a"/></body>'
    + BODY.replace("</body>", '<site name="b"/></body>'),
    rest='<tendon><spatial limited="true" range="0 2"><site site="a"/><site site="b"/></spatial>'
    "</tendon>",
)


@pytest.mark.parametrize(
    ("xml", "name"),
    [
        (FLEX, "flexes"),
        (ROPE, "tendons that go to mocap bodies"),
        (mjcf(BODY, option='integrator="RK4"'), "integrator 'RK4'"),
        (mjcf(BODY, option='integrator="discrete"'), "integrator 'discrete'"),
        (mjcf(BODY, option='><flag sleep="enable"/></option><option'), "the flag 'sleep'"),
    ],
)
def test_a_model_with_what_is_missing_is_refused_by_name(xml, name):
    with pytest.raises(NotImplementedError, match=name):
        dw.put_model(model_of(xml))


@pytest.mark.parametrize(
    ("options", "error", "name"),
    [
        ({"law": "newton"}, ValueError, "law must be"),
        ({"law": "comfree"}, NotImplementedError, "integrator 'implicit' with law='comfree'"),
        ({"microsteps": 65}, ValueError, "microsteps must be"),
        ({"recovery_speed": -1.0}, ValueError, "recovery_speed must be"),
        (
            {"materials": {"b": dashpot.Material(loaded_friction=0.5)}},
            NotImplementedError,
            "loaded_friction of the material of geom 'b'",
        ),
        (
            {"pair_materials": {("b", "floor"): dashpot.Material(friction=0.5)}},
            NotImplementedError,
            "friction of the material of the pair",
        ),
    ],
)
def test_options_that_cannot_be_are_refused(options, error, name):
    with pytest.raises(error, match=name):
        dw.put_model(model_of(mjcf(BODY, option='integrator="implicit"')), **options)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("impact", "cut"),
        ("max_microsteps", 128),
        ("rules", dashpot.CombinationRules(friction="min")),
    ],
)
def test_options_of_an_engine_that_warp_has_not_are_refused(name, value):
    engine = dashpot.Engine(model_of(mjcf(BODY)), **{name: value})
    with pytest.raises(NotImplementedError, match=f"has no {name}"):
        engine.to_warp()


def test_models_and_data_are_mujoco_warps():
    model = model_of(mjcf(BODY))
    assert isinstance(dw.put_model(model), mujoco_warp.Model)
    assert isinstance(dw.make_data(model, nworld=2), mujoco_warp.Data)
    assert dw.ray is mujoco_warp.ray


def test_engines_go_to_warp_with_their_materials():
    engine = dashpot.Engine(model_of(mjcf(BODY)), mocap_timeconst=0.1)
    engine.set_material("b", dashpot.Material(1e4))
    m, d = engine.to_warp(nworld=3)
    assert m.dashpot.mocap_timeconst.numpy() == pytest.approx([0.1])
    assert d.nworld == 3
    assert m.dashpot.stiffness.numpy()[0, engine.geom_id("b")] == 1e4


def test_dashpot_alone_does_not_import_warp():
    code = "import sys, dashpot; assert not {'warp', 'mujoco_warp'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
