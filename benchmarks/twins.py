"""What intervals and statements of calibration are worth, over recordings whose truth is hidden.

Run ``python benchmarks/twins.py``: eleven kinds of recordings that laboratories make, 100 of each
(`twin_scenes`), and a track with a slope that the model may leave out. Of each kind it prints how
often 95 % intervals hold the truth (90 to 99 of 100 is right), and how often what a recording
cannot tell is called not identified (95). It prints how often residuals are called a misfit, too:
of a right model at most 5, and of the one without the slope 100. Seed and kind make a recording, so
that each is the same in every run.

``--smoke`` makes eight of each kind and holds the counts to limits; it ends with an error if one is
exceeded. A right method exceeds any of them in less than one of a thousand choices of seeds.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import sys
import time
import warnings
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from itertools import repeat
from pathlib import Path

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table
from scipy import stats

from dashpot.calibrate import fit
from twin_scenes import KINDS, Case

GRADES = ("identified", "within misfit", "not identified")
# With fewer no number of misses would exceed what chance allows. Of a track that slopes a fit takes
# as long as of four others.
SMOKE = {kind: 4 if kind == "slope of a track" else 8 for kind in KINDS}
RARE = 1e-3 / (3 * len(SMOKE))


@dataclass
class Outcome:
    """What a fit of one recording said.

    Attributes
    ----------
    covered
        By unknown that the recording tells: whether the interval holds the truth.
    error
        By the same: estimate less truth, in half-widths of the interval.
    grades
        By parameter.
    silent
        Parameters that the recording cannot tell.
    misfits
        Channels whose residuals are called a misfit.
    """

    kind: str
    seed: int
    variant: int
    wrong: bool
    seconds: float
    covered: dict[str, bool] = field(default_factory=dict)
    error: dict[str, float] = field(default_factory=dict)
    grades: dict[str, str] = field(default_factory=dict)
    silent: list[str] = field(default_factory=list)
    misfits: list[str] = field(default_factory=list)


def outcomes(kind: str, seed: int) -> list[Outcome]:
    """Make the recordings of a kind and a seed, fit them and compare with the truth."""
    rng = np.random.default_rng([list(KINDS).index(kind), seed])
    return [outcome(kind, seed, i, case) for i, case in enumerate(KINDS[kind](rng))]


def outcome(kind: str, seed: int, variant: int, case: Case) -> Outcome:
    """Fit one recording and compare with the truth."""
    began = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        result = fit(case.problem, nthread=1, **case.options)
    found = Outcome(kind, seed, variant, case.wrong, time.process_time() - began)
    for name, value in case.truth.items():
        estimate = result[name]
        found.covered[name] = bool(estimate.lower <= value <= estimate.upper)
        half = 0.5 * (estimate.upper - estimate.lower)
        found.error[name] = float((estimate.value - value) / half)
    found.grades = {estimate.name: estimate.grade for estimate in result.estimates}
    found.silent = list(case.silent)
    found.misfits = [misfit.channel for misfit in result.misfits]
    return found


def table(found: Sequence[Outcome]) -> Table:
    """Return a row for each kind, and for each of its variants where it has several."""
    made = Table(box=box.MARKDOWN)
    for name in ("kind", "fits", "truth inside", "by unknown", "mean error", "called identified"):
        made.add_column(name)
    for name in ("silent, called so", "called a misfit", "s"):
        made.add_column(name, justify="right")
    for kind in KINDS:
        for variant in sorted({o.variant for o in found if o.kind == kind}):
            rows = [o for o in found if o.kind == kind and o.variant == variant]
            made.add_row(*row(kind + "'" * variant, rows))
    return made


def row(name: str, rows: Sequence[Outcome]) -> list[str]:
    told = list(rows[0].covered)
    inside = {t: [o.covered[t] for o in rows] for t in told}
    error = {t: float(np.mean([o.error[t] for o in rows])) for t in told}
    identified = {t: [o.grades[t] != "not identified" for o in rows] for t in told}
    silent = {s: [o.grades[s] == "not identified" for o in rows] for s in rows[0].silent}
    return [
        name,
        str(len(rows)),
        share(inside.values()),
        ", ".join(f"{t} {100 * np.mean(i):.0f}" for t, i in inside.items()),
        ", ".join(f"{e:+.2f}" for e in error.values()),
        share(identified.values()),
        share(silent.values()),
        share([[bool(o.misfits) for o in rows]]),
        f"{np.mean([o.seconds for o in rows]):.2f}",
    ]


def share(several: Iterable[Sequence[bool]]) -> str:
    """Return the percentage of several together."""
    together = [value for one in several for value in one]
    return f"{100 * np.mean(together):.1f} %" if together else ""


def most(count: int, probability: float) -> int:
    """Return how often of `count` what has a probability happens at most, but for rare cases."""
    return int(stats.binom.isf(RARE, count, min(probability, 1.0)))


def exceeded(found: Sequence[Outcome]) -> list[str]:
    """Return the limits of `--smoke` that outcomes exceed."""
    said, told = [], [o for o in found if o.covered]
    # The number of fits that miss has a mean and a variance below the sum of probabilities.
    missed = sum(not all(o.covered.values()) for o in told)
    mean = sum(0.05 * len(o.covered) for o in told)
    if missed > (limit := mean + 3.3 * math.sqrt(mean)):
        said.append(f"{missed} of {len(told)} intervals miss the truth, at most {limit:.0f} may")
    for kind in dict.fromkeys(o.kind for o in found):
        # Jittered stamps without their rate alone: those with it are the easier of the same.
        rows = [o for o in found if o.kind == kind]
        rows = [o for o in rows if o.variant == 1] if kind == "jittered stamps" else rows
        # That one of u unknowns is missed has a probability of u 5 % at most.
        told, silent = [o for o in rows if o.covered], [o for o in rows if o.silent]
        right = [o for o in rows if not o.wrong]
        for what, several, count, probability in (
            (
                "fits miss the truth",
                told,
                sum(not all(o.covered.values()) for o in told),
                0.05 * max((len(o.covered) for o in told), default=0),
            ),
            (
                "fits call identified what the recording cannot tell",
                silent,
                sum(any(o.grades[s] != "not identified" for s in o.silent) for o in silent),
                0.05,
            ),
            ("right models are called a misfit", right, sum(bool(o.misfits) for o in right), 0.05),
        ):
            if count > (limit := most(len(several), probability)):
                said.append(f"{kind}: {count} of {len(several)} {what}, at most {limit} may")
        if not all("place" in o.misfits for o in rows if o.wrong):
            said.append(f"{kind}: a model that is wrong is not called a misfit of its place")
    return said


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repetitions", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--kind", nargs="*", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--smoke", action="store_true", help="eight of each kind, within limits")
    parser.add_argument(
        "--json", type=Path, default=None, help="write the results here, one a line"
    )
    arguments = parser.parse_args()
    console, found = Console(), []
    # Threads of linear algebra wait for each other where cores are few; processes begin with this.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    context = multiprocessing.get_context("spawn")
    with ExitStack() as stack:
        pool = stack.enter_context(ProcessPoolExecutor(arguments.processes, mp_context=context))
        lines = None if arguments.json is None else stack.enter_context(open(arguments.json, "w"))
        for kind in arguments.kind:
            count = SMOKE[kind] if arguments.smoke else arguments.repetitions
            seeds = range(arguments.first_seed, arguments.first_seed + count)
            for several in pool.map(outcomes, repeat(kind, len(seeds)), seeds):
                found += several
                for one in several if lines else ():
                    print(json.dumps(asdict(one)), file=lines, flush=True)
            console.print(table([o for o in found if o.kind == kind]))
    console.print(table(found))
    if arguments.smoke and (said := exceeded(found)):
        sys.exit("\n".join(said))


if __name__ == "__main__":
    main()
