"""The benchmark bicycle and its modes.

    python benchmarks/bicycle.py

A bicycle that nobody steers balances itself at 5 m/s: lean and steer swing in the weave mode, fall
by capsize and straighten by castering. Meijaard, Papadopoulos, Ruina and Schwab (Proc. R. Soc. A
463, 2007) give the linear equations of motion of a bicycle on knife-edge wheels that do not slip,

    M q'' + v C1 q' + (g K0 + v^2 K2) q = 0,   q = (lean, steer).

Their eigenvalues stand beside those of powers of `dashpot.linearize(...).A` and of MuJoCo's
`mjd_transitionFD`, with its defaults and with solref and cone at their stiffest.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

import dashpot
from no_arguments import takes_no_arguments
from scene import GRAVITY, Array, Run, Scene
from simulate import DASHPOT, SETTINGS, Setting, make_engine, prepare

Modes = NDArray[np.complex128]

# The coefficients that the paper gives for its benchmark bicycle, SI units.
M = np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]])
C1 = np.array([[0.0, 33.86641391492494], [-0.85035641456978, 1.68540397397560]])
K0 = np.array([[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]])
K2 = np.array([[0.0, 76.59734589573222], [0.0, 2.65431523794604]])

WHEELS = ("rear wheel", "front wheel")
SETTLED = 0.1  # s after which the wheels have sunk in
PUSH = 0.02  # rad/s of lean
FLOW = 0.02  # s over which modes of a motion are fitted: whole steps of 1, 2 and 5 ms


def published_modes(speed: float) -> Modes:
    """Return the four eigenvalues (1/s) of the published equations at `speed` (m/s)."""
    stiffness, damping = GRAVITY * K0 + speed**2 * K2, speed * C1
    lower = np.hstack([-np.linalg.solve(M, stiffness), -np.linalg.solve(M, damping)])
    return np.linalg.eigvals(np.vstack([np.eye(2, 4, 2), lower])).astype(complex)


def modes_of_motion(angles: Array, timestep: float) -> Modes:
    """Return the four modes (1/s) of the linear flow that fits lean and steer (steps, 2) best.

    Over `FLOW`, with rates by central differences.
    """
    rates = np.gradient(angles, timestep, axis=0)
    state = np.hstack([angles, rates])[1:-1]
    steps = round(FLOW / timestep)
    flow = np.linalg.lstsq(state[:-steps], state[steps:], rcond=None)[0].T
    return np.log(np.linalg.eigvals(flow).astype(complex)) / (steps * timestep)


def modes_of_step(setting: Setting, speed: float, timestep: float) -> Modes:
    """Return the four modes (1/s) nearest the published ones among those of one step's derivative.

    The others are the bicycle's place and heading, which nothing restores, and what contact damps.
    """
    scene, steps = bicycle(speed=speed), round(SETTLED / timestep)
    if setting.dashpot:
        engine = make_engine(scene, scene.model(timestep))
        data = engine.make_data()
        scene.start(engine.model, data)
        engine.step(data, nstep=steps)
        transition = dashpot.linearize(engine, data).A
    else:
        model, data, advance = prepare(scene, setting, timestep)
        advance(steps)
        transition = np.zeros((2 * model.nv, 2 * model.nv))
        mujoco.mjd_transitionFD(model, data, 1e-6, 1, transition, None, None, None)
    modes = np.log(np.linalg.eigvals(transition).astype(complex)) / timestep
    return modes[matching(modes, published_modes(speed))]


def matching(modes: Modes, published: Modes) -> NDArray[np.intp]:
    """Return which of `modes` is which published one, by the least sum of distances."""
    return linear_sum_assignment(np.abs(published[:, None] - modes))[1]


def bicycle(*, speed: float = 5.0) -> Scene:
    """Push a bicycle that nobody steers; largest errors of its modes, in parts of each."""
    published = published_modes(speed)

    def roll(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qvel[0] = speed
        for wheel in WHEELS:
            data.qvel[model.joint(wheel).dofadr[0]] = speed / model.geom(wheel).size[0]

    def push(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qvel[3] += PUSH

    def measure(run: Run) -> dict[str, float]:
        timestep = run.model.opt.timestep
        moving = slice(run.at(SETTLED), None)
        w, x, y, z = run.qpos[moving, 3:7].T
        lean = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        steer = run.qpos[moving, run.model.joint("steer").qposadr[0]]
        modes = modes_of_motion(np.stack([lean, steer], axis=1), timestep)
        errors = np.abs(modes[matching(modes, published)] / published - 1)
        return {"mode error": float(errors.max())}

    return Scene(
        name="bicycle",
        title=f"bicycle at {speed:g} m/s, errors of weave, capsize and castering",
        xml=Path(__file__).with_name("bicycle.xml").read_text(),
        duration=SETTLED + 3.0,
        start=roll,
        kick=push,
        kick_time=SETTLED,
        measure=measure,
        targets={"mode error": 0.01},
        units={"mode error": ""},
        timesteps=(0.001, 0.002, 0.005),
    )


def written(modes: Modes) -> str:
    """Return modes as text, the fastest first, a pair once."""
    once = sorted(modes[modes.imag > -1e-6], key=lambda mode: mode.real)
    return ", ".join(
        f"{m.real:.3f}" + (f" +- {m.imag:.3f} i" if m.imag > 1e-6 else "") for m in once
    )


def main() -> None:
    """Print one line a way of stepping."""
    takes_no_arguments(__doc__)
    settings = (DASHPOT, SETTINGS["mujoco default"], SETTINGS["mujoco stiff"])
    for speed in (1.0, 3.0, 5.0, 8.0):
        print(f"{speed:g} m/s, published: {written(published_modes(speed))} 1/s")
        for timestep in (0.001, 0.005):
            for setting in settings:
                modes = modes_of_step(setting, speed, timestep)
                print(f"  {1e3 * timestep:g} ms {setting.name:14} {written(modes)}")


if __name__ == "__main__":
    main()
