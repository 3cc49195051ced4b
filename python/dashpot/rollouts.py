"""Many open-loop rollouts in parallel."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot.checks import finite_array, positive_count, thread_count
from dashpot.engine import Engine

Array = NDArray[np.float64]


def rollout(
    engine: Engine,
    initial_state: ArrayLike,
    control: ArrayLike | None = None,
    *,
    nstep: int | None = None,
    nthread: int | None = None,
    with_memory: bool = True,
) -> tuple[Array, Array]:
    """Step many initial states, or many control sequences, in parallel C++ threads.

    Shapes are those of `mujoco.rollout.rollout`; the GIL is released, and Ctrl-C ends the batch, of
    which nothing comes back then. Every rollout is what `Engine.step` on one data would give, bit
    for bit, whatever the number of threads.

    Parameters
    ----------
    engine
        Steps; it is only read, as it is before or after the steps that other threads take with it.
        Its model must not be edited meanwhile.
    initial_state
        (nstate,), (1, nstate) or (nbatch, nstate). Either full-physics states (``nstate ==
        mj_stateSize(model, mjSTATE_FULLPHYSICS)``), which start without contact memory and without
        applied forces, and with mocap bodies where the model has them, as `mujoco.rollout` does; or
        integration states (``mjSTATE_INTEGRATION``), which carry contact memory (friction and
        compression, kept in the data's user data), controls, applied forces and poses of mocap
        bodies, so that a rollout goes on from an earlier one bit for bit. Where the two sizes are
        equal they hold the same.
    control
        (nu,), (nstep, nu) or (nbatch, nstep, nu), dimensions of size 1 repeated. None: zero, or,
        for integration states, the controls in the state.
    nstep
        Number of steps, >= 1. None: from `control`, else 1.
    nthread
        Number of threads, >= 1. None: one per core. The engine keeps their data for the next call.
    with_memory
        False: integration states come back as full-physics states. Contact memory is most of the
        state of a robot, 100 kB of it in every step: with it, many rollouts take several times as
        long and as much memory.

    Returns
    -------
    state : (nbatch, nstep, nstate)
        State after each step, of the same kind as `initial_state`, or full-physics. Contact memory
        says of each contact which one of ``data.contact`` it is, and rollouts number them before
        those that nothing touched are left out, which `Engine.step` does.
    sensordata : (nbatch, nstep, nsensordata)
        Sensor data of each step.

    Raises
    ------
    TypeError
        If `engine` is no `Engine`, and for arguments that are not numbers.
    ValueError
        For shapes that do not fit and numbers that are not finite, naming argument and index; and
        where a rollout fails, naming rollout and step.
    DivergenceError
        Where a rollout diverges, naming rollout and step.
    """
    if not isinstance(engine, Engine):
        raise TypeError(f"engine is {type(engine).__name__}; it must be a dashpot.Engine")
    model = engine.model
    sizes = {
        "mjSTATE_FULLPHYSICS": _state_size(model, mujoco.mjtState.mjSTATE_FULLPHYSICS),
        "mjSTATE_INTEGRATION": _state_size(model, mujoco.mjtState.mjSTATE_INTEGRATION),
    }
    states = np.atleast_2d(finite_array("initial_state", initial_state))
    if states.ndim != 2 or states.shape[0] == 0 or states.shape[1] not in sizes.values():
        known = " or ".join(f"{size} ({name})" for name, size in sizes.items())
        raise ValueError(
            f"initial_state must be (nbatch, nstate) with nstate {known} of engine.model, "
            f"got shape {states.shape}"
        )
    controls = None if control is None else finite_array("control", control)
    if controls is not None:
        if controls.ndim > 3 or controls.ndim == 0 or controls.shape[-1] != model.nu:
            raise ValueError(
                f"control must be (nbatch, nstep, nu) with nu = {model.nu}, "
                f"got shape {controls.shape}"
            )
        controls = controls.reshape((1,) * (3 - controls.ndim) + controls.shape)
    nbatch = _common("nbatch", {"initial_state": len(states)}, controls, 0)
    given = {} if nstep is None else {"nstep": positive_count("nstep", nstep)}
    steps = _common("nstep", given, controls, 1)
    states = np.ascontiguousarray(np.broadcast_to(states, (nbatch, states.shape[1])))
    if controls is not None:
        controls = np.ascontiguousarray(np.broadcast_to(controls, (nbatch, steps, model.nu)))
    threads = thread_count(nthread)
    if not isinstance(with_memory, bool | np.bool_):
        raise TypeError(f"with_memory must be True or False, got {with_memory!r}")
    return engine._rollout_workers().run(states, controls, steps, threads, bool(with_memory))


def _state_size(model: mujoco.MjModel, kind: mujoco.mjtState) -> int:
    return int(mujoco.mj_stateSize(model, int(kind)))


def _common(name: str, given: dict[str, int], control: Array | None, axis: int) -> int:
    """Size of a batch dimension: what is given and control's must agree, 1 repeats.

    A given `nstep` of 1 is a wish, not a size to repeat, but then control must have one step too.
    """
    sizes = dict(given)
    if control is not None:
        sizes["control"] = control.shape[axis]
    result = max(sizes.values(), default=1)
    for argument, size in sizes.items():
        if size == 0 or size not in (1, result) or (argument == "nstep" and size != result):
            raise ValueError(
                f"{name} does not agree: "
                + ", ".join(f"{argument} has {size}" for argument, size in sizes.items())
            )
    return result
