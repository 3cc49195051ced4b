"""MyoSuite's environments with their own steps and with dashpot's.

    pip install --no-deps myosuite==3.0.0 myo-sim==0.2.3    # and what they import
    python benchmarks/myosuite_envs.py

As gymnasium_envs.py.
"""

from __future__ import annotations

import gymnasium
import myosuite  # registers the environments

import dashpot
from gymnasium_envs import CHUNKS, Player, depth
from no_arguments import takes_no_arguments

ENVIRONMENTS = (
    "myoHandPoseRandom-v0",
    "myoHandPenTwirlRandom-v0",
    "myoHandObjHoldRandom-v0",
    "myoHandKeyTurnRandom-v0",
    "myoHandReorient100-v0",
    "myoLegWalk-v0",
    "myoChallengeBaodingP1-v1",
    "myoChallengeDieReorientP1-v0",
    "myoChallengeRelocateP1-v0",
)


def main() -> None:
    """Print one row per environment."""
    takes_no_arguments(__doc__)
    print(f"MyoSuite {myosuite.__version__}")
    print("| environment | step us: dashpot, own | times as long | overlap mm | reward |")
    print("|---|---|---|---|---|")
    for name in ENVIRONMENTS:
        ours = Player(lambda name=name: dashpot.myosuite.make(name).unwrapped)
        theirs = Player(lambda name=name: gymnasium.make(name).unwrapped)
        for _ in range(CHUNKS):
            ours.play()
            theirs.play()
        print(
            f"| {name} | {1e6 * ours.least:.0f}, {1e6 * theirs.least:.0f} | "
            f"{ours.least / theirs.least:.2f} | {depth(ours)}, {depth(theirs)} | "
            f"{ours.reward:.2f}, {theirs.reward:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
