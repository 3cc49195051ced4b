"""Interpreters that end, and processes that fork, while threads step."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading

import mujoco
import pytest

import dashpot

BALLS = "".join(
    f'<body pos="{0.05 * i} 0 {0.2 + 0.21 * i}"><freejoint/><geom size=".1"/></body>'
    for i in range(8)
)
SCENE = f'<mujoco><worldbody><geom type="plane" size="5 5 .1"/>{BALLS}</worldbody></mujoco>'
CALLS = {
    "one long step": "engine.step(data, 10**7)",
    "two threads on one engine": "[engine.step(other) for _ in range(10**7)]",
    "a rollout": "dashpot.rollout(engine, start[None].repeat(64, 0), nstep=5000, nthread=2)",
    "derivatives": "[dashpot.linearize(engine, data) for _ in range(1000)]",
    "queries": "[dashpot.distance(engine, other, 1, 2) for _ in range(10**7)]",
}
PROGRAM = """
import threading, time, mujoco, numpy as np, dashpot
engine = dashpot.Engine(mujoco.MjModel.from_xml_string({scene!r}))
data, other = engine.make_data(), engine.make_data()
mujoco.mj_forward(engine.model, other)
full = mujoco.mjtState.mjSTATE_FULLPHYSICS
start = np.empty(mujoco.mj_stateSize(engine.model, full))
mujoco.mj_getState(engine.model, data, start, full)
begun = threading.Event()
def work():
    begun.set()
    {call}
threading.Thread(target=work, daemon=True).start()
if {second}:
    threading.Thread(target=lambda: engine.step(data, 10**7), daemon=True).start()
begun.wait()
time.sleep(0.2)
print("done")
"""


@pytest.mark.parametrize("call", CALLS)
def test_an_interpreter_ends_while_a_daemon_thread_is_in_a_call(call):
    """Python ends a thread that asks for its lock then, and C++ the process: SIGABRT."""
    program = PROGRAM.format(scene=SCENE, call=CALLS[call], second=call.startswith("two"))
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "done\n", "")


def test_what_is_called_at_exit_can_still_step():
    program = f"""
import atexit, mujoco, dashpot
engine = dashpot.Engine(mujoco.MjModel.from_xml_string({SCENE!r}))
data = engine.make_data()
atexit.register(lambda: print(engine.step(data).parts))
"""
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert (ended.returncode, ended.stdout) == (0, "1\n")


def steps_in_a_child(engine, data):
    """Return whether a forked child steps and ends well within 20 s."""
    child = os.fork()
    if child == 0:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(20)
        engine.step(data)
        os._exit(0)
    return os.waitpid(child, 0)[1] == 0


@pytest.mark.parametrize("nthread", [1, 2])
def test_a_child_forked_while_another_thread_steps_can_step(nthread):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(SCENE), nthread=nthread)
    twin = dashpot.Engine(mujoco.MjModel.from_xml_string(SCENE))
    data, other, alone = engine.make_data(), engine.make_data(), twin.make_data()
    stop = threading.Event()

    def loop():
        while not stop.is_set():
            engine.step(data)

    thread = threading.Thread(target=loop)
    thread.start()
    try:
        assert all(steps_in_a_child(engine, other) for _ in range(5))
        assert steps_in_a_child(twin, alone)
    finally:
        stop.set()
        thread.join()
    # The parent goes on as if nothing had been.
    engine.step(other)
    twin.step(alone)
    assert other.qpos.tolist() == alone.qpos.tolist()


def test_a_fork_in_a_callback_of_a_step_does_not_wait_for_that_step():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(SCENE))
    data, twin = engine.make_data(), dashpot.Engine(engine.model)
    other = twin.make_data()
    forked, ends = [], []

    def control(model, data):
        if not forked:
            forked.append(data.time)
            ends.append(steps_in_a_child(twin, other))

    mujoco.set_mjcb_control(control)
    try:
        engine.step(data)
    finally:
        mujoco.set_mjcb_control(None)
    assert ends == [True]
