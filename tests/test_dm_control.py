"""dm_control's environments step with dashpot and stay what they are otherwise."""

import copy
import pickle
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot import Engine, Material

pytest.importorskip("dm_control")

from dm_control import composer, mjcf, suite
from dm_control.mujoco import Physics
from dm_control.rl.control import PhysicsError
from dm_control.suite.wrappers import action_noise, action_scale

from dashpot.dm_control import with_dashpot

BALL = """<mujoco><option timestep="0.002"/><worldbody>
<geom name="floor" type="plane" size="1 1 1"/>
<body name="ball" pos="0 0 .1"><freejoint/><geom name="ball" size=".1" mass="1"/></body>
</worldbody></mujoco>"""
WEIGHT = 9.81


def load(domain, task):
    return suite.load(domain, task, task_kwargs={"random": 1})


# What MuJoCo computes of positions and velocities.
COMPUTED = ["xpos", "xmat", "geom_xpos", "site_xpos", "subtree_com", "cinert", "M", "sensordata"]
COMPUTED += ["actuator_length", "actuator_velocity", "cvel", "qfrc_bias", "qfrc_passive"]


def play(env, *, steps, seed=0):
    """Return the observations of an episode with random actions, (steps + 1, n)."""
    rng = np.random.default_rng(seed)
    space = env.action_spec()
    timesteps = [env.reset()]
    for _ in range(steps):
        timesteps.append(env.step(rng.uniform(space.minimum, space.maximum)))
    return np.array([np.hstack(list(t.observation.values())) for t in timesteps])


@pytest.mark.parametrize(("domain", "task"), [("acrobot", "swingup"), ("reacher", "easy")])
def test_what_touches_nothing_moves_and_is_observed_as_in_dm_control_bit_for_bit(domain, task):
    """Where no row is possible MuJoCo integrates: limits and contacts are off."""
    theirs, ours = load(domain, task), with_dashpot(load(domain, task))
    for env in (theirs, ours):
        env.physics.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    theirs, ours = play(theirs, steps=20), play(ours, steps=20)
    assert np.ptp(theirs, axis=0).max() > 0.1
    assert np.array_equal(ours, theirs)


def test_poses_and_sensors_are_those_of_the_end_of_a_step():
    env = with_dashpot(load("walker", "run"))
    env.reset()
    physics, contacts = env.physics, 0
    for _ in range(60):
        env.step(np.full(6, 0.5))
        contacts += physics.data.ncon
        again = physics.copy(share_model=True).data.ptr
        mujoco.mj_copyData(again, physics.model.ptr, physics.data.ptr)
        mujoco.mj_step1(physics.model.ptr, again)
        for name in COMPUTED:
            assert np.array_equal(getattr(physics.data, name), getattr(again, name)), name
    assert contacts > 60
    assert physics.data.sensordata.size


def test_without_legacy_step_they_are_those_of_its_start():
    physics = with_dashpot(Physics.from_xml_string(BALL.replace("0 0 .1", "0 0 .5", 1)))
    physics.legacy_step = False
    physics.step(2)
    start = 0.5 - WEIGHT * 0.002**2 / 2  # of a ball in free fall, after one step
    assert physics.data.xpos[1, 2] == pytest.approx(start, abs=1e-12)


def test_contacts_carry_the_weight_that_rests_on_them():
    physics = with_dashpot(Physics.from_xml_string(BALL))
    physics.step(500)
    assert [tuple(contact.geom) for contact in physics.data.contact] == [(0, 1)]
    # mj_step lets it sag 0.1 mm and more, dashpot's rigid contact by less than a micrometre.
    assert physics.named.data.xpos["ball", "z"] == pytest.approx(0.1, abs=1e-6)
    force, torque = physics.data.contact_force(0)
    assert force == pytest.approx([WEIGHT, 0.0, 0.0], abs=1e-6 * WEIGHT)
    assert not torque.any()
    engine, data = physics.dashpot_engine, physics.data.ptr
    assert engine.contacts(data).force[0, 0] == pytest.approx(WEIGHT, rel=1e-6)
    with pytest.raises(ValueError, match="contact_id is 1; it must be in 0 to 0"):
        physics.data.contact_force(1)


def test_contact_forces_of_a_bounce_give_what_momentum_it_gains():
    def make_engine(model):
        engine = Engine(model)
        engine.set_pair_material("ball", "floor", Material(stiffness=1e5, restitution=0.8))
        return engine

    physics = with_dashpot(Physics.from_xml_string(BALL), make_engine=make_engine)
    with physics.reset_context():
        physics.data.qpos[2], physics.data.qvel[2] = 0.3, -2.0
    impulse = 0.0
    while not (physics.data.qvel[2] > 0.0 and physics.data.qpos[2] > 0.2):
        physics.step()
        forces = [physics.data.contact_force(i)[0, 0] for i in range(physics.data.ncon)]
        impulse += sum(forces) * physics.timestep()
    # Contacts at the end of a step are others than those in it where it lands and where it leaves.
    gained = physics.data.qvel[2] + 2.0 + WEIGHT * physics.time()
    assert physics.data.qvel[2] > 1.0
    assert impulse == pytest.approx(gained, rel=1e-9)


@pytest.mark.parametrize("kind", ["copy", "shared", "deepcopy", "pickle"])
def test_copies_go_on_as_the_original_does(kind):
    env = with_dashpot(load("walker", "run"))
    play(env, steps=40)
    physics = env.physics
    other = {
        "copy": physics.copy,
        "shared": lambda: physics.copy(share_model=True),
        "deepcopy": lambda: copy.deepcopy(physics),
        "pickle": lambda: pickle.loads(pickle.dumps(physics)),
    }[kind]()
    assert (other.dashpot_engine is physics.dashpot_engine) == (kind == "shared")
    assert type(other).__name__ == "PhysicsWithDashpot"
    assert other.torso_height() == physics.torso_height()
    for each in (physics, other):
        each.set_control(np.full(6, 0.3))
        each.step(20)
    assert np.array_equal(other.data.qpos, physics.data.qpos)


def test_engine_is_the_one_that_is_asked_for():
    def make_engine(model):
        engine = Engine(model, impact="cut")
        engine.set_material("floor", Material(stiffness=1e4, damping_ratio=1.0))
        return engine

    env = with_dashpot(load("hopper", "stand"), make_engine=make_engine)
    assert isinstance(env.physics, Physics)
    assert env.physics.dashpot_engine.impact == "cut"
    assert env.physics.model.ptr is env.physics.dashpot_engine.model
    env.physics.reload_from_xml_string(BALL)
    assert env.physics.dashpot_engine.model.ngeom == 2
    assert len(env.physics.dashpot_engine.materials) == 1


def test_an_episode_goes_on_from_where_it_is():
    env = load("hopper", "stand")
    play(env, steps=5)
    before = env.physics.get_state(mujoco.mjtState.mjSTATE_FULLPHYSICS)
    with_dashpot(env)
    assert np.array_equal(env.physics.get_state(mujoco.mjtState.mjSTATE_FULLPHYSICS), before)
    assert not env.step(np.zeros(4)).first()


class Ball(composer.Entity):
    """A ball that an episode places on the floor, of another size each time."""

    def _build(self):
        self.root = mjcf.RootElement(model="ball")
        self.geom = self.root.worldbody.add("geom", name="ball", size=[0.1], mass=1.0)

    @property
    def mjcf_model(self):
        return self.root

    def initialize_episode_mjcf(self, random_state):
        self.geom.size = [random_state.uniform(0.05, 0.2)]

    def after_compile(self, physics, random_state):
        self.bound = physics.bind(self.geom)

    def initialize_episode(self, physics, random_state):
        self.set_pose(physics, position=[0.0, 0.0, self.bound.size[0]])


class Rest(composer.Task):
    """A ball rests on the floor."""

    def __init__(self):
        self.arena, self.ball = composer.Arena(), Ball()
        self.arena.mjcf_model.worldbody.add("geom", name="floor", type="plane", size=[1, 1, 1])
        self.arena.add_free_entity(self.ball)
        self.set_timesteps(control_timestep=0.02, physics_timestep=0.002)

    @property
    def root_entity(self):
        return self.arena

    def get_reward(self, physics):
        return self.ball.bound.xpos[2] - self.ball.bound.size[0]


def test_composer_compiles_for_each_episode_and_its_bindings_show_the_steps():
    env = with_dashpot(composer.Environment(Rest(), random_state=3))
    theirs = composer.Environment(Rest(), random_state=3)
    sizes = []
    for _ in range(2):
        env.reset()
        theirs.reset()
        sizes.append(env.task.ball.bound.size[0])
        assert np.array_equal(env.physics.data.qpos, theirs.physics.data.qpos)
        for _ in range(50):
            timestep = env.step(np.zeros(0))
        assert abs(timestep.reward) < 1e-6  # as in the test of contacts above
        assert timestep.reward != 0.0
        assert env.physics.data.contact_force(0)[0, 0] == pytest.approx(WEIGHT, rel=1e-6)
    assert sizes[0] != sizes[1]
    assert type(env).__name__ == "EnvironmentWithDashpot"


def test_composer_begins_an_episode_where_one_was_under_way():
    env = composer.Environment(Rest(), recompile_mjcf_every_episode=False)
    env.reset()
    with_dashpot(env)
    assert env.step(np.zeros(0)).first()
    assert env.task.ball.bound.xpos[2] == env.physics.data.qpos[2]


def test_physics_of_composer_are_refused_for_they_are_made_anew():
    env = composer.Environment(Rest())
    with pytest.raises(TypeError, match="makes anew: give the environment"):
        with_dashpot(env.physics)


def test_what_a_step_refuses_is_an_error_of_physics_and_ends_an_episode_of_composer():
    env = with_dashpot(load("hopper", "stand"))
    env.reset()
    before = env.physics.get_state()
    with pytest.raises(PhysicsError, match=r"data.ctrl\[0\] is nan"):
        env.step(np.full(4, np.nan))
    assert np.array_equal(env.physics.get_state(), before)
    with env.physics.suppress_physics_errors():
        env.step(np.full(4, np.nan))

    class Falls(Rest):
        def before_substep(self, physics, action, random_state):
            physics.data.qvel[0] = np.inf

    resting = composer.Environment(Falls(), raise_exception_on_physics_error=False)
    with_dashpot(resting).reset()
    assert resting.step(np.zeros(0)).last()


def test_wrapped_environments_go_over():
    env = action_noise.Wrapper(
        action_scale.Wrapper(load("cheetah", "run"), minimum=-1.0, maximum=1.0)
    )
    assert with_dashpot(env) is env
    assert isinstance(env.physics.dashpot_engine, Engine)


def test_steps_of_a_class_of_physics_come_before_those_of_dashpot():
    class Counting(Physics):
        steps = 0

        def step(self, nstep=1):
            super().step(nstep)
            self.steps += nstep

    physics = with_dashpot(Counting.from_xml_string(BALL))
    physics.step(200)
    assert physics.steps == 200
    assert physics.data.qpos[2] == pytest.approx(0.1, abs=1e-6)


def test_what_is_no_environment_holds_two_or_goes_over_already_is_refused():
    env = load("hopper", "stand")
    two = SimpleNamespace(reset=None, step=None, first=env, second=load("hopper", "stand"))
    for bad, count in (("hopper", 0), (two, 2)):
        with pytest.raises(TypeError, match=f"in which {count} of dm_control's are found, not one"):
            with_dashpot(bad)
    physics_class, data = type(env.physics), env.physics.data
    with pytest.raises(TypeError, match=r"make_engine returned MjModel; it must be Engine"):
        with_dashpot(env, make_engine=lambda model: model)
    assert type(env.physics) is physics_class
    assert env.physics.data is data
    with pytest.raises(ValueError, match="env is stepped by dashpot already"):
        with_dashpot(with_dashpot(env))


class Yard:
    """Holds an environment of dm_control's, as gym-aloha's do."""

    def __init__(self):
        self._env = load("hopper", "stand")

    def reset(self):
        return self._env.reset()

    def step(self, action):
        return self._env.step(action)


def test_gymnasium_environments_that_hold_one_of_dm_controls_go_over():
    yard = dashpot.gymnasium.with_dashpot(Yard)()
    yard.reset()
    yard.step(np.zeros(4))
    assert yard.dashpot_engine is yard._env.physics.dashpot_engine
    assert yard.dashpot_engine.contacts(yard._env.physics.data.ptr) is not None


def test_package_offers_it():
    assert dashpot.dm_control.with_dashpot is with_dashpot
