"""Gymnasium's environments step with dashpot and stay what they are otherwise."""

import pickle
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot import Engine, Material
from dashpot.gymnasium import register, with_dashpot

pytest.importorskip("gymnasium")
pytest.importorskip("imageio")  # gymnasium's renderer needs it

import gymnasium
from gymnasium.envs.mujoco.ant_v5 import AntEnv
from gymnasium.envs.mujoco.hopper_v5 import HopperEnv
from gymnasium.envs.mujoco.inverted_pendulum_v5 import InvertedPendulumEnv
from gymnasium.envs.mujoco.reacher_v5 import ReacherEnv


def play(env, *, steps, seed=0, scale=1.0):
    """Return the observations of an episode with random actions."""
    rng = np.random.default_rng(seed)
    space = env.action_space
    observations = [env.reset(seed=seed)[0]]
    for _ in range(steps):
        observation, *_ = env.step(scale * rng.uniform(space.low, space.high))
        observations.append(observation)
    return np.array(observations)


def without_rows(env):
    """Switch limits and contacts off: where no row is possible, MuJoCo integrates."""
    env.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    return env


def test_pendulum_that_touches_nothing_moves_as_in_gymnasium_bit_for_bit():
    theirs = play(without_rows(InvertedPendulumEnv()), steps=20, scale=0.1)
    ours = play(without_rows(with_dashpot(InvertedPendulumEnv)()), steps=20, scale=0.1)
    assert np.ptp(theirs[:, 1]) > 1e-3
    assert np.array_equal(ours, theirs)


def test_arm_that_touches_nothing_reaches_as_in_gymnasium_bit_for_bit():
    theirs = play(without_rows(ReacherEnv()), steps=50, scale=0.1)
    ours = play(without_rows(with_dashpot(ReacherEnv)()), steps=50, scale=0.1)
    # Joints, the target (drawn in the reset), and joint velocities.
    assert np.array_equal(ours[:, :8], theirs[:, :8])
    # From the finger to the target: poses of bodies are one time step older.
    step_of_finger = 0.01 * 0.2 * np.abs(theirs[:, 6:8]).sum(axis=1).max()
    assert np.abs(ours[:, 8:] - theirs[:, 8:]).max() < step_of_finger


def test_ant_rests_on_its_legs_and_observes_the_forces_that_carry_it():
    env = with_dashpot(AntEnv)()
    env.reset(seed=1)
    for _ in range(100):
        observation, *_ = env.step(np.zeros(8))
    # In v5 contact forces (clipped to +-1) follow positions and velocities, and torso by torso:
    # unclipped they carry the weight.
    weight = 9.81 * mujoco.mj_getTotalmass(env.model)
    assert env.data.cfrc_ext[1:, 5].sum() == pytest.approx(weight, rel=1e-3)
    assert np.abs(observation[27:]).max() == 1.0
    assert env.dashpot_engine.contacts(env.data).gap.min() > -1e-4


def test_hopper_episodes_repeat_after_resets():
    env = with_dashpot(HopperEnv)()
    first = play(env, steps=60)
    assert np.array_equal(play(env, steps=60), first)
    assert not np.array_equal(play(env, steps=60, seed=1), first)


def test_engine_is_the_one_that_is_asked_for():
    def make_engine(model):
        engine = Engine(model, impact="cut")
        engine.set_material("floor", Material(stiffness=1e4, damping_ratio=1.0))
        return engine

    env = with_dashpot(HopperEnv, make_engine=make_engine)(frame_skip=2)
    assert env.frame_skip == 2
    assert env.dashpot_engine.impact == "cut"
    assert env.model is env.dashpot_engine.model
    assert len(env.dashpot_engine.materials) == 1
    assert type(env).__name__ == "HopperEnvWithDashpot"
    assert isinstance(env, HopperEnv)


def test_environments_pickle():
    env = with_dashpot(HopperEnv)()
    other = pickle.loads(pickle.dumps(env))
    assert type(other).__name__ == "HopperEnvWithDashpot"
    assert np.array_equal(play(other, steps=40), play(env, steps=40))


def test_classes_pickle_as_what_they_are_derived_from():
    # As in tables of tasks, which tell a task's environments by their class.
    env_class = with_dashpot(HopperEnv)
    assert pickle.loads(pickle.dumps(env_class)) is env_class
    assert with_dashpot(HopperEnv) is env_class
    assert with_dashpot(AntEnv) is not env_class


class BallRobot:
    """What with_dashpot uses of gymnasium-robotics' MujocoRobotEnv."""

    n_substeps = 10

    def __init__(self):
        self._initialize_simulation()

    def _initialize_simulation(self):
        self.model = mujoco.MjModel.from_xml_string(
            "<mujoco><size nuserdata='2'/><worldbody><geom type='plane' size='1 1 1'/>"
            "<body pos='0 0 .1'><freejoint/><geom size='.1' mass='1'/></body></worldbody></mujoco>"
        )
        self.data = mujoco.MjData(self.model)
        self.data.qpos[0] = 0.25  # as _env_setup does
        self.data.userdata[:] = 3.0, 4.0

    def _mujoco_step(self, action):
        mujoco.mj_step(self.model, self.data, nstep=self.n_substeps)

    def step(self, action):
        self._mujoco_step(action)


def test_robot_environments_keep_what_they_set_up():
    robot = with_dashpot(BallRobot)()
    assert robot.data.qpos[0] == 0.25
    assert list(robot.data.userdata[:2]) == [3.0, 4.0]
    robot.step(None)
    assert robot.data.time == pytest.approx(0.02)
    for _ in range(50):
        robot.step(None)
    # mj_step lets it sag 0.1 mm and more, dashpot's rigid contact by less than a micrometre.
    assert robot.data.qpos[2] == pytest.approx(0.1, abs=1e-6)
    assert robot.dashpot_engine.contacts(robot.data).force[0, 0] == pytest.approx(9.81, rel=1e-6)


class Welded(BallRobot):
    """What with_dashpot uses of MetaWorld's environments, which are written for MuJoCo 3.3."""

    def __init__(self):
        super().__init__()
        self.reset_mocap_welds()

    def _initialize_simulation(self):
        self.model = mujoco.MjModel.from_xml_string(
            "<mujoco><worldbody><body name='mocap' mocap='true' pos='0 0 1'/><body name='hand'>"
            "<freejoint/><geom size='.1' mass='1'/></body></worldbody><equality>"
            "<weld body1='mocap' body2='hand' relpose='0 0 -1 1 0 0 0'/></equality></mujoco>"
        )
        self.data = mujoco.MjData(self.model)

    def reset_mocap_welds(self):
        if self.model.nmocap > 0:
            self.model.eq_data[0] = np.array([0.0] * 6 + [-1.0, 0.0, 0.0, 0.0, 5.0])


def test_welds_are_reset_that_have_more_numbers_than_metaworld_knows():
    with pytest.raises(ValueError, match="broadcast"):
        Welded()
    robot = with_dashpot(Welded)()
    assert robot.model is robot.dashpot_engine.model
    assert list(robot.model.eq_data[0, 3:11]) == [0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 5.0]
    # The hand, a metre away, is fetched, within ten times 20 ms, to the weld's softness.
    for _ in range(10):
        robot.step(None)
    assert robot.data.qpos[2] == pytest.approx(1.0, abs=2e-3)


class Yard:
    """Holds the robot that it steps, as gymnasium-robotics' kitchen and mazes do."""

    def __init__(self, wrapped=False):
        robot = BallRobot()
        robot.camera = SimpleNamespace(model=robot.model, data=robot.data)
        self.robot = SimpleNamespace(unwrapped=robot) if wrapped else robot
        self.model, self.data = robot.model, robot.data

    def reset(self):
        mujoco.mj_resetData(self.model, self.data)

    def step(self, action):
        getattr(self.robot, "unwrapped", self.robot).step(action)


@pytest.mark.parametrize("wrapped", [False, True])
def test_an_environment_that_holds_the_one_that_it_steps_goes_over(wrapped):
    yard = with_dashpot(Yard)(wrapped=wrapped)
    robot = yard.robot.unwrapped if wrapped else yard.robot
    assert type(yard).__name__ == "YardWithDashpot"
    assert isinstance(robot, BallRobot)
    assert yard.data.qpos[0] == 0.25
    assert list(yard.data.userdata[:2]) == [3.0, 4.0]
    for holder in (yard, robot, robot.camera):
        assert holder.model is yard.dashpot_engine.model
        assert holder.data is yard.data
    for _ in range(50):
        yard.step(None)
    # As in test_robot_environments_keep_what_they_set_up.
    assert yard.data.qpos[2] == pytest.approx(0.1, abs=1e-6)
    assert yard.dashpot_engine.contacts(yard.data).force[0, 0] == pytest.approx(9.81, rel=1e-6)


def test_an_environment_that_holds_none_or_two_is_refused():
    class Empty(Yard):
        def __init__(self):
            pass

    class Two(Yard):
        def __init__(self):
            self.left, self.right = BallRobot(), BallRobot()

    for env_class, count in ((Empty, 0), (Two, 2)):
        with pytest.raises(TypeError, match=f"{env_class.__name__}.*hold {count} of those, not"):
            with_dashpot(env_class)()
    with pytest.raises(TypeError, match=r"make_engine returned MjModel; it must be Engine"):
        with_dashpot(Yard, make_engine=lambda model: model)()


@pytest.mark.parametrize("bad", [dict, HopperEnv.__init__, "hopper"])
def test_what_is_no_class_of_environments_is_refused(bad):
    with pytest.raises(TypeError, match="env_class is"):
        with_dashpot(bad)


def test_what_makes_no_engine_is_refused():
    env_class = with_dashpot(HopperEnv, make_engine=lambda model: model)
    with pytest.raises(TypeError, match=r"make_engine returned MjModel; it must be Engine"):
        env_class()


def test_registered_ids_are_made_as_theirs_are():
    (name,) = register("Hopper-v5")
    assert name == "dashpot/Hopper-v5"
    made = gymnasium.make(name, render_mode="rgb_array_list", reset_noise_scale=0.0)
    theirs = gymnasium.make("Hopper-v5")
    assert isinstance(made.unwrapped, HopperEnv)
    assert made.unwrapped.dashpot_engine.model is made.unwrapped.model
    for field in ("max_episode_steps", "reward_threshold", "order_enforce"):
        assert getattr(made.spec, field) == getattr(theirs.spec, field)
    assert "RenderCollection" in str(made)  # by what its class says of render modes
    # By path, so that it can be stored; and theirs is left alone.
    stored = gymnasium.envs.registration.EnvSpec.from_json(made.spec.to_json())
    assert gymnasium.make(stored).unwrapped.dashpot_engine.law == "kelvin_voigt"
    assert not hasattr(theirs.unwrapped, "dashpot_engine")


def test_worlds_of_a_registered_id_run_in_processes():
    (name,) = register("Hopper-v5")
    worlds = gymnasium.make_vec(
        name, num_envs=2, vectorization_mode="async", vector_kwargs={"context": "spawn"}
    )
    alone = gymnasium.make(name)
    observations, _ = worlds.reset(seed=[3, 4])
    assert np.array_equal(observations[1], alone.reset(seed=4)[0])
    worlds.step(np.zeros((2, 3)))
    worlds.close()


def test_all_of_gymnasiums_own_environments_are_registered_unless_some_are_named():
    names = register()
    assert {"dashpot/Ant-v5", "dashpot/HumanoidStandup-v4"} <= set(names)
    assert not any(name.endswith(("-v2", "-v3")) for name in names)
    assert register() == names  # what is registered already is not taken for theirs


def test_registered_engines_are_those_that_are_asked_for():
    def make_engine(model):
        engine = Engine(model, impact="cut")
        engine.set_material("floor", Material(stiffness=1e4))
        return engine

    (name,) = register("Hopper-v5", make_engine=make_engine, namespace="soft")
    assert name == "soft/Hopper-v5"
    assert gymnasium.make(name).unwrapped.dashpot_engine.impact == "cut"


def test_what_cannot_be_registered_is_named():
    with pytest.raises(gymnasium.error.Error, match="Hoper"):
        register("Hopper-v5", "Hoper-v5", namespace="none")
    assert "none/Hopper-v5" not in gymnasium.registry
    gymnasium.register("Made-v0", entry_point=lambda: HopperEnv())
    with pytest.raises(ValueError, match=r"environment 'Made-v0' is made by .*, which is no class"):
        register("Made-v0")
    for path in ("nothing", "gymnasium.envs.mujoco.ant_v5.Ante", "no.such.Module"):
        with pytest.raises(AttributeError, match=rf"'dashpot.gymnasium' has no attribute '{path}'"):
            getattr(dashpot.gymnasium, path)


def test_package_offers_it():
    assert dashpot.gymnasium.with_dashpot is with_dashpot
