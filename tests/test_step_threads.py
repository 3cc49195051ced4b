"""Threads that share a step: its results, and what it raises, are those of one thread."""

from __future__ import annotations

import copy
import multiprocessing
import os
import pickle
import threading
import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

import shared_step_scenes as scenes
from dashpot import DivergenceError, Engine, Material
from dashpot.cli import parser
from dashpot.cli.options import load_engine
from shared_step_scenes import STATE, Start, at_rest, pile, scene, settled, state, stored

# After how many steps threads share them, in how many calls of how many steps each.
RUNS: dict[Callable[[int], Start], tuple[int, int, int]] = {
    scenes.bin_of_all_shapes: (18, 3, 4),
    scenes.bin_with_rolling_friction: (18, 3, 4),
    scenes.bin_of_materials: (18, 3, 4),
    scenes.bin_on_hills: (36, 3, 4),
    scenes.brick_wall: (0, 2, 3),
    scenes.loop_on_a_bin: (18, 3, 4),
    scenes.arms_in_a_bin: (36, 3, 4),
    scenes.robots_apart: (18, 3, 4),
    scenes.bin_that_is_shot_at: (0, 1, 1),
}


def assert_same(found: dict[str, Any], expected: dict[str, Any], what: object = "") -> None:
    """Compare states without printing their megabytes."""
    assert [name for name in expected if found[name] != expected[name]] == [], what


@pytest.mark.parametrize("make", RUNS, ids=lambda make: make.__name__)
def test_a_step_has_the_same_bits_for_any_number_of_threads(make: Callable[[int], Start]) -> None:
    before, calls, steps = RUNS[make]
    engine, data = make(1)
    if before:
        engine.step(data, nstep=before)
    starts, expected = [], []
    for _ in range(calls):
        starts.append(stored(engine, data))
        stats = engine.step(data, nstep=steps)
        expected.append(state(engine, data, stats))
    assert stats.contacts > 256 or stats.islands > 32  # enough to share every pass
    # More threads than cores take long: they go on from where one thread is.
    for nthread, first in ((2, 0), (3, calls // 2), (5, calls - 1)):
        engine, data = make(nthread)
        mujoco.mj_setState(engine.model, data, starts[first], STATE)
        for call in range(first, calls):
            stats = engine.step(data, nstep=steps)
            assert_same(state(engine, data, stats), expected[call], (nthread, call))


def lose_a_size(engine: Engine, data: mujoco.MjData) -> None:
    engine.model.geom("body100").size[0] = np.nan


def grow(engine: Engine, data: mujoco.MjData) -> None:
    for array in (engine.model.geom_size, engine.model.geom_rbound, engine.model.geom_aabb):
        array[5:] *= 5.0


def press_without_bounds(engine: Engine, data: mujoco.MjData) -> None:
    for body in ("body150", "body90", "body30"):
        data.body(body).xfrc_applied[2] = -1e300


def nothing(engine: Engine, data: mujoco.MjData) -> None:
    pass


@pytest.mark.parametrize(
    ("edit", "memory", "error", "message"),
    [
        (lose_a_size, "64M", ValueError, "geom_size of geom 'body100' holds nan"),
        (grow, "64M", RuntimeError, "contacts exceed the memory for"),
        (press_without_bounds, "64M", DivergenceError, "diverged"),
        (nothing, "250K", RuntimeError, "stack overflow"),
        (nothing, "400K", RuntimeError, "contacts exceed the memory of the model"),
    ],
)
def test_what_a_step_raises_is_the_same_and_leaves_the_state(
    edit: Callable[[Engine, mujoco.MjData], None],
    memory: str,
    error: type[Exception],
    message: str,
) -> None:
    raised = []
    for nthread in (1, 3):
        engine, data = settled(scene(pile(180), memory=memory), nthread)
        if edit is not nothing:
            engine.step(data)
        edit(engine, data)
        before = stored(engine, data)
        for _ in range(2):  # what one step raised is not left for the next
            with pytest.raises(error, match=message) as caught:
                engine.step(data)
            raised.append(str(caught.value))
        np.testing.assert_array_equal(stored(engine, data), before)
    assert raised == raised[:2] * 2


def test_what_islands_of_their_own_raise_is_the_same_and_leaves_nothing_behind() -> None:
    raised, after = [], []
    for nthread in (1, 2, 3):
        engine, data = scenes.robots_apart(nthread)
        engine.step(data, nstep=40)
        before = stored(engine, data)
        for body in ("top40", "top22", "top4"):
            data.body(body).xfrc_applied[2] = -1e300
        with pytest.raises(RuntimeError, match="diverged") as caught:
            engine.step(data)
        raised.append(str(caught.value))
        mujoco.mj_setState(engine.model, data, before, STATE)
        engine.step(data, nstep=5)
        after.append(stored(engine, data).tobytes())
    assert raised == raised[:1] * 3
    assert after == after[:1] * 3
    engine, data = scenes.robots_apart(1)
    engine.step(data, nstep=45)
    assert stored(engine, data).tobytes() == after[0]


def test_a_step_goes_on_after_an_error() -> None:
    expected = None
    for nthread in (1, 2, 3):
        engine, data = settled(scene(pile(180)), nthread)
        engine.step(data)
        press_without_bounds(engine, data)
        with pytest.raises(DivergenceError):
            engine.step(data)
        data.xfrc_applied[:] = 0.0
        found = state(engine, data, engine.step(data, nstep=5))
        assert_same(found, expected or found)
        expected = found


def test_callbacks_are_called_by_the_thread_that_steps() -> None:
    callers: set[int] = set()

    def noted(*_: object) -> int:
        callers.add(threading.get_ident())
        return 0

    expected = None
    setters = (mujoco.set_mjcb_contactfilter, mujoco.set_mjcb_control, mujoco.set_mjcb_passive)
    for nthread in (1, 3):
        engine, data = settled(scene(pile(180)), nthread)
        try:
            for set_callback in setters:
                set_callback(noted)
            found = state(engine, data, engine.step(data, nstep=2))
        finally:
            for set_callback in setters:
                set_callback(None)
        assert_same(found, expected or found)
        expected = found
    assert callers == {threading.get_ident()}


@pytest.mark.parametrize("shared", [False, True], ids=["own engines", "one engine"])
def test_two_python_threads_step_at_once_as_one_after_the_other(shared: bool) -> None:
    model = scene(pile(180))
    starts = [settled(model, 2) for _ in range(4)]
    if shared:
        starts = [(starts[0][0], data) for _, data in starts]
    for i, (_, data) in enumerate(starts):
        data.qvel[2::6] -= 0.5 * (i % 2)
    found: list[dict[str, Any]] = [{}] * 4

    def step(index: int) -> None:
        engine, data = starts[index]
        for _ in range(10):
            stats = engine.step(data, nstep=2)
        found[index] = state(engine, data, stats)

    threads = [threading.Thread(target=step, args=(index,)) for index in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for index in (2, 3):
        step(index)
        assert_same(found[index - 2], found[index])
    assert found[0]["qpos"] != found[1]["qpos"]


def system_threads(expected: int = -1) -> int:
    """Count them; those that have ended stay listed for a moment, in an emulator for longer."""
    for _ in range(1000):
        if (count := len(os.listdir("/proc/self/task"))) <= expected or expected < 0:
            break
        time.sleep(0.001)
    return count


def test_threads_are_there_while_an_engine_steps() -> None:
    engine, data = at_rest(Engine(scene(pile(36)), nthread=4))
    assert engine.nthread == 4
    before = system_threads()
    engine.step(data)
    assert system_threads() == before + 3
    engine.set_material("floor", Material(1e5))
    assert system_threads(before) == before
    engine.step(data)
    assert system_threads() == before + 3
    del engine
    assert system_threads(before) == before


def test_a_process_that_is_forked_off_steps_alone() -> None:
    engine, data = at_rest(Engine(scene(pile(144)), nthread=3))
    engine.step(data, nstep=30)
    time.sleep(0.01)  # longer than the others wait in a loop
    other = copy.copy(data)

    def step_and_drop() -> None:
        engine.step(other, nstep=3)
        engine.set_material("floor", Material(1e5))  # ends the threads that the fork left behind
        engine.step(other)

    child = multiprocessing.get_context("fork").Process(target=step_and_drop)
    child.start()
    child.join(timeout=10.0)
    exit_code = child.exitcode
    child.kill()
    assert exit_code == 0
    engine.step(data)


@pytest.mark.parametrize(
    "duplicate", [copy.copy, copy.deepcopy, lambda engine: pickle.loads(pickle.dumps(engine))]
)
def test_copies_keep_the_number_of_threads(duplicate: Callable[[Engine], Engine]) -> None:
    engine = Engine(scene(pile(36)), nthread=3)
    assert duplicate(engine).nthread == 3
    assert repr(duplicate(engine)) == repr(engine)


@pytest.mark.parametrize(
    ("nthread", "error"),
    [(0, ValueError), (-1, ValueError), (129, ValueError), (2**31, ValueError)]
    + [(bad, TypeError) for bad in (1.5, 2.0, True, "2", None)],
)
def test_a_number_of_threads_that_is_none_is_named(nthread: Any, error: type[Exception]) -> None:
    with pytest.raises(error, match=f"nthread must be .*got {nthread!r}"):
        Engine(mujoco.MjModel.from_xml_string("<mujoco/>"), nthread=nthread)


def test_engines_have_one_thread_unless_told_and_commands_tell() -> None:
    assert Engine(mujoco.MjModel.from_xml_string("<mujoco/>")).nthread == 1
    for command in (["simulate", "ball"], ["view", "ball"], ["compare", "ball"]):
        assert parser().parse_args(command).threads == 1
        assert parser().parse_args([*command, "--threads", "3"]).threads == 3
    assert load_engine("ball", [], nthread=3).nthread == 3
