"""How far the speed in settled bins depends on how the bodies happened to settle.

    python benchmarks/bin_seeds.py

The bins of `run.py` filled by other seeds, dashpot beside the MuJoCo settings that are fastest
there: conjugate gradients with the sparse Jacobian and both cones, and Newton with the pyramidal
one, which takes too long in the largest bin. Then two threads against the fastest of these on one
or two.
"""

from __future__ import annotations

import numpy as np

from no_arguments import takes_no_arguments
from piles import BINS, bin_of
from speed import THREADS, solver_settings, summary, time_scene

SEEDS = range(1, 6)
FASTEST = ("CG pyramidal sparse", "CG elliptic sparse", "Newton pyramidal sparse")


def main() -> None:
    """Print the ratios for each seed, and their medians."""
    takes_no_arguments(__doc__)
    for name, count in BINS.items():
        fastest = FASTEST if count < max(BINS.values()) else FASTEST[:2]
        settings = [s for s in solver_settings(smoke=False) if s.name.endswith(fastest)]
        ratios = []
        for seed in SEEDS:
            timings = time_scene(bin_of(count, seed=seed), settings, budget=2.0)
            ours, shared, *theirs = timings
            ratios.append(list(summary(timings).values()))
            step, solve, on_threads = ratios[-1]
            print(
                f"{name} seed {seed}: {ours.contacts} contacts, step {ours.step:.3f} ms, MuJoCo "
                f"{min(t.step for t in theirs if t.threads == 1):.3f} ms: {step:.2f}x, "
                f"solve {solve:.2f}x; {THREADS} threads {shared.step:.3f} ms, MuJoCo "
                f"{min(t.step for t in theirs if t.threads > 1):.3f} ms: {on_threads:.2f}x; "
                f"mean speed {ours.mean_speed:.0e} m/s",
                flush=True,
            )
        step, solve, on_threads = np.median(ratios, axis=0)
        medians = (
            f"step {step:.2f}x, solve {solve:.2f}x, step on {THREADS} threads {on_threads:.2f}x"
        )
        print(f"{name} median: {medians}", flush=True)


if __name__ == "__main__":
    main()
