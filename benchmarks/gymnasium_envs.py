"""Gymnasium's MuJoCo environments with their own steps and with dashpot's.

    python benchmarks/gymnasium_envs.py    # needs gymnasium and imageio

The same random actions for both; an episode that ends is begun anew. The two take turns in chunks
of environment steps, of which the least time counts. Overlap (beyond the model's margin) is the
deepest of a step's contacts, the median of the steps with any.
"""

from __future__ import annotations

import importlib
import time

import numpy as np

from dashpot.gymnasium import with_dashpot
from no_arguments import takes_no_arguments

ENVIRONMENTS = {
    "ant": "AntEnv",
    "half_cheetah": "HalfCheetahEnv",
    "hopper": "HopperEnv",
    "humanoid": "HumanoidEnv",
    "humanoidstandup": "HumanoidStandupEnv",
    "inverted_double_pendulum": "InvertedDoublePendulumEnv",
    "inverted_pendulum": "InvertedPendulumEnv",
    "pusher": "PusherEnv",
    "reacher": "ReacherEnv",
    "swimmer": "SwimmerEnv",
    "walker2d": "Walker2dEnv",
}
CHUNK, CHUNKS = 50, 12


class Player:
    """Plays random episodes of one environment and keeps its figures."""

    def __init__(self, env_class: type):
        self.env = env_class()
        self.rng = np.random.default_rng(0)
        self.env.reset(seed=0)
        self.least = np.inf
        self.reward = 0.0
        self.overlap: list[float] = []

    def play(self) -> None:
        """Play a chunk."""
        space = self.env.action_space
        spent = 0.0
        for _ in range(CHUNK):
            action = self.rng.uniform(space.low, space.high)
            before = time.perf_counter()
            observation, reward, terminated, *_ = self.env.step(action)
            spent += time.perf_counter() - before
            assert np.isfinite(observation).all()
            self.reward += reward / (CHUNK * CHUNKS)
            contact = self.env.data.contact
            overlap = np.max(contact.includemargin - contact.dist, initial=0.0)
            if overlap > 0.0:
                self.overlap.append(overlap)
            if terminated:
                self.env.reset()
        self.least = min(self.least, spent / CHUNK)


def depth(player: Player) -> str:
    """Return the median overlap in mm."""
    return f"{1e3 * np.median(player.overlap):.2g}" if player.overlap else "-"


def main() -> None:
    """Print one row per environment."""
    takes_no_arguments(__doc__)
    print("| environment | step us: dashpot, own | times as long | overlap mm | reward |")
    print("|---|---|---|---|---|")
    for module, name in ENVIRONMENTS.items():
        env_class = getattr(importlib.import_module(f"gymnasium.envs.mujoco.{module}_v5"), name)
        ours, theirs = Player(with_dashpot(env_class)), Player(env_class)
        for _ in range(CHUNKS):
            ours.play()
            theirs.play()
        print(
            f"| {name[:-3]} | {1e6 * ours.least:.0f}, {1e6 * theirs.least:.0f} | "
            f"{ours.least / theirs.least:.2f} | {depth(ours)}, {depth(theirs)} | "
            f"{ours.reward:.2f}, {theirs.reward:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
