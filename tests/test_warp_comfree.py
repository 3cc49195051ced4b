"""The complementarity-free law of dashpot.warp beside that of the C++ engine."""

import numpy as np
import pytest

import dashpot
from warp_worlds import Worlds, model_of, wp

OPTION = '<option gravity="0 0 -9.81"/>'
BALL = (
    f'<mujoco>{OPTION}<worldbody><geom type="plane" size="1 1 .1" condim="{{condim}}"/>'
    '<body pos="0 0 .1"><freejoint/>'
    '<geom type="sphere" size=".1" condim="{condim}" friction="1 0.01 0.005"/></body>'
    "</worldbody></mujoco>"
)
SLIDE = (
    f'<mujoco>{OPTION}<worldbody><geom type="plane" size="1 1 .1"/><body pos="0 0 .05">'
    '<freejoint/><geom type="box" size=".1 .1 .05" friction=".2"/></body></worldbody></mujoco>'
)
HINGE = (
    f'<mujoco>{OPTION}<worldbody><body pos="0 0 1"><joint type="hinge" axis="0 1 0" {{joint}}/>'
    '<geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0" mass="1"/></body></worldbody></mujoco>'
)
CONNECTED = (
    f'<mujoco>{OPTION}<worldbody><body pos="0 0 1"><joint type="hinge" axis="0 1 0"/>'
    '<geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0" mass="1" contype="0" conaffinity="0"/>'
    '<body name="tip" pos="0.3 0 0" euler="0 70 0"><joint type="hinge" axis="0 1 0"/>'
    '<geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0" mass="1" contype="0" conaffinity="0"/>'
    "</body></body></worldbody>"
    '<equality><connect body1="tip" body2="world" anchor="0.3 0 0"/></equality></mujoco>'
)


def push(_, data):
    data.qvel[0] = 1.0


@pytest.mark.parametrize(
    ("xml", "start", "tolerance"),
    [
        (SLIDE, push, 1e-6),
        (BALL.format(condim=1), push, 1e-6),
        (BALL.format(condim=3), push, 1e-6),
        (BALL.format(condim=6), push, 1e-6),
        (HINGE.format(joint='range="-60 60" limited="true"'), None, 1e-6),
        (HINGE.format(joint='frictionloss="0.5"'), None, 1e-6),
        (CONNECTED, None, 1e-6),
    ],
)
def test_half_a_second_is_that_of_the_engine(xml, start, tolerance):
    model = model_of(xml)
    worlds = Worlds(model, start=start, nconmax=8, law="comfree")
    engine = dashpot.Engine(model, law="comfree")
    data = engine.make_data()
    if start:
        start(model, data)
    worst = 0.0
    for _ in range(250):
        worlds.step()
        engine.step(data)
        worst = max(worst, np.abs(worlds.positions()[:3] - data.qpos[:3]).max())
    assert worst < tolerance


def test_parameters_go_by_the_number_of_the_world():
    worlds = Worlds(
        model_of(SLIDE), nworld=4, law="comfree", nconmax=8, comfree_stiffness=[0.2, 0.1]
    )
    worlds.step(500)
    height = worlds.d.qpos.numpy()[:, 2]
    np.testing.assert_array_equal(height[:2], height[2:])
    assert height[1] < height[0]
    assert wp.config.enable_cpu_blocks is False  # left as it was
