"""Step one model in several ways from the same state and measure every state alike."""

from __future__ import annotations

import copy
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeAlias

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.checks import number, positive_number, text_or_none
from dashpot.compare.notes import softness_of_the_model, violations_at_start
from dashpot.compare.observer import Observer
from dashpot.compare.result import Comparison, Run
from dashpot.compare.scenes import SCENES, Scene
from dashpot.compare.scenes import scene as shipped_scene
from dashpot.compare.settings import (
    DASHPOT,
    DEFAULT_SETTINGS,
    Setting,
    find_setting,
    mujoco_model,
)
from dashpot.engine import DivergenceError, Engine
from dashpot.materials import Material
from dashpot.model_sources import ModelLike
from dashpot.versions import model_hash

SceneLike: TypeAlias = "ModelLike | Scene | Engine"

# Beyond this a state is no longer physics, m, m/s or rad/s.
_DIVERGED = 1e6
_MOST_STEPS = 10**8


def run(
    scene: SceneLike,
    *,
    duration: float | None = None,
    timestep: float | None = None,
    settings: Sequence[str | Setting] = DEFAULT_SETTINGS,
    materials: Mapping[str | int, Material] | None = None,
    settled_after: float | None = None,
    name: str | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Comparison:
    """Step a scene with dashpot and with MuJoCo, and compare penetration and energy.

    Every setting starts from the same state: the model's first keyframe, where it has one, else
    its reference pose; controls keep the keyframe's value. Every state of every run is measured
    on the same unchanged model. MuJoCo's settings take the place of the model's own: where they do
    not say otherwise cones are pyramidal, ``impratio`` is 1 and there are no noslip iterations.

    Parameters
    ----------
    scene
        Name of a shipped scene (``dashpot.compare.SCENES``), a :class:`Scene`, a path to an MJCF
        file, MJCF text, a compiled model, an ``MjSpec``, or an :class:`Engine` with its materials.
    duration
        s, >= one time step; None takes the shipped scene's own, else 2.
    timestep
        s; None takes the model's.
    settings
        "dashpot" and names of ``dashpot.compare.SETTINGS``, or :class:`Setting` objects.
    materials
        Geom, by name or id, to material for dashpot (and for "solref-direct"), on top of the
        scene's own.
    settled_after
        s; where statistics split into "falling" and "settled"; None is three quarters through.
    name
        Of the scene, in tables and plots; None takes the shipped scene's or file's.
    progress
        Called with (setting, share done) about a hundred times a run.

    Raises
    ------
    TypeError
        If a number is none, `settings` is no sequence, `materials` maps nothing, a material is
        none, `name` is no string, or `progress` no function.
    ValueError
        If a number is out of range, a setting, geom or scene is unknown, the model cannot be
        compiled or uses what dashpot refuses; the message names it.
    FileNotFoundError
        If a scene's file does not exist.

    Examples
    --------
    >>> comparison = dashpot.compare.run(model, settings=["dashpot", "mujoco-default"])
    >>> list(comparison.statistics())
    ['dashpot', 'mujoco-default']
    """
    name = text_or_none("name", name)
    if progress is not None and not callable(progress):
        raise TypeError(f"progress must be a function, got {progress!r}")
    own_name, engine, default_duration = _prepare(scene, materials)
    chosen = _settings(settings)
    if timestep is not None:
        engine.model.opt.timestep = positive_number("timestep", timestep)
    step = float(engine.model.opt.timestep)
    length = default_duration if duration is None else positive_number("duration", duration)
    # Compared first: of what is out of range the quotient may be no whole number.
    if not 0.5 < length / step <= _MOST_STEPS:
        raise ValueError(
            f"duration is {length:g} s; it must be 1 to {_MOST_STEPS} time steps of {step:g} s"
        )
    steps = round(length / step)
    split = 0.75 * steps * step if settled_after is None else number("settled_after", settled_after)
    if not 0.0 <= split <= steps * step:
        raise ValueError(f"settled_after is {split:g} s; it must be in [0, {steps * step:g}]")

    observer = Observer(engine.model)
    runs = []
    for setting in chosen:
        label = setting if isinstance(setting, str) else setting.name

        def report(share: float, label: str = label) -> None:
            if progress is not None:
                progress(label, share)

        if isinstance(setting, str):
            runs.append(_run_dashpot(engine, steps, observer, report))
        else:
            runs.append(_run_mujoco(setting, engine, steps, observer, report))
    return Comparison(
        own_name if name is None else name,
        step,
        steps * step,
        split,
        tuple(runs),
        model_hash(engine.model),
        softness_of_the_model(engine),
        violations_at_start(engine.model, start(engine.model)),
    )


def _prepare(
    scene: SceneLike, materials: Mapping[str | int, Material] | None
) -> tuple[str, Engine, float]:
    """Return name, a private engine and the default duration of a scene."""
    duration = 2.0
    if materials is not None and not isinstance(materials, Mapping):
        raise TypeError(f"materials is {type(materials).__name__}; it must map geoms to Materials")
    given: dict[str | int, Material] = {}
    if isinstance(scene, str) and scene in SCENES:
        scene = shipped_scene(scene)
    if isinstance(scene, Engine):
        engine, name = copy.copy(scene), "model"
    elif isinstance(scene, Scene):
        engine, name, duration = Engine(scene.xml), scene.name, scene.duration
        given.update(scene.materials)
    elif isinstance(scene, str | os.PathLike):
        name = "model" if str(scene).lstrip().startswith("<") else Path(scene).stem
        try:
            engine = Engine(scene)
        except FileNotFoundError as error:
            raise FileNotFoundError(f"{error}; shipped scenes are {', '.join(SCENES)}") from None
    elif isinstance(scene, mujoco.MjModel | mujoco.MjSpec):
        engine, name = Engine(scene), "model"
    else:
        raise TypeError(f"scene is {type(scene).__name__}; it must be a path, text or a model")
    given.update(materials or {})
    engine.set_materials(given)
    return name, engine, duration


def _settings(settings: Sequence[str | Setting]) -> list[str | Setting]:
    if isinstance(settings, (str, Setting)):
        settings = (settings,)
    if not isinstance(settings, Iterable):
        raise TypeError(
            f"settings must be a name, a Setting or a sequence of them, got {settings!r}"
        )
    chosen = [find_setting(setting) for setting in settings]
    names = [s if isinstance(s, str) else s.name for s in chosen]
    if not names:
        raise ValueError("settings is empty; name at least one")
    if len(set(names)) != len(names):
        raise ValueError(f"settings {names} name one of them twice")
    return chosen


def start(model: mujoco.MjModel) -> mujoco.MjData:
    """Return data at the model's first keyframe, or at its reference pose without any."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    return data


class _Recorder:
    """Collects the measured series of one run."""

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self._rows: list[tuple[float, float, float, int, float, float, float, float]] = []
        self._work = 0.0
        observer.begin()

    def record(self, data: mujoco.MjData, elastic: float) -> bool:
        """Measure the state; return False, recording nothing, if it has diverged."""
        if not all((np.abs(part) < _DIVERGED).all() for part in (data.qpos, data.qvel)):
            return False
        depths, kinetic, potential = self._observer.measure(data)
        self._work += self._observer.work(data)
        self._rows.append(
            (
                data.time,
                float(depths.sum()),
                float(depths.max(initial=0.0)),
                len(depths),
                kinetic,
                potential,
                elastic,
                self._work,
            )
        )
        return True

    def finish(
        self,
        name: str,
        description: str,
        data: mujoco.MjData,
        wall_time: float,
        unstable_at: float | None,
        warnings: tuple[str, ...] = (),
    ) -> Run:
        columns: list[NDArray[np.float64]] = list(np.array(self._rows, np.float64).T)
        return Run(
            name,
            description,
            time=columns[0],
            penetration_sum=columns[1],
            penetration_max=columns[2],
            contacts=columns[3].astype(np.int64),
            kinetic=columns[4],
            potential=columns[5],
            elastic=columns[6],
            work=columns[7],
            position=np.array(data.qpos),
            wall_time=wall_time,
            unstable_at=unstable_at,
            warnings=warnings,
        )


def _loop(
    recorder: _Recorder,
    data: mujoco.MjData,
    steps: int,
    step: Callable[[], object],
    elastic: Callable[[], float],
    report: Callable[[float], None],
) -> tuple[float, float | None]:
    """Step and record; return the wall time of stepping and when the run diverged, if it did."""
    wall_time = 0.0
    recorder.record(data, elastic())
    for index in range(steps):
        before = data.time
        begin = time.perf_counter()
        try:
            step()
            diverged = False
        except DivergenceError:
            diverged = True
        wall_time += time.perf_counter() - begin
        if diverged or not recorder.record(data, elastic()):
            return wall_time, before
        if (index + 1) % max(1, steps // 100) == 0:
            report((index + 1) / steps)
    return wall_time, None


def _run_dashpot(
    engine: Engine, steps: int, observer: Observer, report: Callable[[float], None]
) -> Run:
    data = start(engine.model)
    recorder = _Recorder(observer)
    reasons: list[str] = []

    def step() -> None:
        try:
            engine.step(data)
        except DivergenceError as error:
            reasons.append(str(error))
            raise

    wall_time, unstable_at = _loop(
        recorder, data, steps, step, lambda: engine.energy(data).elastic, report
    )
    described = f"dashpot's contact solver, law {engine.law}"
    return recorder.finish(DASHPOT, described, data, wall_time, unstable_at, tuple(reasons))


def _run_mujoco(
    setting: Setting,
    engine: Engine,
    steps: int,
    observer: Observer,
    report: Callable[[float], None],
) -> Run:
    model = mujoco_model(setting, engine.model, engine)
    data = start(model)
    recorder = _Recorder(observer)
    with _collected_warnings() as warnings:
        wall_time, unstable_at = _loop(
            recorder, data, steps, lambda: mujoco.mj_step(model, data), lambda: float("nan"), report
        )
    return recorder.finish(
        setting.name, setting.description, data, wall_time, unstable_at, tuple(warnings)
    )


@contextmanager
def _collected_warnings() -> Iterator[list[str]]:
    """Collect MuJoCo's warnings, which it else prints and writes to a file where it runs."""
    warnings: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(warnings.append)
    try:
        yield warnings
    finally:
        mujoco.set_mju_user_warning(before)
