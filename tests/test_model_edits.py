"""Edits of the engine's model between steps."""

import mujoco
import numpy as np
import pytest

from dashpot import Engine

SCENE = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
  <body pos="0 0 .1"><freejoint/><geom name="ball" size=".1"/></body></worldbody>
<contact><pair name="rolls" geom1="floor" geom2="ball"/></contact></mujoco>"""


@pytest.mark.parametrize(
    ("field", "named"), [("geom_condim", "geom_condim of 'ball'"), ("pair_dim", "pair_dim of 'rol")]
)
@pytest.mark.parametrize("condim", [0, 2, 7, 1000])
def test_a_condim_that_is_none_names_what_has_it(field, named, condim):
    engine = Engine(mujoco.MjModel.from_xml_string(SCENE))
    data = engine.make_data()
    engine.step(data)
    getattr(engine.model, field)[-1] = condim
    before = data.qpos.copy()
    with pytest.raises(ValueError, match=f"model.{named}.* is {condim}; it must be 1, 3, 4 or 6"):
        engine.step(data)
    assert np.array_equal(data.qpos, before)
    with pytest.raises(ValueError, match=named):
        Engine(engine.model)


@pytest.mark.parametrize("flag", ["fwdinv", "diagexact"])
def test_flags_of_mujocos_own_solver_are_listed(flag):
    model = mujoco.MjModel.from_xml_string(SCENE)
    assert flag not in str(Engine(model).report())
    model.opt.enableflags = int(getattr(mujoco.mjtEnableBit, f"mjENBL_{flag.upper()}"))
    engine = Engine(model)
    assert [f.treatment for f in engine.report().features if f.name == f"flag {flag}"] == ["mapped"]
    data = engine.make_data()
    engine.step(data)
    assert data.solver_fwdinv.tolist() == [0.0, 0.0]
