"""MyoSuite's environments step with dashpot and stay what they are otherwise."""

import sys
from types import ModuleType, SimpleNamespace

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot import Engine, Material
from dashpot.myosuite import with_dashpot

# A muscle bends an arm; a ball falls on a plate that feels it.
ARM = """
<mujoco><option timestep='.002'/><worldbody>
  <geom name='floor' type='plane' size='1 1 1'/><site name='plate' type='box' size='1 1 .01'/>
  <body pos='0 0 .1'><freejoint/><geom name='ball' size='.1' mass='1'/></body>
  <body pos='1 0 1'><joint name='bend' axis='0 1 0' damping='.1'/><geom size='.05' pos='.2 0 0'
    mass='1'/><site name='end' pos='.1 0 .01'/></body><site name='fixed' pos='.9 0 1.1'/>
</worldbody>
<tendon><spatial name='tendon'><site site='fixed'/><site site='end'/></spatial></tendon>
<actuator><muscle name='muscle' tendon='tendon' lengthrange='.05 .3'/></actuator>
<sensor><touch site='plate'/><actuatorfrc actuator='muscle'/></sensor></mujoco>"""


class Arm:
    """What is used of MyoSuite's MyoGymnasiumEnv."""

    frame_skip = 5

    def __init__(self, scenes=1):
        self.scenes = []
        for _ in range(scenes):
            model = mujoco.MjModel.from_xml_string(ARM)
            self.scenes.append((model, mujoco.MjData(model)))
        self.reset(0)

    def reset(self, scene=None):
        if scene is not None:  # as its modular environments do
            self.model, self.data = self.scenes[scene]
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_forward(self.model, self.data)
        self.accessor = SimpleNamespace(model=self.model, data=self.data)

    def _step_physics(self, nstep=None):
        mujoco.mj_step(self.model, self.data, self.frame_skip if nstep is None else nstep)
        mujoco.mj_forward(self.model, self.data)

    def step(self, action):
        self.data.ctrl[:] = action
        self._step_physics()
        data = self.accessor.data
        return np.concatenate([data.qpos[7:], data.qvel[6:], data.act, data.actuator_force])


def test_a_muscle_bends_an_arm_that_touches_nothing_as_in_myosuite_bit_for_bit():
    """Without contacts, so that MuJoCo integrates."""
    ours, theirs = with_dashpot(Arm)(), Arm()
    for arm in (ours, theirs):
        arm.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    observed = np.array([[arm.step(0.5) for _ in range(40)] for arm in (ours, theirs)])
    assert np.array_equal(*observed)
    assert np.ptp(observed[0, :, 0]) > 0.1
    assert np.array_equal(ours.data.actuator_length, theirs.data.actuator_length)
    assert np.array_equal(ours.data.xpos[2:], theirs.data.xpos[2:])


def test_touch_is_that_of_the_contacts_that_carry():
    arm = with_dashpot(Arm)()
    for _ in range(100):
        arm.step(0.0)
    assert arm.data.sensordata[0] == pytest.approx(9.81, rel=1e-6)
    assert arm.data.qpos[2] == pytest.approx(0.1, abs=1e-6)


def test_another_model_has_another_engine():
    arm = with_dashpot(Arm)(scenes=2)
    first = arm.dashpot_engine
    arm.step(0.5)
    assert arm.dashpot_engine is first
    arm.reset(1)
    arm.step(0.5)
    assert arm.dashpot_engine is not first
    for holder in (arm, arm.accessor):
        assert holder.model is arm.dashpot_engine.model
        assert holder.data is arm.data
    assert arm.data.time == pytest.approx(0.01)


def test_engine_is_the_one_that_is_asked_for():
    def make_engine(model):
        engine = Engine(model)
        engine.set_material("floor", Material(stiffness=1e4, damping_ratio=1.0))
        return engine

    arm = with_dashpot(Arm, make_engine=make_engine)()
    assert len(arm.dashpot_engine.materials) == 1
    assert type(arm).__name__ == "ArmWithDashpot"
    assert isinstance(arm, Arm)
    with pytest.raises(TypeError, match=r"make_engine returned MjModel; it must be Engine"):
        with_dashpot(Arm, make_engine=lambda model: model)()


@pytest.mark.parametrize("bad", [dict, Arm.reset, "arm"])
def test_what_is_no_class_of_environments_is_refused(bad):
    with pytest.raises(TypeError, match="env_class is"):
        with_dashpot(bad)


def test_ids_make_environments_with_their_wrappers(monkeypatch):
    gymnasium = pytest.importorskip("gymnasium")

    class Bending(Arm, gymnasium.Env):
        action_space = gymnasium.spaces.Box(0.0, 1.0, (1,))
        observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (4,), dtype=np.float64)

        def reset(self, scene=None, *, seed=None, options=None):
            super().reset(scene)
            return np.zeros(4), {}

        def step(self, action):
            return super().step(action), 0.0, False, False, {}

    monkeypatch.setattr(gymnasium.envs.registration, "registry", {})
    gymnasium.register("Bending-v0", entry_point=Bending, max_episode_steps=3)
    monkeypatch.setitem(sys.modules, "myosuite", ModuleType("myosuite"))
    env = dashpot.myosuite.make("Bending-v0", disable_env_checker=True)
    env.reset(seed=0)
    assert [env.step(np.array([0.5]))[3] for _ in range(3)] == [False, False, True]
    assert isinstance(env.unwrapped.dashpot_engine, Engine)
    assert gymnasium.spec("Bending-v0").entry_point is Bending


def test_a_hand_of_muscles_twirls_a_pen():
    pytest.importorskip("myosuite")
    env = dashpot.myosuite.make("myoHandPenTwirlFixed-v0")
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(20):
        observation, *_ = env.step(rng.uniform(env.action_space.low, env.action_space.high))
        assert np.isfinite(observation).all()
    assert env.unwrapped.data.userdata.size == env.unwrapped.dashpot_engine.model.nuserdata
