"""robosuite's environments with their own steps and with dashpot's.

    pip install robosuite
    python benchmarks/robosuite_tasks.py            # tasks, then random actions
    python benchmarks/robosuite_tasks.py --only tasks

Tasks are done by scripts that know poses, with robosuite's default controllers at 20 Hz and time
steps of 2 ms; both ways of stepping have the same script and the same seeds. Slip is how far what
is held moves in the frame of the hand, or what was put down in that of what it stands on, in the
last seconds, in which nothing should. Overlap is the deepest of a step within 3 m of the robot, for
robosuite leaves objects that a task does not use 10 m away. In random actions the two take turns
in chunks of environment steps, of which the least time counts; it is that of robosuite's
controllers, too.
"""

from __future__ import annotations

import argparse
import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import robosuite
from robosuite.utils.transform_utils import mat2quat, quat2axisangle

from dashpot.robosuite import with_dashpot

STEP_METRES, STEP_RADIANS = 0.05, 0.5  # what the largest action moves the hand by
OPEN, CLOSED = -1.0, 1.0
TASKS = ("Lift", "Stack", "PickPlaceCan", "NutAssemblySquare", "Door")
SEEDS = range(5)
CHUNK, CHUNKS = 10, 10
Actions = Iterator[np.ndarray]


def make(name: str, *, dashpot: bool, **options: Any) -> Any:
    """Make an environment with low-dimensional observations."""
    with_dashpot(name)
    robots = ["Panda", "Panda"] if name.startswith("TwoArm") else "Panda"
    return robosuite.make(
        f"{name}WithDashpot" if dashpot else name,
        robots=robots,
        has_offscreen_renderer=False,
        use_camera_obs=False,
        ignore_done=True,
        **options,
    )


def up(height: float) -> np.ndarray:
    """Return a way upwards."""
    return np.array([0.0, 0.0, height])


class Hand:
    """Moves the hand of an environment's first robot."""

    def __init__(self, env: Any):
        self.env = env
        self.site = env.robots[0].eef_site_id["right"]

    @property
    def position(self) -> np.ndarray:
        """Where the fingers meet, m."""
        return self.env.sim.data.site_xpos[self.site].copy()

    @property
    def frame(self) -> np.ndarray:
        """Axes in columns: the fingers open along the second, the hand points along the third."""
        return self.env.sim.data.site_xmat[self.site].reshape(3, 3).copy()

    def down(self, across: np.ndarray) -> np.ndarray:
        """Return the frame of a hand that points down and closes along `across`, the nearer way."""
        opening = np.array([across[0], across[1], 0.0]) / np.hypot(*across[:2])
        opening *= np.sign(opening @ self.frame[:, 1]) or 1.0
        down = np.array([0.0, 0.0, -1.0])
        return np.column_stack([np.cross(opening, down), opening, down])

    def go(
        self, target: Callable[[], np.ndarray], frame: np.ndarray, fingers: float, steps: int
    ) -> Actions:
        """Go to a target, asked for in every step, for a number of control steps."""
        for _ in range(steps):
            turn = quat2axisangle(mat2quat(frame @ self.frame.T))
            yield np.concatenate(
                [
                    np.clip((target() - self.position) / STEP_METRES, -1.0, 1.0),
                    np.clip(turn / STEP_RADIANS, -1.0, 1.0),
                    [fingers],
                ]
            )


@dataclass
class Script:
    """What is done in a task, and what is watched in its last seconds."""

    actions: Actions
    watched: Callable[[], np.ndarray]
    seconds: float


def body(env: Any, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return position and axes of a body."""
    return env.sim.data.get_body_xpos(name).copy(), env.sim.data.get_body_xmat(name).copy()


def nearest_axis(axes: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return the horizontal axis of a box that a hand has the least to turn for."""
    flat = axes[:, np.argsort(np.abs(axes[2]))[:2]]
    return flat[:, np.argmax(np.abs(direction @ flat))]


def grasp(hand: Hand, place: np.ndarray, across: np.ndarray) -> Actions:
    """Come from above and close."""
    frame = hand.down(across)
    yield from hand.go(lambda: place + up(0.1), frame, OPEN, 50)
    yield from hand.go(lambda: place, frame, OPEN, 25)
    yield from hand.go(lambda: place, frame, CLOSED, 15)


def lift(env: Any) -> Script:
    """Grasp the cube, lift it by 10 cm and hold it for 5 s."""
    hand = Hand(env)
    place, axes = body(env, "cube_main")

    def actions() -> Actions:
        yield from grasp(hand, place, nearest_axis(axes, hand.frame[:, 1]))
        frame, above = hand.frame, hand.position + up(0.1)
        yield from hand.go(lambda: above, frame, CLOSED, 130)

    def watched() -> np.ndarray:
        return hand.frame.T @ (body(env, "cube_main")[0] - hand.position)

    return Script(actions(), watched, 5.0)


def stack(env: Any) -> Script:
    """Put cube A on cube B, let go and wait for 5 s."""
    hand = Hand(env)
    place, axes = body(env, "cubeA_main")

    def actions() -> Actions:
        yield from grasp(hand, place, nearest_axis(axes, hand.frame[:, 1]))
        frame, above = hand.frame, hand.position + up(0.12)
        yield from hand.go(lambda: above, frame, CLOSED, 25)

        def over(height: float) -> np.ndarray:
            # What is held follows the hand: the hand goes by how far cube A is from its place.
            off = body(env, "cubeB_main")[0] - body(env, "cubeA_main")[0]
            return hand.position + off + up(height)

        yield from hand.go(lambda: over(0.1), frame, CLOSED, 40)
        yield from hand.go(lambda: over(0.0455), frame, CLOSED, 30)
        there = hand.position
        yield from hand.go(lambda: there, frame, OPEN, 10)
        yield from hand.go(lambda: there + up(0.15), frame, OPEN, 130)

    return Script(actions(), lambda: body(env, "cubeA_main")[0] - body(env, "cubeB_main")[0], 5.0)


def can(env: Any) -> Script:
    """Put the can into its bin, let go and wait for 2 s."""
    hand = Hand(env)
    place, _ = body(env, "Can_main")
    bin_ = env.target_bin_placements[env.object_to_id["can"]]

    def actions() -> Actions:
        yield from grasp(hand, place + up(0.02), hand.frame[:, 1])
        frame, above = hand.frame, hand.position + up(0.2)
        yield from hand.go(lambda: above, frame, CLOSED, 30)
        over = np.array([bin_[0], bin_[1], above[2]])
        yield from hand.go(lambda: over, frame, CLOSED, 60)
        low = np.array([bin_[0], bin_[1], place[2] + 0.03])
        yield from hand.go(lambda: low, frame, CLOSED, 30)
        yield from hand.go(lambda: low, frame, OPEN, 10)
        yield from hand.go(lambda: over, frame, OPEN, 70)

    return Script(actions(), lambda: body(env, "Can_main")[0], 2.0)


def nut(env: Any) -> Script:
    """Put the square nut on its peg, let go and wait for 2 s."""
    hand = Hand(env)
    name = next(nut.name for nut in env.nuts if nut.name.startswith("SquareNut"))
    middle = f"{name}_main"

    def handle() -> np.ndarray:
        site = env.sim.model.site_name2id(f"{name}_handle_site")
        return env.sim.data.site_xpos[site].copy()

    peg, peg_axes = body(env, "peg1")

    def actions() -> Actions:
        here = hand.position
        yield from hand.go(lambda: here, hand.frame, OPEN, 20)  # the nut falls on the table
        yield from grasp(hand, handle(), body(env, middle)[1][:, 1])
        above = hand.position + up(0.2)
        yield from hand.go(lambda: above, hand.frame, CLOSED, 30)
        axes = body(env, middle)[1]
        square = nearest_axis(peg_axes, axes[:, 0])
        square = square * np.sign(square @ axes[:, 0])
        turn = np.arctan2(np.cross(axes[:, 0], square)[2], axes[:, 0] @ square)
        frame = about_vertical(turn) @ hand.frame

        def over(height: float) -> np.ndarray:
            wanted = peg + up(height)
            return hand.position + wanted - body(env, middle)[0]

        yield from hand.go(lambda: over(0.17), frame, CLOSED, 60)
        yield from hand.go(lambda: over(0.0), frame, CLOSED, 40)
        there = hand.position
        yield from hand.go(lambda: there, frame, OPEN, 10)
        yield from hand.go(lambda: there + up(0.2), frame, OPEN, 70)

    return Script(actions(), lambda: body(env, middle)[0] - peg, 2.0)


def door(env: Any) -> Script:
    """Grasp the handle from above, pull the door open about its hinge and hold it for 2 s."""
    hand = Hand(env)

    def handle() -> np.ndarray:
        return env.sim.data.site_xpos[env.door_handle_site_id].copy()

    def actions() -> Actions:
        place, axes = handle(), body(env, "Door_door")[1]
        outward = -axes[:, 1]
        grip = place + up(0.005) + 0.03 * axes[:, 0]
        yield from hand.go(lambda: grip + up(0.15), hand.down(outward), OPEN, 30)
        yield from grasp(hand, grip, outward)
        frame, start = hand.frame, hand.position
        hinge = env.sim.data.xanchor[env.sim.model.joint_name2id("Door_hinge")].copy()
        for angle in np.linspace(0.0, 0.38, 80):
            swing = about_vertical(angle)
            swung = hinge + swing @ (start - hinge)
            yield from hand.go(lambda at=swung: at, swing @ frame, CLOSED, 1)
        yield from hand.go(lambda: swung, swing @ frame, CLOSED, 60)

    return Script(actions(), lambda: hand.frame.T @ (handle() - hand.position), 2.0)


def about_vertical(angle: float) -> np.ndarray:
    """Return a rotation about the vertical."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


SCRIPTS = dict(zip(TASKS, (lift, stack, can, nut, door), strict=True))


@dataclass
class Outcome:
    """What came of a script."""

    success: bool
    slip: float  # m
    overlap: list[float] = field(default_factory=list)  # m
    millis: float = np.inf  # per environment step, the least


def deepest(env: Any) -> float:
    """Return the deepest overlap, m, of what is near the robot: unused objects lie 10 m away."""
    contact = env.sim.data.contact
    near = np.abs(contact.pos).max(axis=1, initial=0.0) < 3.0
    return float(np.max((contact.includemargin - contact.dist)[near], initial=0.0))


def perform(env: Any, script: Script) -> Outcome:
    """Do a task to its end."""
    outcome = Outcome(success=False, slip=0.0)
    seen = []
    for action in script.actions:
        before = time.perf_counter()
        observed, *_ = env.step(action)
        outcome.millis = min(outcome.millis, 1e3 * (time.perf_counter() - before))
        assert all(np.isfinite(value).all() for value in observed.values())
        outcome.overlap.append(deepest(env))
        seen.append(script.watched())
    last = np.array(seen[-round(script.seconds * env.control_freq) :])
    outcome.slip = float(np.linalg.norm(last - last[0], axis=1).max())
    outcome.success = bool(env._check_success())
    return outcome


def do_tasks() -> None:
    """Print one row per task."""
    print("| task | done: dashpot, own | slip mm | overlap mm, median | step ms, times as long |")
    print("|---|---|---|---|---|")
    for name in TASKS:
        options = {"use_latch": False} if name == "Door" else {}
        by_way: list[list[Outcome]] = [[], []]
        for seed in SEEDS:
            for way, outcomes in zip((True, False), by_way, strict=True):
                env = make(name, dashpot=way, seed=seed, **options)
                env.reset()
                outcomes.append(perform(env, SCRIPTS[name](env)))
                env.close()
        ours, theirs = by_way
        print(
            f"| {name} | {sum(o.success for o in ours)}, {sum(o.success for o in theirs)} of "
            f"{len(SEEDS)} | {median_slip(ours)}, {median_slip(theirs)} | "
            f"{depth(ours)}, {depth(theirs)} | {speed(ours, theirs)} |",
            flush=True,
        )


def median_slip(outcomes: list[Outcome]) -> str:
    return f"{1e3 * np.median([outcome.slip for outcome in outcomes]):.2g}"


def depth(outcomes: list[Outcome]) -> str:
    return f"{1e3 * np.median([d for o in outcomes for d in o.overlap if d > 0.0]):.2g}"


def speed(ours: list[Outcome], theirs: list[Outcome]) -> str:
    mine, yours = (min(outcome.millis for outcome in way) for way in (ours, theirs))
    return f"{mine:.1f}, {yours:.1f}, {mine / yours:.2f}"


class Player:
    """Plays random actions in one environment and keeps its figures."""

    def __init__(self, name: str, *, dashpot: bool):
        self.env = make(name, dashpot=dashpot, seed=0)
        self.rng = np.random.default_rng(0)
        self.env.reset()
        self.least = np.inf
        self.overlap: list[float] = []

    def play(self) -> None:
        """Play a chunk."""
        spent = 0.0
        for _ in range(CHUNK):
            action = self.rng.uniform(*self.env.action_spec)
            before = time.perf_counter()
            observed, reward, *_ = self.env.step(action)
            spent += time.perf_counter() - before
            assert np.isfinite(reward)
            assert all(np.isfinite(value).all() for value in observed.values())
            self.overlap.append(deepest(self.env))
        self.least = min(self.least, 1e3 * spent / CHUNK)


def play_all() -> None:
    """Print one row per environment."""
    print("| environment | step ms: dashpot, own | times as long | overlap mm | deepest mm |")
    print("|---|---|---|---|---|")
    for name in [name for name in robosuite.ALL_ENVIRONMENTS if "WithDashpot" not in name]:
        ours, theirs = Player(name, dashpot=True), Player(name, dashpot=False)
        for _ in range(CHUNKS):
            ours.play()
            theirs.play()
        middle = [
            f"{1e3 * np.median(touching):.2g}" if touching else "-"
            for touching in ([d for d in way.overlap if d > 0.0] for way in (ours, theirs))
        ]
        deepest_of_all = [f"{1e3 * max(way.overlap):.2g}" for way in (ours, theirs)]
        print(
            f"| {name} | {ours.least:.1f}, {theirs.least:.1f} | {ours.least / theirs.least:.2f} | "
            f"{', '.join(middle)} | {', '.join(deepest_of_all)} |",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=("tasks", "random"), help="one of the two tables")
    only = parser.parse_args().only
    logging.getLogger("robosuite_logs").setLevel(logging.ERROR)
    if only != "random":
        do_tasks()
    if only != "tasks":
        play_all()


if __name__ == "__main__":
    main()
