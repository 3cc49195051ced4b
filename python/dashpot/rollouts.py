"""Many open-loop rollouts in parallel."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot import _core
from dashpot.checks import finite_array, flag, positive_count, thread_count, whole_number
from dashpot.engine import Engine

Array = NDArray[np.float64]

_FULL_PHYSICS = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
_INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_CONTROLS = int(mujoco.mjtState.mjSTATE_CTRL)
_GIVEN_FROM_OUTSIDE = int(mujoco.mjtState.mjSTATE_USER)
_USER_DATA = int(mujoco.mjtState.mjSTATE_USERDATA)
_MOST_NAMED = 100


class DivergenceWarning(UserWarning):
    """Rollouts diverged, and were filled with NaN as `rollout(on_divergence="nan")` asks."""


def rollout(
    engine: Engine | Sequence[Engine],
    initial_state: ArrayLike,
    control: ArrayLike | None = None,
    *,
    control_spec: int | mujoco.mjtState = _CONTROLS,
    nstep: int | None = None,
    nthread: int | None = None,
    with_memory: bool = True,
    on_divergence: Literal["raise", "nan"] = "raise",
    state: Array | None = None,
    sensordata: Array | None = None,
) -> tuple[Array, Array]:
    """Step many initial states, or many control sequences, in parallel C++ threads.

    Shapes are those of `mujoco.rollout.rollout`; the GIL is released, and Ctrl-C ends the batch, of
    which nothing comes back then. Every rollout is what `Engine.step` on one data would give, bit
    for bit, whatever the number of threads. Which trees sleep (``<flag sleep="enable"/>``) is in no
    state of MuJoCo's: all begin awake, as after ``mj_setState``.

    Parameters
    ----------
    engine
        Steps; it is only read, as it is before or after the steps that other threads take with it.
        Its model must not be edited meanwhile. Or a sequence of nbatch engines, one for each
        rollout, whose models have the same sizes: other materials, masses or options, say.
    initial_state
        (nstate,), (1, nstate) or (nbatch, nstate). Either full-physics states (``nstate ==
        mj_stateSize(model, mjSTATE_FULLPHYSICS)``), which start without contact memory and without
        applied forces, and with mocap bodies where the model has them, as `mujoco.rollout` does; or
        integration states (``mjSTATE_INTEGRATION``), which carry contact memory (friction and
        compression, kept in the data's user data), controls, applied forces and poses of mocap
        bodies, so that a rollout goes on from an earlier one bit for bit. Where the two sizes are
        equal they hold the same.
    control
        (ncontrol,), (nstep, ncontrol) or (nbatch, nstep, ncontrol), dimensions of size 1 repeated;
        ``ncontrol == mj_stateSize(model, control_spec)``. None: zero, or, for integration states,
        what the state holds.
    control_spec
        What `control` holds, bits of ``mjtState``: controls, and with them or in their place
        applied forces, poses of mocap bodies and which equalities are active, in the order of
        ``mj_setState`` (``mjSTATE_CTRL | mjSTATE_MOCAP_POS``, say). Not user data, where contact
        memory lies.
    nstep
        Number of steps, >= 1. None: from `control`, `state` or `sensordata`, else 1.
    nthread
        Number of threads, >= 1. None: one per core. The engine keeps their data for the next call.
    with_memory
        False: integration states come back as full-physics states. Contact memory is most of the
        state of a robot, 100 kB of it in every step: with it, many rollouts take several times as
        long and as much memory.
    on_divergence
        What a rollout does whose state diverges: "raise" ends all of them; "nan" fills its states
        and sensor data from that step on with NaN, leaves the others as they are, bit for bit, and
        gives a `DivergenceWarning` that names the rollouts.
    state, sensordata
        Where to write what is returned, C-contiguous, of float64 and of the shapes below. None: new
        arrays. After an exception they hold some of it.

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
        If `engine` is no `Engine` or sequence of them, `state` or `sensordata` no array of float64,
        and for arguments that are not numbers.
    ValueError
        For shapes that do not fit and numbers that are not finite, naming argument and index, for
        bits in `control_spec` that are nothing given from outside, and where a rollout fails,
        naming rollout and step.
    DivergenceError
        Where a rollout diverges, naming rollout and step, unless `on_divergence` is "nan".

    Examples
    --------
    >>> model = mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
    ...   <body><joint type="slide" axis="0 0 1"/><geom size=".1"/></body></worldbody></mujoco>''')
    >>> engine = Engine(model)
    >>> starts = [[0.0, height, 0.0] for height in (1.0, 2.0)]  # time, qpos, qvel
    >>> states, _ = rollout(engine, starts, nstep=100)
    >>> states[:, -1, 1].round(3)
    array([0.802, 1.802])
    """
    engines = _engines(engine)
    spec = _control_spec(control_spec)
    with_memory = flag("with_memory", with_memory)
    if on_divergence not in ("raise", "nan"):
        raise ValueError(f"on_divergence is {on_divergence!r}; it must be 'raise' or 'nan'")
    starts = _initial_states(engines[0].model, initial_state)
    controls = None if control is None else _controls(engines[0].model, spec, control)
    outputs = {"state": state, "sensordata": sensordata}
    given = {name: array for name, array in outputs.items() if array is not None}
    for name, array in given.items():
        _check_output(name, array)

    repeated = {"engine": len(engines), "initial_state": len(starts)}
    nbatch = _common("nbatch", repeated, given, controls, axis=0)
    nsteps = {} if nstep is None else {"nstep": positive_count("nstep", nstep)}
    steps = _common("nstep", nsteps, given, controls, axis=1)

    start_size = starts.shape[1]
    full_size = _size(engines[0].model, _FULL_PHYSICS)
    shapes = {
        "state": (nbatch, steps, start_size if with_memory else full_size),
        "sensordata": (nbatch, steps, engines[0].model.nsensordata),
    }
    _check_same_sizes(engines, spec, with_contact_memory=start_size != full_size)
    for name, array in given.items():
        if array.shape != shapes[name]:
            raise ValueError(f"{name} must be of shape {shapes[name]}, got {array.shape}")
    if len(given) == 2 and np.may_share_memory(given["state"], given["sensordata"]):
        raise ValueError("state and sensordata share memory")
    states, sensors = (given.get(name, np.empty(shapes[name])) for name in shapes)

    starts = _repeated(starts, (nbatch, start_size), given)
    if controls is not None:
        controls = _repeated(controls, (nbatch, steps, controls.shape[2]), given)
    diverged = _core.roll_out(
        [each._rollout_workers() for each in engines],
        starts,
        controls,
        control_spec=spec,
        nthread=thread_count(nthread),
        differentiable=False,
        fills_diverged=on_divergence == "nan",
        state=states,
        sensordata=sensors,
    )
    if diverged:
        warnings.warn(_said_of(diverged, nbatch), DivergenceWarning, stacklevel=2)
    return states, sensors


def _said_of(diverged: list[tuple[int, int, str]], nbatch: int) -> str:
    """Return which rollouts diverged, the first hundred by number, and how the first one did."""
    first, step, what = diverged[0]
    named = ", ".join(str(index) for index, _, _ in diverged[:_MOST_NAMED])
    more = ", ..." if len(diverged) > _MOST_NAMED else ""
    return (
        f"{len(diverged)} of {nbatch} rollouts diverged and are nan from there on: {named}{more}; "
        f"rollout {first}, step {step}: {what}"
    )


def _engines(engine: Engine | Sequence[Engine]) -> list[Engine]:
    if isinstance(engine, Engine):
        return [engine]
    if not isinstance(engine, Sequence) or isinstance(engine, str):
        raise TypeError(
            f"engine is {type(engine).__name__}; it must be a dashpot.Engine or a sequence of them"
        )
    for index, each in enumerate(engine):
        if not isinstance(each, Engine):
            raise TypeError(
                f"engine[{index}] is {type(each).__name__}; it must be a dashpot.Engine"
            )
    if not engine:
        raise ValueError("engine is an empty sequence")
    return list(engine)


def _control_spec(control_spec: int | mujoco.mjtState) -> int:
    if isinstance(control_spec, mujoco.mjtState):
        control_spec = int(control_spec)
    spec = whole_number("control_spec", control_spec, lowest=1)
    if spec & _USER_DATA:
        raise ValueError(
            f"control_spec {spec} has mjSTATE_USERDATA: engines keep contact memory in user data"
        )
    if spec & ~_GIVEN_FROM_OUTSIDE:
        raise ValueError(
            f"control_spec {spec} has bits that are not in mjSTATE_USER ({_GIVEN_FROM_OUTSIDE}): "
            "only what is given from outside can be a control"
        )
    return spec


def _initial_states(model: mujoco.MjModel, initial_state: ArrayLike) -> Array:
    """Return checked states, (1 or nbatch, nstate)."""
    sizes = {
        "mjSTATE_FULLPHYSICS": _size(model, _FULL_PHYSICS),
        "mjSTATE_INTEGRATION": _size(model, _INTEGRATION),
    }
    states = np.atleast_2d(finite_array("initial_state", initial_state))
    if states.ndim != 2 or states.shape[0] == 0 or states.shape[1] not in sizes.values():
        known = " or ".join(f"{size} ({name})" for name, size in sizes.items())
        raise ValueError(
            f"initial_state must be (nbatch, nstate) with nstate {known} of engine.model, "
            f"got shape {states.shape}"
        )
    return states


def _controls(model: mujoco.MjModel, spec: int, control: ArrayLike) -> Array:
    """Return checked controls, (1 or nbatch, 1 or nstep, ncontrol)."""
    controls = finite_array("control", control)
    size = _size(model, spec)
    if controls.ndim > 3 or controls.ndim == 0 or controls.shape[-1] != size:
        known = f"nu = {size}" if spec == _CONTROLS else f"ncontrol = {size} by control_spec {spec}"
        raise ValueError(
            f"control must be (nbatch, nstep, ncontrol) with {known}, got shape {controls.shape}"
        )
    return controls.reshape((1,) * (3 - controls.ndim) + controls.shape)


def _check_output(name: str, array: object) -> None:
    if not isinstance(array, np.ndarray) or array.dtype != np.float64:
        kind = array.dtype if isinstance(array, np.ndarray) else type(array).__name__
        raise TypeError(f"{name} must be an array of float64 to write to, got {kind}")
    if array.ndim != 3:
        raise ValueError(f"{name} must have three dimensions, got shape {array.shape}")
    if not (array.flags.c_contiguous and array.flags.writeable and array.flags.aligned):
        raise ValueError(f"{name} must be C-contiguous, aligned and writeable")


def _common(
    name: str, given: dict[str, int], outputs: dict[str, Array], control: Array | None, *, axis: int
) -> int:
    """Size of a batch dimension: what is given and control's must agree, 1 repeats.

    A given `nstep` and the sizes of outputs are wishes, not sizes to repeat: of 1, the others have
    to be 1 too.
    """
    sizes = dict(given) | {output: array.shape[axis] for output, array in outputs.items()}
    if control is not None:
        sizes["control"] = control.shape[axis]
    result = max(sizes.values(), default=1)
    for argument, size in sizes.items():
        wished = argument == "nstep" or argument in outputs
        if size == 0 or size not in (1, result) or (wished and size != result):
            raise ValueError(
                f"{name} does not agree: "
                + ", ".join(f"{argument} has {size}" for argument, size in sizes.items())
            )
    return result


def _check_same_sizes(engines: list[Engine], spec: int, *, with_contact_memory: bool) -> None:
    """Raise ValueError naming the first engine whose states, controls or sensors differ."""

    def sizes(model: mujoco.MjModel) -> dict[str, int]:
        contact_memory = {"an integration state": _size(model, _INTEGRATION)}
        return {
            "qpos": model.nq,
            "qvel": model.nv,
            "a full-physics state": _size(model, _FULL_PHYSICS),
            **(contact_memory if with_contact_memory else {}),
            "a control": _size(model, spec),
            "sensordata": model.nsensordata,
        }

    first = sizes(engines[0].model)
    for index, engine in enumerate(engines):
        for what, size in sizes(engine.model).items():
            if size != first[what]:
                raise ValueError(
                    f"engines differ: {what} has {size} numbers in engine[{index}], "
                    f"{first[what]} in engine[0]"
                )


def _repeated(array: Array, shape: tuple[int, ...], outputs: dict[str, Array]) -> Array:
    """Return an array of the shape to read from while outputs are written."""
    whole = np.ascontiguousarray(np.broadcast_to(array, shape))
    if any(np.may_share_memory(whole, output) for output in outputs.values()):
        return whole.copy()
    return whole


def _size(model: mujoco.MjModel, spec: int) -> int:
    return int(mujoco.mj_stateSize(model, spec))
