"""Bodies that users move: mocap bodies, and static ones by edits of the model."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from dashpot import Engine

DT = 0.002
SCENE = """<mujoco><option timestep="0.002" {option}/><worldbody>
  <geom type="plane" size="9 9 .1" pos="0 0 {floor}" friction=".5"/>
  <body name="told" {mocap} pos="{start}"><geom name="told" type="box" size="{size}"/></body>
  <body name="free" pos="{free}"><freejoint/><geom type="{shape}" size=".05 .05 .05" mass=".5"/>
  </body></worldbody></mujoco>"""
PUSHER = {"floor": 0, "start": "0 0 .05", "size": ".05 .1 .04", "free": ".1 0 .05"}
LIFT = {"floor": -0.1, "start": "0 0 0", "size": ".3 .3 .02", "free": "0 0 .07"}
MOCAP, STATIC = 'mocap="true"', ""
MOVES = [MOCAP, STATIC]


class Told:
    """An engine whose body "told" goes where it is told to."""

    def __init__(self, mocap: str, *, shape: str = "box", option: str = "", **scene: object):
        xml = SCENE.format(mocap=mocap, shape=shape, option=option, **scene)
        self.engine = Engine(mujoco.MjModel.from_xml_string(xml))
        self.data = self.engine.make_data()
        body = self.engine.model.body("told").id
        if mocap:
            self.position, self.quaternion = self.data.mocap_pos[0], self.data.mocap_quat[0]
        else:
            self.position = self.engine.model.body_pos[body]
            self.quaternion = self.engine.model.body_quat[body]
        self.start = self.position.copy()
        self.engine.step(self.data)

    def go(self, axis: int, speed: float, *, steps: int, every: int = 1) -> list[float]:
        """Go on at a speed, told by every n-th step; return overlaps seen before each telling."""
        seen = []
        for k in range(steps):
            if k % every == 0:
                self.position[axis] = self.start[axis] + speed * DT * (k + every)
            self.engine.step(self.data)
            if (k + 1) % every == 0:
                seen.append(self.seen())
        return seen

    def seen(self) -> float:
        """Return by how much (m) the told body and the free one overlap after mj_forward."""
        shown = mujoco.MjData(self.engine.model)
        mujoco.mj_copyData(shown, self.engine.model, self.data)
        mujoco.mj_forward(self.engine.model, shown)
        told = self.engine.model.geom("told").id
        contacts = [shown.contact[i] for i in range(shown.ncon)]
        return max([0.0] + [-c.dist for c in contacts if told in (c.geom1, c.geom2)])


@pytest.mark.parametrize("mocap", MOVES)
@pytest.mark.parametrize("every", [1, 10])
@pytest.mark.parametrize("speed", [0.1, 1.0])
def test_a_pusher_is_seen_where_it_pushes(speed, every, mocap):
    # 40 ms behind what is told it would be seen 19.5 mm inside at 0.5 m/s.
    told = Told(mocap, **PUSHER)
    seen = told.go(0, speed, steps=300, every=every)
    assert max(seen[20 // every :]) < 1e-4
    # Where it starts at once, told in each step, it begins slowly.
    assert max(seen) < 8e-3 * speed
    # It pushes at its speed, and throws no farther than a blow at that does, of restitution 0.18.
    assert speed * 0.9 < told.data.qvel[0] < speed * 1.25 * 1.2


@pytest.mark.parametrize("mocap", MOVES)
@pytest.mark.parametrize("every", [1, 10])
@pytest.mark.parametrize("speed", [0.05, 0.3])
def test_a_lift_carries_what_stands_on_it(speed, every, mocap):
    told = Told(mocap, **LIFT)
    start = told.engine.energy(told.data).total
    told.go(2, speed, steps=500, every=every)
    assert told.data.qpos[2] == pytest.approx(0.07 + speed * DT * 500, abs=2e-6)
    assert told.data.qvel[2] == pytest.approx(speed, rel=1e-3)
    assert told.engine.energy(told.data).total == pytest.approx(start, abs=1e-9)


def test_poses_at_uneven_intervals_are_a_steady_motion():
    # A screen's 60 Hz at 2 ms: intervals of 8 and 9 steps.
    told = Told(MOCAP, **LIFT)
    speeds, next_frame = [], 0.0
    for k in range(400):
        if k * DT >= next_frame:
            next_frame += 1.0 / 60.0
            told.position[2] = 0.2 * next_frame
        told.engine.step(told.data)
        speeds.append(told.data.body("told").cvel[5])
    assert np.asarray(speeds[100:]) == pytest.approx(0.2, rel=0.2)


@pytest.mark.parametrize("jump", [0.002, 0.01, 0.05])
def test_a_single_jump_is_no_blow(jump):
    # MuJoCo's contacts take the 20 ms of their solref. Within one step it would be 1 to 25 m/s.
    told = Told(MOCAP, **PUSHER)
    told.engine.step(told.data, nstep=100)
    told.position[0] += jump
    fastest = 0.0
    for _ in range(50):
        told.engine.step(told.data)
        fastest = max(fastest, told.data.qvel[0])
    assert 0.9 * jump / 0.02 < fastest or jump < 0.005
    assert fastest < 1.25 * max(jump / 0.02, 0.25)
    assert told.data.qpos[0] > 0.1 + 0.99 * jump


@pytest.mark.parametrize("gravity", ["0 0 -9.81", "0 0 0"])
@pytest.mark.parametrize("shape", ["box", "sphere"])
def test_a_static_body_that_is_moved_acts_as_a_mocap_body(shape, gravity):
    states = []
    for mocap in MOVES:
        told = Told(mocap, shape=shape, option=f'gravity="{gravity}"', **PUSHER)
        for k in range(300):
            angle = 0.5 * 0.4 * math.sin(5.0 * k * DT)
            told.position[:2] = 0.1 * math.sin(4.0 * k * DT), 0.02 * k * DT
            told.quaternion[:] = math.cos(angle), 0.0, 0.0, math.sin(angle)
            told.engine.step(told.data)
        states.append(np.concatenate([told.data.qpos, told.data.qvel]))
    assert np.array_equal(*states)
    assert np.linalg.norm(states[0][:3] - [0.1, 0.0, 0.05]) > 0.01


@pytest.mark.parametrize("mocap", MOVES)
def test_an_arm_goes_with_its_base(mocap):
    """A finger on a springy joint of a moved base pushes at its speed."""
    engine = Engine(
        mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="0.002" gravity="0 0 0"/>
        <worldbody><body name="base" {mocap}><body><joint axis="0 1 0" stiffness="20"
        damping=".5"/><geom type="box" size=".02 .05 .1" pos="0 0 -.1" mass=".2"/></body></body>
        <body pos=".2 0 -.1"><freejoint/><geom size=".04" mass=".1"/></body>
        </worldbody></mujoco>""")
    )
    data = engine.make_data()
    place = data.mocap_pos[0] if mocap else engine.model.body_pos[engine.model.body("base").id]
    deepest = 0.0
    for k in range(600):
        place[0] = 0.5 * k * DT
        deepest = max(deepest, engine.step(data).max_penetration)
    assert data.qvel[1] > 0.95 * 0.5
    assert deepest < 1e-4


def test_a_moved_lift_wakes_what_sleeps_on_it():
    told = Told(STATIC, **LIFT, option='><flag sleep="enable"/></option><option')
    told.engine.step(told.data, nstep=1000)
    assert told.data.tree_asleep[0] >= 0
    told.start = told.position.copy()
    told.go(2, 0.3, steps=200)
    assert told.data.qpos[2] == pytest.approx(0.07 + 0.3 * 0.4, abs=1e-5)
    told.engine.step(told.data, nstep=1500)
    assert told.data.tree_asleep[0] >= 0


@pytest.mark.parametrize("mocap", MOVES)
def test_what_jumps_away_takes_the_compression_along(mocap):
    told = Told(mocap, **LIFT)
    told.data.qpos[2] = 0.08
    told.data.qvel[2] = -3.0
    told.engine.step(told.data)
    while told.data.qvel[2] == pytest.approx(-3.0, abs=0.1):
        told.engine.step(told.data)
    before = told.data.qvel[2]
    told.position[2] -= 1.0
    told.engine.step(told.data)
    assert told.data.qvel[2] == pytest.approx(before - 9.81 * DT, abs=1e-12)


def test_edits_of_a_model_move_nothing_in_other_data():
    """The pose that a body was told before is of the data that were stepped with it."""
    told = Told(STATIC, **PUSHER)
    other = told.engine.make_data()
    told.go(0, 0.5, steps=100)
    other.qpos[0] = 3.0
    told.engine.step(other, nstep=10)
    assert np.abs(other.qvel).max() < 1e-9
