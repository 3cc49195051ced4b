"""A rattleback, which turns round when it is spun the wrong way, against its equations of motion.

An ellipsoid rolls without slip on a plane, and its principal axes of inertia are turned by a small
angle from those of its shape. One way round, spin feeds rocking, which stops the spin and drives it
the other way. In the frame of the body, with the upward normal n, the arm r from the centre to the
point of contact, and semi-axes a,

    r = -(a^2 n) / |a n|,   v = -omega x r,   n' = n x omega,
    I omega' + omega x I omega = r x F,   F = m (v' + omega x v + g n).
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.integrate import solve_ivp

from scene import GRAVITY, Array, Run, Scene, mjcf, set_velocity

MASS = 0.1
SEMI_AXES = np.array([0.1, 0.02, 0.015])  # m
SKEW = np.radians(3.0)  # of the axes of inertia about the vertical
ROCKING = 0.05  # rad/s about both horizontal axes, at the start


def inertia() -> Array:
    """Return the inertia of the solid ellipsoid (kg m^2), turned by the skew."""
    x, y, z = SEMI_AXES**2
    c, s = np.cos(SKEW), np.sin(SKEW)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return turn @ np.diag([y + z, x + z, x + y]) @ turn.T * MASS / 5


def cross_matrix(r: Array) -> Array:
    return np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])


@cache
def exact_spin(spin: float, time: float) -> float:
    """Return the spin about the vertical (rad/s) `time` (s) after it was `spin`."""
    moments, squares = inertia(), SEMI_AXES**2

    def rates(_: float, state: Array) -> Array:
        omega, normal = state[:3], state[3:]
        turning = np.cross(normal, omega)
        length = np.sqrt(squares @ normal**2)
        stretching = squares @ (normal * turning) / length
        arm = -squares * normal / length
        arm_rate = -squares * turning / length + squares * normal * stretching / length**2
        velocity = -np.cross(omega, arm)
        # Of v' the part with omega' goes to the left side, as the inertia about the contact.
        force = MASS * (-np.cross(omega, arm_rate) + np.cross(omega, velocity) + GRAVITY * normal)
        torque = np.cross(arm, force) - np.cross(omega, moments @ omega)
        about_contact = moments - MASS * cross_matrix(arm) @ cross_matrix(arm)
        return np.concatenate([np.linalg.solve(about_contact, torque), turning])

    start = np.array([ROCKING, ROCKING, spin, 0.0, 0.0, 1.0])
    end = solve_ivp(rates, (0.0, time), start, method="DOP853", rtol=1e-9, atol=1e-11).y[:, -1]
    return float(end[:3] @ end[3:])


def rattleback(*, spin: float = -5.0, duration: float = 6.0) -> Scene:
    """Spin a rattleback the wrong way; error of its spin after it has turned round, in parts."""
    moments = inertia()

    def measure(run: Run) -> dict[str, float]:
        w, x, y, z = run.qpos[-1, 3:7]
        vertical = np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
        end = float(vertical @ run.qvel[-1, 3:6])
        return {"spin error": abs(end / exact_spin(spin, duration) - 1)}

    size = " ".join(str(a) for a in SEMI_AXES)
    full = f"{moments[0, 0]} {moments[1, 1]} {moments[2, 2]} {moments[0, 1]} 0 0"
    body = f"""<body name="rattleback" pos="0 0 {SEMI_AXES[2]}"><freejoint/>
      <inertial pos="0 0 0" mass="{MASS}" fullinertia="{full}"/>
      <geom type="ellipsoid" size="{size}" friction="1 0 0"/></body>"""
    omega = np.array([ROCKING, ROCKING, spin])
    velocity = np.cross(omega, [0.0, 0.0, SEMI_AXES[2]])  # so that the lowest point rests
    return Scene(
        name="rattleback",
        title=f"rattleback spun at {spin:g} rad/s, spin after {duration:g} s",
        xml=mjcf(body, floor='friction="1 0 0"'),
        duration=duration,
        start=set_velocity("rattleback", (*velocity, *omega)),
        measure=measure,
        targets={"spin error": 0.01},
        timesteps=(0.001, 0.002, 0.005),
    )
