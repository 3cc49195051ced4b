"""dm_control's tasks with its own steps of MuJoCo and with dashpot's.

    python benchmarks/dm_control_tasks.py [suite] [manipulation] [locomotion] [aloha]

Needs dm_control, and gym-aloha for the last. The same random actions for both, but for gym-aloha,
where they are targets within 0.1 rad of its arms' first pose. The two take turns in chunks of
environment steps, of which the least process time counts; nothing is rendered. Overlap (beyond the
model's margin) is the deepest of a step's contacts, the median of the steps with any.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from dm_control import composer, manipulation, suite
from dm_control.composer.observation.observable import MJCFCamera
from dm_env import specs

from dashpot.dm_control import with_dashpot

CHUNK, CHUNKS = 20, 10
Load = Callable[[], Any]


def suite_tasks() -> Iterator[tuple[str, Load]]:
    for domain, task in suite.ALL_TASKS:

        def load(domain: str = domain, task: str = task) -> Any:
            return suite.load(domain, task, task_kwargs={"random": 0})

        yield f"{domain} {task}", load


def manipulation_tasks() -> Iterator[tuple[str, Load]]:
    # The others are the same tasks, observed by cameras.
    for name in manipulation.get_environments_by_tag("features"):
        yield name.removesuffix("_features"), lambda name=name: manipulation.load(name, seed=0)


def locomotion_tasks() -> Iterator[tuple[str, Load]]:
    from dm_control.locomotion.examples import basic_cmu_2019, basic_rodent_2020

    for module, prefix in ((basic_cmu_2019, "cmu_humanoid_"), (basic_rodent_2020, "rodent_")):
        for name in sorted(vars(module)):
            if name.startswith(prefix):
                make = getattr(module, name)
                yield name, lambda make=make: blind(make(random_state=np.random.RandomState(0)))


def aloha_tasks() -> Iterator[tuple[str, Load]]:
    from gym_aloha.constants import START_ARM_POSE
    from gym_aloha.env import AlohaEnv
    from gym_aloha.tasks import sim
    from gym_aloha.utils import sample_box_pose, sample_insertion_pose

    arms, hand = np.full(6, 0.1), 0.5
    middle = np.r_[START_ARM_POSE[:6], hand, START_ARM_POSE[8:14], hand]
    reach = np.r_[arms, hand, arms, hand]
    boxes = {
        "transfer_cube": sample_box_pose(0),
        "insertion": np.concatenate(sample_insertion_pose(0)),
    }

    def load(task: str) -> Any:
        sim.BOX_POSE[0] = boxes[task]
        env = AlohaEnv(task)._env
        env.task.get_observation = lambda physics: {"qpos": physics.data.qpos.copy()}
        targets = specs.BoundedArray(middle.shape, float, middle - reach, middle + reach)
        env.action_spec = lambda: targets
        return env

    for task in boxes:
        yield f"gym_aloha {task}", lambda task=task: load(task)


def blind(env: composer.Environment) -> composer.Environment:
    """Leave out what an environment's task observes by cameras."""
    for observable in env.task.observables.values():
        if isinstance(observable, MJCFCamera):
            observable.enabled = False
    return env


class Player:
    """Plays random episodes of one environment and keeps its figures."""

    def __init__(self, env: Any):
        self.env = env
        self.rng = np.random.default_rng(0)
        self.env.reset()
        self.least = np.inf
        self.reward = 0.0
        self.overlap: list[float] = []

    def play(self) -> None:
        """Play a chunk."""
        space = self.env.action_spec()
        low, high = np.maximum(space.minimum, -10.0), np.minimum(space.maximum, 10.0)
        spent = 0.0
        for _ in range(CHUNK):
            action = self.rng.uniform(low, high)
            before = time.process_time()
            timestep = self.env.step(action)
            spent += time.process_time() - before
            for observed in timestep.observation.values():
                assert np.isfinite(observed).all()
            self.reward += (timestep.reward or 0.0) / (CHUNK * CHUNKS)
            contact = self.env.physics.data.ptr.contact
            acts = contact.exclude == 0
            overlap = np.max((contact.includemargin - contact.dist)[acts], initial=0.0)
            if overlap > 0.0:
                self.overlap.append(overlap)
            if timestep.last():
                self.env.reset()
        self.least = min(self.least, spent / CHUNK)


def depth(player: Player) -> str:
    """Return the median overlap in mm."""
    return f"{1e3 * np.median(player.overlap):.2g}" if player.overlap else "-"


def main() -> None:
    """Print one row per task."""
    tasks = {
        "suite": suite_tasks,
        "manipulation": manipulation_tasks,
        "locomotion": locomotion_tasks,
        "aloha": aloha_tasks,
    }
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", help=f"of {', '.join(tasks)}; all by default")
    kinds = parser.parse_args().kinds
    if unknown := set(kinds) - set(tasks):
        parser.error(f"no such kind: {', '.join(sorted(unknown))}")
    print("| task | step us: dashpot, own | times as long | overlap mm | reward |")
    print("|---|---|---|---|---|")
    for kind in kinds or tasks:
        for name, load in tasks[kind]():
            ours, theirs = Player(with_dashpot(load())), Player(load())
            for _ in range(CHUNKS):
                ours.play()
                theirs.play()
            print(
                f"| {name} | {1e6 * ours.least:.0f}, {1e6 * theirs.least:.0f} | "
                f"{ours.least / theirs.least:.2f} | {depth(ours)}, {depth(theirs)} | "
                f"{ours.reward:.3f}, {theirs.reward:.3f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
