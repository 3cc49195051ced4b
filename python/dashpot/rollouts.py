"""Many open-loop rollouts in parallel."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Literal, overload

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot import _core
from dashpot import rollout_inputs as inputs
from dashpot.checks import flag, positive_count, whole_number
from dashpot.engine import Engine
from dashpot.rollout_inputs import CONTROLS, FULL_PHYSICS, INTEGRATION, Data
from dashpot.rollout_states import RolloutStates

Array = NDArray[np.float64]

_MOST_NAMED = 100


class DivergenceWarning(UserWarning):
    """Rollouts diverged, and were filled with NaN as `rollout(on_divergence="nan")` asks.

    Examples
    --------
    >>> import warnings
    >>> pulled = dashpot.Engine(mujoco.MjModel.from_xml_string('''<mujoco><worldbody><body>
    ...   <joint type="slide" axis="0 0 1" stiffness="-1e7"/><geom size=".1" mass="1"/>
    ... </body></worldbody></mujoco>'''))
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     states, _ = dashpot.rollout(
    ...         pulled, [[0, 0, 0], [0, 1, 0]], nstep=50, on_divergence="nan"
    ...     )
    >>> caught[0].category.__name__, np.isnan(states[:, -1]).all(axis=-1)
    ('DivergenceWarning', array([ True,  True]))
    """


@overload
def rollout(
    engine: Engine | Sequence[Engine],
    data: Data | ArrayLike | None = None,
    initial_state: ArrayLike | None = None,
    control: ArrayLike | None = None,
    *,
    control_spec: int | mujoco.mjtState = CONTROLS,
    skip_checks: bool = False,
    nstep: int | None = None,
    initial_warmstart: ArrayLike | None = None,
    nthread: int | None = None,
    with_memory: Literal[False] = False,
    on_divergence: Literal["raise", "nan"] = "raise",
    state: Array | None = None,
    sensordata: Array | None = None,
    final_state: Array | None = None,
    chunk_size: int | None = None,
    persistent_pool: bool = False,
) -> tuple[Array, Array]: ...


@overload
def rollout(
    engine: Engine | Sequence[Engine],
    data: Data | ArrayLike | None = None,
    initial_state: ArrayLike | None = None,
    control: ArrayLike | None = None,
    *,
    control_spec: int | mujoco.mjtState = CONTROLS,
    skip_checks: bool = False,
    nstep: int | None = None,
    initial_warmstart: ArrayLike | None = None,
    nthread: int | None = None,
    with_memory: bool,
    on_divergence: Literal["raise", "nan"] = "raise",
    state: Array | None = None,
    sensordata: Array | None = None,
    final_state: Array | None = None,
    chunk_size: int | None = None,
    persistent_pool: bool = False,
) -> tuple[Array | RolloutStates, Array]: ...


def rollout(
    engine: Engine | Sequence[Engine],
    data: Data | ArrayLike | None = None,
    initial_state: ArrayLike | None = None,
    control: ArrayLike | None = None,
    *,
    control_spec: int | mujoco.mjtState = CONTROLS,
    skip_checks: bool = False,
    nstep: int | None = None,
    initial_warmstart: ArrayLike | None = None,
    nthread: int | None = None,
    with_memory: bool = False,
    on_divergence: Literal["raise", "nan"] = "raise",
    state: Array | None = None,
    sensordata: Array | None = None,
    final_state: Array | None = None,
    chunk_size: int | None = None,
    persistent_pool: bool = False,
) -> tuple[Array | RolloutStates, Array]:
    """Step many initial states, or many control sequences, in parallel C++ threads.

    Calls are those of `mujoco.rollout.rollout` with an engine in place of the model. The GIL is
    released, and Ctrl-C ends the batch, of which nothing comes back then. Every rollout is what
    `Engine.step` on one data would give, bit for bit, whatever the number of threads. Which trees
    sleep (``<flag sleep="enable"/>``) is in no state of MuJoCo's: all begin awake, as after
    ``mj_setState``.

    Parameters
    ----------
    engine
        Steps; it is only read, as it is before or after the steps that other threads take with it.
        Its model must not be edited meanwhile. Or a sequence of nbatch engines, one for each
        rollout, whose models have the same sizes: other materials, masses or options, say.
    data
        As `mujoco.rollout` takes it: a ``mujoco.MjData``, or a list of them of which each stands
        for a thread. Nothing is read from it or written to it. It may be left out:
        ``rollout(engine, initial_state, control)``.
    initial_state
        (nstate,), (1, nstate) or (nbatch, nstate). Full-physics states (``nstate ==
        mj_stateSize(model, mjSTATE_FULLPHYSICS)``) start without contact memory and without applied
        forces, and with mocap bodies where the model has them, as `mujoco.rollout` does.
        Integration states (``mjSTATE_INTEGRATION``) carry contact memory (friction and compression,
        kept in the data's user data), controls, applied forces and poses of mocap bodies. From
        these a rollout goes on from an earlier one bit for bit. Where the two sizes are equal they
        hold the same.
    control
        (ncontrol,), (nstep, ncontrol) or (nbatch, nstep, ncontrol), dimensions of size 1 repeated;
        ``ncontrol == mj_stateSize(model, control_spec)``. None: zero, or, for integration states,
        what the state holds.
    control_spec
        What `control` holds, bits of ``mjtState``, such as ``mjSTATE_CTRL | mjSTATE_MOCAP_POS``.
        That is controls, and with them or in their place applied forces, poses of mocap bodies and
        which equalities are active, in the order of ``mj_setState``. Not user data, where contact
        memory lies.
    nstep
        Number of steps, >= 1. None: from `control`, `state` or `sensordata`, else 1.
    initial_warmstart
        (nv,), (1, nv) or (nbatch, nv), as `mujoco.rollout` takes it. No solver iterates here, so
        that it has no effect; its shape is checked.
    nthread
        Number of threads, >= 1. None: one for each of `data`, or one per core. The engine keeps
        what they need for the next call.
    with_memory
        True: states come back as integration states, with contact memory, so that rollouts can go
        on from each of them. They are `RolloutStates`, which keep numbers that are not zero alone,
        where `state` is not given. False: as full-physics states, which are as short as MuJoCo's.
    on_divergence
        What a rollout does whose state diverges. "raise" ends all of them. "nan" fills its states
        and sensor data from that step on with NaN, leaves the others as they are, bit for bit, and
        gives a `DivergenceWarning` that names the rollouts.
    state, sensordata
        Where to write what is returned, C-contiguous, of float64 and of the shapes below. None: new
        arrays. After an exception they hold some of it.
    final_state
        Where to write the last states as integration states, (nbatch, nstate), to go on from them
        with contact memory. It may be `initial_state`.
    skip_checks, chunk_size, persistent_pool
        As `mujoco.rollout` takes them. They have no effect: all is checked, each thread takes the
        next rollout once it is done with one, and engines keep their workers.

    Returns
    -------
    state : (nbatch, nstep, nstate)
        State after each step, by `with_memory`. Contact memory says of each contact which one of
        ``data.contact`` it is, and rollouts number them before those that nothing touched are left
        out, which `Engine.step` does.
    sensordata : (nbatch, nstep, nsensordata)
        Sensor data of each step.

    Raises
    ------
    TypeError
        If `engine` is no `Engine` or sequence of them, `data` no ``MjData``, an output no array of
        float64, and for arguments that are not numbers. It is a ValueError too, which
        `mujoco.rollout` raises.
    ValueError
        For shapes that do not fit and numbers that are not finite, naming argument and index. For
        bits in `control_spec` that are nothing given from outside. Where a rollout fails, naming
        rollout and step.
    DivergenceError
        Where a rollout diverges, naming rollout and step, unless `on_divergence` is "nan".

    Examples
    --------
    >>> model = mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
    ...   <body><joint type="slide" axis="0 0 1"/><geom size=".1"/></body></worldbody></mujoco>''')
    >>> engine = dashpot.Engine(model)
    >>> starts = [[0.0, height, 0.0] for height in (1.0, 2.0)]  # time, qpos, qvel
    >>> states, _ = dashpot.rollout(engine, starts, nstep=100)
    >>> states[:, -1, 1].round(3)
    array([0.802, 1.802])
    """
    with inputs.errors_of_mujoco():
        if data is not None and not inputs.is_data(data):
            data, initial_state, control = None, *_moved_up(data, initial_state, control)
        threads = inputs.threads_of(data, nthread)
        engines = inputs.engine_list(engine)
        model = engines[0].model
        spec = inputs.checked_spec(control_spec)
        with_memory = flag("with_memory", with_memory)
        for name, value in {"skip_checks": skip_checks, "persistent_pool": persistent_pool}.items():
            flag(name, value)
        if chunk_size is not None:
            whole_number("chunk_size", chunk_size, lowest=0)
        if on_divergence not in ("raise", "nan"):
            raise ValueError(f"on_divergence is {on_divergence!r}; it must be 'raise' or 'nan'")
        starts = inputs.initial_states(model, initial_state)
        controls = None if control is None else inputs.checked_controls(model, spec, control)
        outputs = {"state": state, "sensordata": sensordata, "final_state": final_state}
        given = {name: array for name, array in outputs.items() if array is not None}
        for name, array in given.items():
            inputs.check_output(name, array)

        repeated = {"engine": len(engines), "initial_state": len(starts)}
        if initial_warmstart is not None:
            repeated["initial_warmstart"] = inputs.warmstart_count(model, initial_warmstart)
        nbatch = inputs.common_size("nbatch", repeated, given, controls, axis=0)
        nsteps = {} if nstep is None else {"nstep": positive_count("nstep", nstep)}
        steps = inputs.common_size("nstep", nsteps, given, controls, axis=1)

        full, integration = (inputs.state_size(model, kind) for kind in (FULL_PHYSICS, INTEGRATION))
        shapes = {
            "state": (nbatch, steps, integration if with_memory else full),
            "sensordata": (nbatch, steps, model.nsensordata),
            "final_state": (nbatch, integration),
        }
        memory = with_memory or final_state is not None or starts.shape[1] != full
        inputs.check_same_sizes(engines, spec, with_contact_memory=memory)
        for name, array in given.items():
            if array.shape != shapes[name]:
                raise ValueError(f"{name} must be of shape {shapes[name]}, got {array.shape}")
        inputs.check_apart(given)

    if state is None and not with_memory:
        state = np.empty(shapes["state"])
    sensors = np.empty(shapes["sensordata"]) if sensordata is None else sensordata
    starts = inputs.repeated(starts, (nbatch, starts.shape[1]), given)
    if controls is not None:
        controls = inputs.repeated(controls, (nbatch, steps, controls.shape[2]), given)
    diverged, rows = _core.roll_out(
        [each._rollout_workers() for each in engines],
        starts,
        int(FULL_PHYSICS if starts.shape[1] == full else INTEGRATION),
        controls,
        control_spec=spec,
        nthread=threads,
        differentiable=False,
        fills_diverged=on_divergence == "nan",
        state=state,
        sensordata=sensors,
        last_state=final_state,
    )
    if diverged:
        warnings.warn(_said_of(diverged, nbatch), DivergenceWarning, stacklevel=2)
    return RolloutStates(rows, steps, integration) if state is None else state, sensors


def _moved_up(
    first: ArrayLike, second: ArrayLike | None, third: ArrayLike | None
) -> tuple[ArrayLike, ArrayLike | None]:
    """Return initial states and controls of a call without data, whose place the states take."""
    if second is None:
        return first, third
    if third is not None:
        raise TypeError(f"data is {type(first).__name__}; it must be a mujoco.MjData or a list")
    return first, second


def _said_of(diverged: list[tuple[int, int, str]], nbatch: int) -> str:
    """Return which rollouts diverged, the first hundred by number, and how the first one did."""
    first, step, what = diverged[0]
    named = ", ".join(str(index) for index, _, _ in diverged[:_MOST_NAMED])
    more = ", ..." if len(diverged) > _MOST_NAMED else ""
    return (
        f"{len(diverged)} of {nbatch} rollouts diverged and are nan from there on: {named}{more}; "
        f"rollout {first}, step {step}: {what}"
    )
