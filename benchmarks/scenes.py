"""Few-body scenes with a known answer."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping
from math import cos, radians, sin

import mujoco
import numpy as np

from dashpot import Material
from scene import GRAVITY, Array, Run, Scene, free_body, mjcf, set_velocity


@functools.cache
def ball_drop(*, restitution: float = 0.9, stiffness: float = 1e4) -> Scene:
    """Drop a ball of 1 kg and 0.1 m radius by 1 m on a rigid floor; first 10 apices."""
    from exact import BouncingBall, damping_ratio_of

    ratio = damping_ratio_of(restitution)
    damping = 2 * ratio * stiffness**0.5
    exact = BouncingBall(1.0, stiffness, damping, until=10.0 if restitution == 1 else 9.5)
    apices = exact.apices(10)

    def measure(run: Run) -> dict[str, float]:
        gap, rate = run.qpos[:, 2] - 0.1, run.qvel[:, 2]
        errors = []
        for time, height in apices:
            if height <= 0:
                continue
            i = run.at(time)
            errors.append(abs(gap[i] + rate[i] ** 2 / (2 * GRAVITY) - height))
        return {"apex error": max(errors), "apices": len(errors)}

    return Scene(
        name=f"ball-e{restitution:g}",
        title=f"Kelvin-Voigt ball, e = {restitution:g}, apex error",
        xml=mjcf(free_body("ball", 'type="sphere" size="0.1" mass="1"', (0, 0, 1.1))),
        duration=apices[-1][0] + 0.02,
        materials={"ball": Material(stiffness, restitution=restitution)},
        direct_solref=(-stiffness, -float(damping)),
        measure=measure,
        targets={"apex error": 1e-9},
        units={"apex error": "m"},
        timesteps=(0.0001, 0.0005, 0.001, 0.002, 0.005, 0.010),
    )


def slope(
    *,
    degrees: float = 20.0,
    friction: float = 0.5,
    duration: float = 60.0,
    settle: float = 1.0,
    materials: Mapping[str, Material] | None = None,
) -> Scene:
    """Put a box of 1 kg on a slope below the friction angle; creep after settling."""
    half, angle = 0.05, radians(degrees)
    down = np.array([cos(angle), 0.0, -sin(angle)])
    turn = np.array([cos(angle / 2), 0.0, sin(angle / 2), 0.0])
    centre = (half * sin(angle), 0.0, half * cos(angle))
    floor = f'quat="{cos(angle / 2)!r} 0 {sin(angle / 2)!r} 0" friction="{friction}"'
    box = f'type="box" size="{half} {half} {half}" mass="1" friction="{friction}"'

    def measure(run: Run) -> dict[str, float]:
        first = run.at(settle)
        moved = (run.position("box") - run.position("box")[first]) @ down
        return {"creep": float(np.abs(moved[-1])), "speed": float(np.abs(run.qvel[-1]).max())}

    return Scene(
        name="slope",
        title=f"box on slope {degrees:g} deg, friction {friction:g}, creep in {duration:g} s",
        xml=mjcf(free_body("box", box, centre, quat=turn), floor=floor),
        duration=settle + duration,
        materials=materials or {},
        measure=measure,
        targets={"creep": 1e-9},
        units={"creep": "m", "speed": "m/s"},
        sample_interval=0.1,
    )


def slide(
    *, speed: float = 1.0, friction: float = 0.2, materials: Mapping[str, Material] | None = None
) -> Scene:
    """Slide a box until it stops: ``v^2 / (2 mu g)`` when it starts touching but unloaded.

    While the contacts load the box sinks by its sag ``z``, so ``m g t`` and ``- m z`` have been
    added to the first and second integrals of the normal force: the stop is at
    ``v^2 / (2 mu g) + mu z``. The friction springs, stretched to ``mu m g / k_t``, then pull it
    back; with the sag of rigid contacts all this is below 2 um.
    """
    stop = speed**2 / (2 * friction * GRAVITY)
    box = f'type="box" size="0.1 0.1 0.05" mass="1" friction="{friction}"'

    def measure(run: Run) -> dict[str, float]:
        return {
            "distance error": abs(float(run.qpos[-1, 0]) - stop),
            "final speed": float(np.abs(run.qvel[-1]).max()),
        }

    return Scene(
        name="slide",
        title=f"sliding box, friction {friction:g}, distance error",
        xml=mjcf(free_body("box", box, (0, 0, 0.05)), floor=f'friction="{friction}"'),
        duration=speed / (friction * GRAVITY) + 0.5,
        start=set_velocity("box", (speed, 0, 0)),
        materials=materials or {},
        measure=measure,
        targets={"distance error": 5e-5},
        units={"distance error": "m", "final speed": "m/s"},
    )


def rise(*, speed: float = 6.0) -> Scene:
    """Kick a settled cube to 6 m/s: normal force must not depend on sliding speed."""
    box = 'type="box" size="0.05 0.05 0.05" mass="1" friction="0.5"'

    def measure(run: Run) -> dict[str, float]:
        before = run.at(0.5)
        height = run.qpos[before:, 2]
        return {"rise": float(height.max() - height[0])}

    return Scene(
        name="rise",
        title=f"cube sliding at {speed:g} m/s, spurious rise",
        xml=mjcf(free_body("box", box, (0, 0, 0.05)), floor='friction="0.5"'),
        duration=1.5,
        kick=set_velocity("box", (speed, 0, 0)),
        kick_time=0.5,
        measure=measure,
        targets={"rise": 1e-6},
        units={"rise": "m"},
    )


def wall_press(
    *,
    push: float = 20.0,
    friction: float = 1.0,
    depth: float = 0.05,
    duration: float = 5.0,
    materials: Mapping[str, Material] | None = None,
) -> Scene:
    """Press a cube of 1 kg to a wall (at x = 0) so that friction alone carries its weight."""

    def press(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.xfrc_applied[model.body("cube").id, 0] = -push

    cube = f'type="box" size="{depth} 0.05 0.05" mass="1" friction="{friction}"'
    xml = mjcf(
        free_body("cube", cube, (depth, 0, 1)),
        floor=f'quat="0.70710678118654757 0 0.70710678118654757 0" friction="{friction}"',
    )

    def measure(run: Run) -> dict[str, float]:
        return {
            "drop": float(1 - run.qpos[-1, 2]),
            "speed": float(np.abs(run.qvel[-1]).max()),
        }

    return Scene(
        name="wall",
        title=f"1 kg cube pressed to a wall, {push:g} N, friction {friction:g}, {duration:g} s",
        xml=xml,
        duration=duration,
        start=press,
        materials=materials or {},
        measure=measure,
        targets={"drop": 1e-4, "speed": 1e-9},
        units={"drop": "m", "speed": "m/s"},
        sample_interval=0.1,
    )


def gripper(*, duration: float = 10.0, force: float = 20.0, amplitude: float = 0.03) -> Scene:
    """Hold 0.5 kg between two force-controlled fingers of a hand shaken at 2 Hz.

    The hand is a 3-axis slide servo, one finger a stiff position servo, the other a motor.
    Peak acceleration of the hand is 4.7 m/s^2 vertically and half that sideways.
    """
    frequency = 2.0

    def shake(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        ramp = min(1.0, max(0.0, data.time - 0.5))
        phase = 2 * np.pi * frequency * data.time
        data.ctrl[:] = [
            0.5 * amplitude * ramp * np.sin(phase),
            amplitude * ramp * np.sin(phase),
            force / 1000,  # the servo's stiffness: it pushes back at its zero
            -force,
        ]

    finger = 'type="box" size="0.01 0.02 0.03" mass="0.1" friction="1"'
    held = 'type="box" size="0.03 0.02 0.04" mass="0.5" friction="1"'
    bodies = f"""
    <body name="hand" pos="0 0 1">
      <joint name="hand_y" type="slide" axis="0 1 0"/>
      <joint name="hand_z" type="slide" axis="0 0 1"/>
      <geom type="box" size="0.08 0.02 0.02" pos="0 0 0.1" mass="1" contype="0" conaffinity="0"/>
      <body name="left" pos="-0.04 0 0">
        <joint name="left" type="slide" axis="1 0 0" damping="5"/><geom name="left" {finger}/>
      </body>
      <body name="right" pos="0.04 0 0">
        <joint name="right" type="slide" axis="1 0 0" damping="5"/><geom name="right" {finger}/>
      </body>
    </body>""" + free_body("held", held, (0, 0, 1))
    rest = """<actuator>
      <position name="hand_y" joint="hand_y" kp="5000" kv="150"/>
      <position name="hand_z" joint="hand_z" kp="5000" kv="150"/>
      <position name="left" joint="left" kp="1000" kv="20"/>
      <motor name="right" joint="right"/>
    </actuator>"""

    def measure(run: Run) -> dict[str, float]:
        held = run.position("held") - np.array([0, 0, 1])
        hand = np.zeros_like(held)
        for axis, joint in ((0, "left"), (1, "hand_y"), (2, "hand_z")):
            hand[:, axis] = run.qpos[:, run.model.jnt_qposadr[run.model.joint(joint).id]]
        relative = held - hand
        period = 1 / frequency

        def mean(until: float) -> Array:
            rows = (run.time > until - period + 1e-9) & (run.time <= until + 1e-9)
            return relative[rows].mean(axis=0)

        slip = mean(run.time[-1]) - mean(2.0)
        return {"slip": float(np.linalg.norm(slip))}

    return Scene(
        name="gripper",
        title=f"gripper holding 0.5 kg, shaken {duration:g} s, slip",
        xml=mjcf(bodies, rest=rest, option='integrator="implicitfast"'),
        duration=duration,
        drive=shake,
        measure=measure,
        targets={"slip": 1e-5},
        units={"slip": "m"},
    )


def roll(*, speed: float = 1.0, friction: float = 0.2) -> Scene:
    """Throw a ball along the floor without spin: it ends up rolling at 5/7 of its speed."""
    ball = f'type="sphere" size="0.1" mass="1" friction="{friction}"'

    def measure(run: Run) -> dict[str, float]:
        terminal = 5 / 7 * speed
        return {
            "velocity error": abs(float(run.qvel[-1, 0]) / terminal - 1),
            "slip": abs(float(run.qvel[-1, 0] - 0.1 * run.qvel[-1, 4])),
        }

    return Scene(
        name="roll",
        title="rolling ball, terminal velocity",
        xml=mjcf(free_body("ball", ball, (0, 0, 0.1)), floor=f'friction="{friction}"'),
        duration=1.0,
        start=set_velocity("ball", (speed, 0, 0)),
        measure=measure,
        targets={"velocity error": 1e-5},
        units={"velocity error": "", "slip": "m/s"},
    )


def stack(
    *, masses: tuple[float, ...] = (1.0,) * 10, stiffness: float | None = 1e5, duration: float = 5.0
) -> Scene:
    """Stack cubes with `stiffness` per corner contact (None: rigid)."""
    half, count = 0.05, len(masses)
    bodies = "".join(
        free_body(
            f"box{i}",
            f'type="box" size="{half} {half} {half}" mass="{m}"',
            (0, 0, half * (2 * i + 1)),
        )
        for i, m in enumerate(masses)
    )
    names = ["floor", *(f"box{i}" for i in range(count))]
    pairs = {}
    if stiffness is not None:
        pairs = {(a, b): Material(stiffness) for a, b in itertools.pairwise(names)}
    # MuJoCo's is per inverse mass of the two bodies, and takes the larger of two geoms; critical.
    inverse = [1 / masses[0], *(1 / a + 1 / b for a, b in itertools.pairwise(masses))]
    inverse.insert(0, inverse[0])
    direct = [(-stiffness * w, -2 * (stiffness * w) ** 0.5) for w in inverse] if stiffness else None
    loads = GRAVITY * np.cumsum(masses[::-1])[::-1]
    sags = loads / (4 * stiffness) if stiffness is not None else np.zeros(count)

    def measure(run: Run) -> dict[str, float]:
        position = np.array([run.position(f"box{i}") for i in range(count)])
        rest = half * (2 * np.arange(count) + 1)
        tops = position[:, -1, 2]
        sag = np.diff(rest - tops, prepend=0.0)
        numbers = {
            "tilt": float(np.abs(position[:, :, :2]).max()),
            "bottom sag": float(sag[0]),
            "height loss": float((rest[-1] - position[-1, run.time > run.time[-1] - 1, 2]).max()),
            "speed": float(np.abs(run.qvel[-1]).max()),
        }
        if stiffness is not None:
            numbers["sag error"] = float(np.abs(sag / sags - 1).max())
        return numbers

    return Scene(
        name="stack" if stiffness is not None else "heavy-stack",
        title=f"{count} boxes, top mass {masses[-1]:g} kg",
        xml=mjcf(bodies),
        duration=duration,
        pair_materials=pairs,
        direct_solref=None if direct is None else np.array(direct),
        measure=measure,
        targets={"sag error": 5e-5, "tilt": 1e-4} if stiffness else {"tilt": 5e-3},
        units={"tilt": "m", "bottom sag": "m", "height loss": "m", "speed": "m/s"},
        sample_interval=0.05,
    )


def spin(*, rate: float = 10.0, duration: float = 60.0) -> Scene:
    """Spin an asymmetric box freely about nearly its middle axis; momentum and energy error."""
    angular = rate * np.array([0.05, 0.998, 0.04])
    box = 'type="box" size="0.05 0.1 0.15" mass="2"'

    def measure(run: Run) -> dict[str, float]:
        inertia = run.model.body_inertia[run.model.body("box").id]
        momentum, energy = [], []
        for quat, local in zip(run.qpos[:, 3:7], run.qvel[:, 3:6], strict=True):
            turned = np.zeros(3)
            mujoco.mju_rotVecQuat(turned, inertia * local, quat)
            momentum.append(turned)
            energy.append(0.5 * local @ (inertia * local))
        first = np.linalg.norm(momentum[0])
        drift = np.linalg.norm(np.array(momentum) - momentum[0], axis=1).max()
        return {
            "momentum error": float(drift / first),
            "energy error": float(np.abs(np.array(energy) / energy[0] - 1).max()),
        }

    return Scene(
        name="spin",
        title=f"free asymmetric box, {rate:g} rad/s, {duration:g} s",
        xml=mjcf(free_body("box", box, (0, 0, 0)))
        .replace(f"-{GRAVITY}", "0")
        .replace('<geom name="floor" type="plane" size="0 0 1" friction="1 0.005 0.0001"/>', ""),
        duration=duration,
        start=set_velocity("box", (0, 0, 0, *angular)),
        measure=measure,
        targets={"momentum error": 1e-9, "energy error": 1e-9},
        units={"momentum error": "", "energy error": ""},
        sample_interval=0.5,
        timesteps=(0.001,),
    )


def few_body() -> list[Scene]:
    """Return the single- and few-body scenes."""
    return [
        *(ball_drop(restitution=e) for e in (1.0, 0.9, 0.5)),
        slope(),
        slide(),
        rise(),
        wall_press(),
        gripper(),
        roll(),
        stack(),
        stack(masses=(1.0,) * 9 + (100.0,), stiffness=None),
        spin(),
    ]
