"""MetaWorld's 50 tasks, played by its scripted policies on MuJoCo's own steps and on dashpot's.

    pip install --no-deps metaworld        # its MuJoCo is 3.3; needs gymnasium and imageio
    python benchmarks/metaworld_tasks.py --seeds 10
    python benchmarks/metaworld_tasks.py --tasks reach-v3 hammer-v3

Seed i draws the task's i-th arrangement, and every way of stepping plays it for EPISODE steps of
the environment, of five time steps of 2.5 ms each. An episode succeeds where MetaWorld says so in
any step. A policy sees positions alone, and decides by thresholds on them.

Where successes differ two references play the same seeds, both with time steps a quarter as long
(and four times as many in a step of the environment): MuJoCo with `impratio` 100, which keeps what
sticks from creeping, and dashpot.

Time is that of a step of the environment, the least mean of an episode, played in turns. Overlap
is the deepest that any contact has after a step of the environment. The columns without a word
are MuJoCo's, then dashpot's.
"""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import dataclass

import mujoco
import numpy as np
from metaworld.env_dict import ALL_V3_ENVIRONMENTS
from metaworld.policies import ENV_POLICY_MAP

from dashpot.gymnasium import with_dashpot

EPISODE = 200
SHORTER = 4  # times, of the references


@dataclass(frozen=True)
class Episode:
    """What became of one."""

    success: bool
    total: float  # of rewards
    overlap: float  # m
    step: float  # s


class Player:
    """Plays a task on one way of stepping."""

    def __init__(self, task: str, env_class: type, *, shorter: int = 1, impratio: float = 1.0):
        self.env = env_class()
        self.policy = ENV_POLICY_MAP[task]()
        self.episodes: list[Episode] = []
        self.env.model.opt.impratio = impratio
        self.env.model.opt.timestep /= shorter
        self.env.frame_skip *= shorter
        # As MetaWorld's classes of environments whose goal is observed.
        self.env._partially_observable = False
        self.env._freeze_rand_vec = False
        self.env._set_task_called = True
        vars(self.env).pop("sawyer_observation_space", None)

    def play(self, seed: int) -> None:
        """Play an episode."""
        np.random.seed(seed)  # noqa: NPY002 - MetaWorld draws from it
        observation, _ = self.env.reset()
        success, total, overlap, spent = False, 0.0, 0.0, 0.0
        for _ in range(EPISODE):
            action = np.clip(self.policy.get_action(observation), -1.0, 1.0)
            before = time.perf_counter()
            observation, reward, *_, info = self.env.step(action)
            spent += time.perf_counter() - before
            success = success or info["success"] > 0.0
            total += reward
            overlap = max(overlap, float(np.max(-self.env.data.contact.dist, initial=0.0)))
        self.episodes.append(Episode(success, total, overlap, spent / EPISODE))

    def successes(self) -> int:
        """Return the number of episodes that succeeded."""
        return sum(episode.success for episode in self.episodes)


def on_mujoco(task: str) -> type:
    """Return MetaWorld's class, whose own way to reset welds MuJoCo 3.17 refuses."""

    class OnMuJoCo(ALL_V3_ENVIRONMENTS[task]):
        def reset_mocap_welds(self) -> None:
            welds = self.model.eq_type == mujoco.mjtEq.mjEQ_WELD
            self.model.eq_data[welds, :11] = [0.0] * 6 + [-1.0, 0.0, 0.0, 0.0, 5.0]

    return OnMuJoCo


def row(task: str, seeds: int) -> tuple[str, int, int]:
    """Play a task and return its row of the table, and the successes of both."""
    plain, ours = on_mujoco(task), with_dashpot(ALL_V3_ENVIRONMENTS[task])
    players = Player(task, plain), Player(task, ours)
    for seed in range(seeds):
        for player in players:
            player.play(seed)
    won = [player.successes() for player in players]
    returns = [np.mean([e.total for e in player.episodes]) for player in players]
    overlaps = [1e3 * max(e.overlap for e in player.episodes) for player in players]
    least = [min(e.step for e in player.episodes) for player in players]
    references = ""
    if won[0] != won[1]:
        short = (
            Player(task, plain, shorter=SHORTER, impratio=100.0),
            Player(task, ours, shorter=SHORTER),
        )
        for player in short:
            for seed in range(seeds):
                player.play(seed)
        references = ", ".join(str(player.successes()) for player in short)
    return (
        f"| {task.removesuffix('-v3')} | {won[0]}, {won[1]} | {references} | "
        f"{returns[0]:.0f}, {returns[1]:.0f} | {least[1] / least[0]:.1f} | "
        f"{overlaps[0]:.1f}, {overlaps[1]:.1f} |",
        won[0],
        won[1],
    )


def main() -> None:
    """Print one row per task."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--tasks", nargs="+", default=list(ALL_V3_ENVIRONMENTS))
    arguments = parser.parse_args()
    warnings.filterwarnings("ignore", message="Constant")  # of policies about their gains
    print(
        f"| task | successes of {arguments.seeds} | references | return | times as long | "
        "overlap mm |"
    )
    print("|---|---|---|---|---|---|")
    won = np.zeros(2, int)
    for task in arguments.tasks:
        text, *both = row(task, arguments.seeds)
        won += both
        print(text, flush=True)
    played = arguments.seeds * len(arguments.tasks)
    print(f"Of {played} episodes {won[0]} succeed on MuJoCo, {won[1]} on dashpot.")


if __name__ == "__main__":
    main()
