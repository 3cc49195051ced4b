"""Drift of an object in the gripper of an arm that swings it, beside MuJoCo.

    python benchmarks/carried.py

Two hinges swing the hand by 0.8 rad at 3 and 5 rad/s, a third turns it by 1.5 rad at 4 rad/s, all
by servos; one finger presses a 0.2 kg object of 4 cm against the other with 15 N, seven times its
weight. Friction 1. Nothing slips: what the object moves in the frame of the hand, after the first
second, is error. MuJoCo runs with its defaults, and with all that its documentation advises
against slip: elliptic cones, impratio 100, ten iterations of its noslip solver, and contacts as
stiff as the time step allows (solref of two steps).
"""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np

from no_arguments import takes_no_arguments
from scene import Array, Run, Scene
from simulate import AS_SHIPPED, DASHPOT, Setting, record

OBJECTS = {
    "box": 'type="box" size=".02 .02 .02"',
    "cylinder": 'type="cylinder" size=".02 .02"',
    "capsule": 'type="capsule" size=".02 .02" condim="4"',
    "sphere": 'type="sphere" size=".02" condim="6"',
}
TIMESTEPS = (0.001, 0.002, 0.005)
GRIP = 15.0
ADVISED = Setting(
    "as advised",
    timeconst_steps=2.0,
    option={"cone": mujoco.mjtCone.mjCONE_ELLIPTIC, "impratio": 100.0, "noslip_iterations": 10},
)


def arm_with(shape: str) -> str:
    """Return the MJCF of the arm with the object between its fingers, not yet pressed."""
    link = 'contype="0" conaffinity="0"'
    finger = 'type="box" size=".005 .02 .03" mass=".05" friction="1"'
    return f"""<mujoco><option integrator="implicitfast"/><worldbody>
          <body pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping="1"/>
            <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass="2" {link}/>
            <body pos="0 0 -.4"><joint name="elbow" axis="0 1 0" damping=".5"/>
              <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass="1" {link}/>
              <body name="hand" pos="0 0 -.35"><joint name="wrist" axis="0 0 1" damping=".2"/>
                <geom type="box" size=".06 .02 .01" mass=".3" {link}/>
                <geom pos=".025 0 -.05" {finger}/>
                <body pos="-.03 0 -.05">
                  <joint name="finger" type="slide" axis="1 0 0" damping="5"/><geom {finger}/>
                </body></body></body></body>
          <body name="object" pos="0 0 .2"><freejoint/>
            <geom {OBJECTS[shape]} mass=".2" friction="1"/></body></worldbody>
        <actuator><position joint="shoulder" kp="300" kv="20"/>
          <position joint="elbow" kp="150" kv="8"/><position joint="wrist" kp="20" kv="1"/>
          <motor joint="finger"/></actuator></mujoco>"""


def carried(shape: str, timestep: float) -> mujoco.MjModel:
    """Return the arm with the object between its fingers, not yet pressed."""
    return carrying(shape).model(timestep)


def control(time: float) -> tuple[float, float, float, float]:
    """Return the commands at a time (s); the swing builds up within the first second."""
    swing = 0.8 * min(1.0, time)
    return (
        swing * np.sin(3 * time),
        swing * np.sin(5 * time),
        1.5 / 0.8 * swing * np.sin(4 * time),
        GRIP,
    )


def displacements(run: Run) -> Array:
    """Return how far (m) the object is from its place in the hand, every sample from 1 s on."""
    data = mujoco.MjData(run.model)
    hand, held = run.model.body("hand").id, run.model.body("object").id
    places = []
    for qpos in run.qpos[run.time > 1.0 - 1e-9]:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(run.model, data)
        places.append(data.xmat[hand].reshape(3, 3).T @ (data.xpos[held] - data.xpos[hand]))
    return np.linalg.norm(np.array(places) - places[0], axis=1)


def carrying(shape: str, *, duration: float = 20.0) -> Scene:
    """Swing an object in a gripper; the farthest that it gets from its place there."""

    def swing(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.ctrl[:] = control(data.time)

    return Scene(
        name=f"carried-{shape}",
        title=f"{shape} in the gripper of an arm that swings it for {duration:g} s, slip",
        xml=arm_with(shape),
        duration=duration,
        drive=swing,
        measure=lambda run: {"slip": float(displacements(run).max())},
        targets={"slip": 2e-4},
        units={"slip": "m"},
        sample_interval=0.1,
        timesteps=TIMESTEPS,
    )


def drifts(model: mujoco.MjModel, *, duration: float, peer: bool) -> Array:
    """Return how far (m) the object is from its place in the hand, every 0.1 s from 1 s on."""
    scene = dataclasses.replace(carrying("box", duration=duration), compiled=model)
    return displacements(record(scene, AS_SHIPPED if peer else DASHPOT, model.opt.timestep))


def main() -> None:
    """Print one line an object and time step."""
    takes_no_arguments(__doc__)
    for shape in OBJECTS:
        for timestep in TIMESTEPS:
            texts = []
            for setting in (DASHPOT, AS_SHIPPED, ADVISED):
                drift = 1e3 * displacements(record(carrying(shape), setting, timestep))
                lost = np.flatnonzero(drift > 20.0)
                texts.append(
                    f"lost after {1 + 0.1 * lost[0]:.1f} s" if lost.size else f"{drift.max():.3f}"
                )
            print(
                f"{shape} {1e3 * timestep:g} ms: farthest from its place in 20 s, mm: {texts[0]}; "
                f"MuJoCo {texts[1]}, as advised {texts[2]}",
                flush=True,
            )


if __name__ == "__main__":
    main()
