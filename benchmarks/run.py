"""Run benchmark scenes with dashpot and MuJoCo side by side.

    python benchmarks/run.py [--scene NAME ...] [--smoke] [--out results.json]

Prints one table of accuracy and one of speed and writes both as JSON with the command, versions
and machine. `--smoke` runs a short form of everything in less than a minute.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib.metadata
import json
import os
import platform
import sys
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rich.console import Console
from rich.table import Table

from nonholonomic import nonholonomic
from piles import BINS, balls_666, many_body, pile
from scene import Scene
from scenes import few_body, gripper, slope, spin, wall_press
from simulate import MUJOCO, SETTINGS, measure
from speed import THREADS, as_rows, summary, time_bin


def smoke_scenes() -> list[Scene]:
    """Return the scenes with the long ones shortened."""
    short = {
        "slope": slope(duration=3.0),
        "wall": wall_press(duration=1.0),
        "gripper": gripper(duration=3.0),
        "spin": spin(duration=5.0),
        "pile": dataclasses.replace(pile(count=15), duration=2.5),
        "666": balls_666(side=3, duration=1.0),
    }
    return [
        dataclasses.replace(short.get(s.name, s), timesteps=(s.timesteps[len(s.timesteps) // 2],))
        for s in (*few_body(), *nonholonomic(), *many_body())
    ]


def cpu_model() -> str:
    """Return the processor's name."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor()


def provenance() -> dict[str, Any]:
    """Return the command, versions and machine that results belong to."""
    return {
        "command": " ".join(["python", "benchmarks/run.py", *sys.argv[1:]]),
        "date": time.strftime("%Y-%m-%d", time.gmtime()),
        "versions": {
            "dashpot": installed_version("dashpot"),
            "mujoco": mujoco.__version__,
            "numpy": np.__version__,
            "python": platform.python_version(),
        },
        "machine": {
            "cpu": cpu_model(),
            "count": os.cpu_count(),
            "system": f"{platform.system()} {platform.machine()}",
        },
    }


def installed_version(package: str) -> str:
    """Return the version of a package, or where it is imported from when not installed."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "source tree"


def accuracy(scene: Scene, settings: list[str]) -> list[dict[str, Any]]:
    """Run one scene at its time steps with every setting that applies."""
    rows = []
    for timestep in scene.timesteps:
        for name in settings:
            if not SETTINGS[name].accepts(scene):
                continue
            before = time.perf_counter()
            try:
                numbers, failure = measure(scene, SETTINGS[name], timestep), None
            except (ValueError, mujoco.FatalError) as error:
                numbers, failure = {}, str(error)
            rows.append(
                {
                    "scene": scene.name,
                    "title": scene.title,
                    "timestep": timestep,
                    "setting": name,
                    "numbers": {key: float(value) for key, value in numbers.items()},
                    "targets": dict(scene.targets),
                    "failure": failure,
                    "seconds": time.perf_counter() - before,
                }
            )
    return rows


def accuracy_table(rows: list[dict[str, Any]], settings: list[str]) -> Table:
    """Return one line per scene, quantity and time step, with a column per setting."""
    table = Table(title="Accuracy (smaller is better)", show_lines=False)
    for column in ("scene", "quantity", "dt ms", "target", *settings, "met"):
        table.add_column(column)
    found: dict[tuple[str, float, str], dict[str, float]] = {}
    targets: dict[tuple[str, str], float] = {}
    for row in rows:
        for quantity, target in row["targets"].items():
            cells = found.setdefault((row["scene"], row["timestep"], quantity), {})
            cells[row["setting"]] = row["numbers"].get(quantity, float("nan"))
            targets[row["scene"], quantity] = target
    for (scene, timestep, quantity), cells in found.items():
        target = targets[scene, quantity]
        met = cells.get("dashpot", float("nan")) <= target
        table.add_row(
            scene,
            quantity,
            f"{1e3 * timestep:g}",
            f"{target:.0e}",
            *(f"{cells[s]:.2e}" if s in cells else "" for s in settings),
            "[green]yes" if met else "[red]no",
        )
    return table


def speed_table(timings: list[dict[str, Any]], ratios: dict[str, dict[str, float]]) -> Table:
    """Return one line per bin and setting."""
    table = Table(title="Time per step in settled bins, dt 2 ms")
    columns = ("bin", "setting", "contacts", "step ms", "solve ms", "mean overlap", "max overlap")
    for column in (*columns, "mean speed"):
        table.add_column(column)
    for t in timings:
        table.add_row(
            t["scene"],
            t["setting"],
            str(t["contacts"]),
            f"{t['step']:.3f}",
            f"{t['solve']:.3f}" if t["solve"] is not None else "",
            f"{t['mean_overlap']:.1e}",
            f"{t['max_overlap']:.1e}",
            f"{t['mean_speed']:.1e}",
        )
    for name, ratio in ratios.items():
        table.add_row(
            name,
            "fastest MuJoCo / dashpot",
            "",
            f"{ratio['step ratio']:.2f}x",
            f"{ratio['solve ratio']:.2f}x",
        )
        shared = f"{ratio['shared step ratio']:.2f}x"
        table.add_row(name, f"fastest MuJoCo / dashpot {THREADS} threads", "", shared)
    return table


def main() -> None:
    """Parse the command line, run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    known = {s.name: s for s in (*few_body(), *nonholonomic(), *many_body())}
    names = [*known, *BINS]
    parser.add_argument("--scene", nargs="+", choices=names, metavar="NAME", help=", ".join(names))
    parser.add_argument("--smoke", action="store_true", help="short form, less than a minute")
    parser.add_argument("--dashpot-only", action="store_true", help="skip the MuJoCo settings")
    parser.add_argument("--out", type=Path, help="write results to this JSON file")
    arguments = parser.parse_args()

    scenes = {s.name: s for s in smoke_scenes()} if arguments.smoke else known
    bins = ["bin-90"] if arguments.smoke else list(BINS)
    if arguments.scene:
        scenes = {name: s for name, s in scenes.items() if name in arguments.scene}
        bins = [name for name in BINS if name in arguments.scene]
    settings = ["dashpot"] if arguments.dashpot_only else ["dashpot", *(s.name for s in MUJOCO)]
    if arguments.smoke:
        settings = settings[:3]

    console = Console(width=None if sys.stdout.isatty() else 150)
    rows: list[dict[str, Any]] = []
    for scene in scenes.values():
        console.print(f"[dim]{scene.title}")
        rows += accuracy(scene, settings)
    timings: list[dict[str, Any]] = []
    ratios: dict[str, dict[str, float]] = {}
    for name in bins:
        console.print(f"[dim]timing {name}")
        timed = time_bin(name, smoke=arguments.smoke, budget=0.5 if arguments.smoke else 4.0)
        timings += as_rows(timed)
        ratios[name] = summary(timed)
    if rows:
        console.print(accuracy_table(rows, settings))
    if timings:
        console.print(speed_table(timings, ratios))
    for row in rows:
        if row["failure"]:
            console.print(f"[red]{row['scene']} {row['setting']}: {row['failure']}")
    if arguments.out:
        results = {**provenance(), "accuracy": rows, "speed": timings, "ratios": ratios}
        arguments.out.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
