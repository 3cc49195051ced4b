"""robosuite's environments step with dashpot and stay what they are otherwise."""

import sys
from types import ModuleType, SimpleNamespace

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot import Engine, Material
from dashpot.robosuite import with_dashpot

BALL = """
<mujoco><size nuserdata='2'/><option timestep='.002'/><worldbody>
  <geom name='floor' type='plane' size='1 1 1'/>
  <body name='ball' pos='0 0 {height}'><freejoint/><geom name='ball' size='.1' mass='1'/></body>
  <body pos='1 0 1'><joint name='push' type='slide' axis='1 0 0'/><geom size='.1' mass='1'/></body>
</worldbody>
<actuator><motor joint='push' ctrllimited='true' ctrlrange='-9 9'/></actuator></mujoco>"""


class Model:
    """What is used of robosuite's MjModel, which keeps MuJoCo's."""

    def __init__(self, model):
        self._model = model

    def joint_name2id(self, name):
        return self._model.joint(name).id

    def __getattr__(self, name):
        return getattr(self._model, name)


class Data:
    """What is used of robosuite's MjData."""

    def __init__(self, model):
        self._data = mujoco.MjData(model._model)

    def __getattr__(self, name):
        return getattr(self._data, name)


class Sim:
    """What is used of robosuite's MjSim."""

    def __init__(self, model):
        self.model = Model(model)
        self.data = Data(self.model)

    def reset(self):
        mujoco.mj_resetData(self.model._model, self.data._data)

    def forward(self):
        mujoco.mj_forward(self.model._model, self.data._data)

    def step(self, with_udd=True):
        mujoco.mj_step(self.model._model, self.data._data)

    def step1(self):
        mujoco.mj_step1(self.model._model, self.data._data)

    def step2(self):
        mujoco.mj_step2(self.model._model, self.data._data)

    def get_state(self):
        return SimpleNamespace(qpos=self.data.qpos.copy(), qvel=self.data.qvel.copy())

    def set_state(self, value):
        self.data.qpos[:], self.data.qvel[:] = value.qpos, value.qvel

    def set_state_from_flattened(self, value):
        nq = self.model.nq
        self.data.qpos[:], self.data.qvel[:] = value[1 : 1 + nq], value[1 + nq :]


class Lab:
    """What is used of robosuite's MujocoEnv; a servo keeps what slides at 0.3 m/s."""

    def __init__(self, *, height=0.1, lite_physics=True, hard_reset=True):
        self.height, self.lite_physics, self.hard_reset = height, lite_physics, hard_reset
        self._initialize_sim()
        self.reset()

    def _initialize_sim(self, xml_string=None):
        xml = xml_string or BALL.format(height=self.height)
        self.sim = Sim(mujoco.MjModel.from_xml_string(xml))
        self.sim.data.userdata[:] = 3.0, 4.0
        self.sim.forward()

    def reset(self):
        if self.hard_reset:
            self._initialize_sim()
        else:
            self.sim.reset()
        self.sim.forward()
        self.seen = []

    def step(self, action, substeps=10):
        for _ in range(substeps):
            self.sim.step1() if self.lite_physics else self.sim.forward()
            self.seen.append(float(self.sim.data.xpos[2, 0]))
            self.sim.data.ctrl[0] = action - 20.0 * self.sim.data.qvel[6]
            self.sim.step2() if self.lite_physics else self.sim.step()


@pytest.mark.parametrize("lite_physics", [False, True])
def test_what_touches_nothing_moves_as_with_mujoco_and_controllers_see_each_step(lite_physics):
    ours = with_dashpot(Lab)(lite_physics=lite_physics, height=0.5)
    theirs = Lab(lite_physics=lite_physics, height=0.5)
    for lab in (ours, theirs):  # without contacts MuJoCo integrates
        lab.sim.model._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        lab.step(6.0, substeps=100)
    assert np.array_equal(ours.sim.data.qpos[7:], theirs.sim.data.qpos[7:])
    assert ours.seen == theirs.seen
    assert ours.sim.data.qvel[6] == pytest.approx(0.3, rel=0.05)  # after four time constants


@pytest.mark.parametrize("lite_physics", [False, True])
def test_ball_rests_with_its_weight_on_what_is_rigid(lite_physics):
    lab = with_dashpot(Lab)(lite_physics=lite_physics)
    lab.step(0.0, substeps=500)
    # mj_step lets it sag 0.1 mm and more, dashpot's rigid contact by less than a micrometre.
    assert lab.sim.data.qpos[2] == pytest.approx(0.1, abs=1e-6)
    assert lab.dashpot_engine.contacts(lab.sim.data._data).force[0, 0] == pytest.approx(9.81, 1e-6)


@pytest.mark.parametrize("hard_reset", [False, True])
def test_resets_begin_anew(hard_reset):
    lab = with_dashpot(Lab)(hard_reset=hard_reset)
    ends = []
    for _ in range(2):
        lab.reset()
        assert lab.sim.model._model is lab.dashpot_engine.model
        lab.sim.data.qvel[0] = 1.0
        lab.step(1.0, substeps=50)
        ends.append(lab.sim.data.qpos.copy())
    assert np.array_equal(*ends)
    assert ends[0][0] > 0.05


def soft_engine(model):
    engine = Engine(model)
    engine.set_material("ball", Material(stiffness=1e4, damping_ratio=0.1, friction=0.5))
    return engine


def test_states_keep_springs_that_are_compressed_and_friction_that_sticks():
    lab = with_dashpot(Lab, make_engine=soft_engine)(height=0.2)
    lab.sim.data.qvel[0] = 0.5
    while lab.sim.data.qpos[2] > 0.0995:
        lab.step(0.0, substeps=1)
    state, flat = lab.sim.get_state(), lab.sim.data.qpos.copy()
    lab.step(0.0, substeps=30)
    expected = lab.sim.data.qpos.copy()
    assert np.abs(expected - flat).max() > 1e-3
    lab.sim.set_state(state)
    lab.sim.forward()
    lab.step(0.0, substeps=30)
    assert np.array_equal(lab.sim.data.qpos, expected)
    assert list(lab.sim.data.userdata[:2]) == [3.0, 4.0]


def test_flattened_states_begin_as_data_just_made():
    pressed = with_dashpot(Lab, make_engine=soft_engine)(height=0.0995)
    flat = np.concatenate([[0.0], pressed.sim.data.qpos, pressed.sim.data.qvel])
    flying = with_dashpot(Lab, make_engine=soft_engine)(height=0.3)
    flying.step(0.0, substeps=5)
    flying.sim.set_state_from_flattened(flat)
    flying.sim.forward()
    for lab in (pressed, flying):
        lab.step(0.0, substeps=5)
    assert np.array_equal(flying.sim.data.qpos, pressed.sim.data.qpos)
    # The spring, compressed by the overlap, is an oscillator of 100 rad/s that is damped by 0.1.
    turn = 100.0 * 0.01 * np.sqrt(1.0 - 0.1**2)
    swing = np.exp(-0.1) * (np.cos(turn) + 0.1 / np.sqrt(1.0 - 0.1**2) * np.sin(turn))
    sinking = (9.81 / 1e4 - 0.0005) * (1.0 - swing)
    assert 0.0995 - flying.sim.data.qpos[2] == pytest.approx(sinking, rel=1e-6)


def test_engine_is_the_one_that_is_asked_for():
    lab = with_dashpot(Lab, make_engine=soft_engine)()
    assert len(lab.dashpot_engine.materials) == 1
    assert lab.sim.data.userdata.size == lab.dashpot_engine.model.nuserdata
    assert list(lab.sim.data.userdata[:2]) == [3.0, 4.0]
    assert type(lab).__name__ == "LabWithDashpot"
    assert isinstance(lab, Lab)
    assert isinstance(lab.sim, Sim)


@pytest.mark.parametrize("bad", [dict, Lab.reset, 3])
def test_what_is_no_class_of_environments_is_refused(bad):
    with pytest.raises(TypeError, match="env_class is"):
        with_dashpot(bad)


def test_what_makes_no_engine_is_refused():
    with pytest.raises(TypeError, match=r"make_engine returned MjModel; it must be Engine"):
        with_dashpot(Lab, make_engine=lambda model: model)()


def test_names_are_those_that_robosuite_knows(monkeypatch):
    environments = ModuleType("robosuite.environments")
    environments.REGISTERED_ENVS = {"Lab": Lab}
    monkeypatch.setitem(sys.modules, "robosuite", ModuleType("robosuite"))
    monkeypatch.setitem(sys.modules, "robosuite.environments", environments)
    assert issubclass(with_dashpot("Lab"), Lab)
    with pytest.raises(ValueError, match="env_class is 'Lob'; robosuite knows Lab"):
        with_dashpot("Lob")


def test_calls_of_older_mujoco_give_inertia_and_addresses(monkeypatch):
    bindings, controllers = ModuleType("bindings"), ModuleType("controllers")
    bindings.MjModel, bindings.MjData = type("MjModel", (Model,), {}), type("MjData", (Data,), {})
    controllers.mujoco = mujoco
    monkeypatch.setitem(sys.modules, "robosuite.utils.binding_utils", bindings)
    monkeypatch.setitem(sys.modules, "robosuite.controllers.parts.controller", controllers)
    with_dashpot(Lab)
    model = bindings.MjModel(
        mujoco.MjModel.from_xml_string(
            "<mujoco><worldbody><body><freejoint name='free'/><geom size='.1' mass='2'/>"
            "<body><joint name='ball' type='ball'/><geom size='.1' mass='1'/></body>"
            "<body><joint name='hinge'/><geom size='.1' mass='1'/></body></body>"
            "</worldbody></mujoco>"
        )
    )
    assert model.get_joint_qpos_addr("free") == (0, 7)
    assert model.get_joint_qpos_addr("ball") == (7, 11)
    assert model.get_joint_qpos_addr("hinge") == 11
    assert model.get_joint_qvel_addr("free") == (0, 6)
    assert model.get_joint_qvel_addr("ball") == (6, 9)
    assert model.get_joint_qvel_addr("hinge") == 9
    data = bindings.MjData(model)
    mujoco.mj_forward(model._model, data._data)
    inertia = np.zeros((2, 10, 10))
    controllers.mujoco.mj_fullM(model._model, inertia[0], data.qM)  # as before 3.10
    controllers.mujoco.mj_fullM(model._model, data._data, inertia[1])
    assert inertia[0, 0, 0] == pytest.approx(4.0)
    assert np.array_equal(*inertia)
    assert controllers.mujoco.mjtObj is mujoco.mjtObj


def test_package_offers_it():
    assert dashpot.robosuite.with_dashpot is with_dashpot


def test_a_panda_lifts_what_it_grasps():
    robosuite = pytest.importorskip("robosuite")
    with_dashpot("Lift")
    env = robosuite.make(
        "LiftWithDashpot",
        robots="Panda",
        has_offscreen_renderer=False,
        use_camera_obs=False,
        seed=0,
    )
    observed = env.reset()
    held = []
    for step in range(70):
        rise = 0.0 if step < 40 else 0.1
        action = np.zeros(7)
        to_target = observed["cube_pos"] + [0.0, 0.0, rise] - observed["robot0_eef_pos"]
        action[:3] = np.clip(10.0 * to_target, -1.0, 1.0)
        action[6] = -1.0 if step < 30 else 1.0
        observed, *_ = env.step(action)
        held.append(env.sim.data.site_xpos[env.robots[0].eef_site_id["right"], 2])
        held[-1] -= env.sim.data.body_xpos[env.cube_body_id, 2]
    assert env._check_success()
    # Nothing creeps that sticks; the cube turns a little between the fingers as the arm swings.
    assert np.ptp(held[45:]) < 5e-4
