"""What rollouts take, checked: errors name the argument and where it is wrong."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TypeAlias

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot.checks import finite_array, number_array, positive_count, whole_number
from dashpot.engine import Engine

Array = NDArray[np.float64]
Data: TypeAlias = mujoco.MjData | Sequence[mujoco.MjData]

FULL_PHYSICS = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)
CONTROLS = int(mujoco.mjtState.mjSTATE_CTRL)
_GIVEN_FROM_OUTSIDE = int(mujoco.mjtState.mjSTATE_USER)
_USER_DATA = int(mujoco.mjtState.mjSTATE_USERDATA)
_OUTPUT_AXES = {"state": 3, "sensordata": 3, "final_state": 2}


class _WrongTypeError(TypeError, ValueError):
    """A TypeError, as elsewhere in dashpot, and the ValueError that `mujoco.rollout` raises."""


@contextmanager
def errors_of_mujoco() -> Iterator[None]:
    """Make each TypeError a ValueError too."""
    try:
        yield
    except TypeError as error:
        raise _WrongTypeError(str(error)) from None


def is_data(given: object) -> bool:
    """Whether it stands where `mujoco.rollout` has its data: one, or a list of them."""
    if isinstance(given, list | tuple):
        return not given or any(isinstance(each, mujoco.MjData) for each in given)
    return isinstance(given, mujoco.MjData)


def threads_of(data: Data | None, nthread: int | None) -> int:
    """Return the checked number of threads, one for each of `data`; 0: one per core."""
    threads = 0 if nthread is None else positive_count("nthread", nthread)
    if data is None:
        return threads
    datas = [data] if isinstance(data, mujoco.MjData) else list(data)
    if not datas:
        raise ValueError("data is an empty list")
    for index, each in enumerate(datas):
        if not isinstance(each, mujoco.MjData):
            raise TypeError(f"data[{index}] is {type(each).__name__}; it must be a mujoco.MjData")
        if each.threadpool:
            raise ValueError(f"data[{index}] has a thread pool")
    if threads not in (0, len(datas)):
        raise ValueError(f"nthread is {threads}, but data are {len(datas)}: one for each thread")
    return len(datas)


def engine_list(engine: Engine | Sequence[Engine]) -> list[Engine]:
    """Return the checked engines, of which there is at least one."""
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


def checked_spec(control_spec: int | mujoco.mjtState) -> int:
    """Return the bits of what controls hold."""
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


def initial_states(model: mujoco.MjModel, initial_state: ArrayLike | None) -> Array:
    """Return checked states, (1 or nbatch, nstate)."""
    if initial_state is None:
        raise TypeError("initial_state is missing")
    sizes = {
        "mjSTATE_FULLPHYSICS": state_size(model, FULL_PHYSICS),
        "mjSTATE_INTEGRATION": state_size(model, INTEGRATION),
    }
    states = np.atleast_2d(finite_array("initial_state", initial_state))
    if states.ndim != 2 or states.shape[0] == 0 or states.shape[1] not in sizes.values():
        known = " or ".join(f"{size} ({name})" for name, size in sizes.items())
        raise ValueError(
            f"initial_state must be (nbatch, nstate) with nstate {known} of engine.model, "
            f"got shape {states.shape}"
        )
    return states


def checked_controls(model: mujoco.MjModel, spec: int, control: ArrayLike) -> Array:
    """Return checked controls, (1 or nbatch, 1 or nstep, ncontrol)."""
    controls = np.atleast_1d(finite_array("control", control))
    size = state_size(model, spec)
    if controls.ndim > 3 or controls.shape[-1] != size:
        known = f"nu = {size}" if spec == CONTROLS else f"ncontrol = {size} by control_spec {spec}"
        raise ValueError(
            f"control must be (nbatch, nstep, ncontrol) with {known}, got shape {controls.shape}"
        )
    return controls.reshape((1,) * (3 - controls.ndim) + controls.shape)


def warmstart_count(model: mujoco.MjModel, initial_warmstart: ArrayLike) -> int:
    """Return how many accelerations to start from are given; no number of them is looked at."""
    given = np.atleast_2d(number_array("initial_warmstart", initial_warmstart))
    if given.ndim != 2 or given.shape[1] != model.nv:
        raise ValueError(
            f"initial_warmstart must be (nbatch, nv) with nv = {model.nv}, got shape {given.shape}"
        )
    return len(given)


def check_output(name: str, array: object) -> None:
    """Raise TypeError or ValueError where nothing can be written to an array."""
    ndim = _OUTPUT_AXES[name]
    if not isinstance(array, np.ndarray) or array.dtype != np.float64:
        kind = array.dtype if isinstance(array, np.ndarray) else type(array).__name__
        raise TypeError(f"{name} must be an array of float64 to write to, got {kind}")
    if array.ndim != ndim:
        known = {2: "two", 3: "three"}[ndim]
        raise ValueError(f"{name} must have {known} dimensions, got shape {array.shape}")
    if not (array.flags.c_contiguous and array.flags.writeable and array.flags.aligned):
        raise ValueError(f"{name} must be C-contiguous, aligned and writeable")


def common_size(
    name: str, given: dict[str, int], outputs: dict[str, Array], control: Array | None, *, axis: int
) -> int:
    """Size of a batch dimension: what is given and control's must agree, 1 repeats.

    A given `nstep` and the sizes of outputs are wishes, not sizes to repeat: of 1, the others have
    to be 1 too.
    """
    sizes = dict(given)
    sizes |= {name: array.shape[axis] for name, array in outputs.items() if array.ndim > axis + 1}
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


def check_same_sizes(engines: list[Engine], spec: int, *, with_contact_memory: bool) -> None:
    """Raise ValueError naming the first engine whose states, controls or sensors differ."""

    def sizes(model: mujoco.MjModel) -> dict[str, int]:
        contact_memory = {"an integration state": state_size(model, INTEGRATION)}
        return {
            "qpos": model.nq,
            "qvel": model.nv,
            "a full-physics state": state_size(model, FULL_PHYSICS),
            **(contact_memory if with_contact_memory else {}),
            "a control": state_size(model, spec),
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


def check_apart(outputs: dict[str, Array]) -> None:
    """Raise ValueError naming two outputs that share memory."""
    for one, other in itertools.combinations(outputs, 2):
        if np.may_share_memory(outputs[one], outputs[other]):
            raise ValueError(f"{one} and {other} share memory")


def repeated(array: Array, shape: tuple[int, ...], outputs: dict[str, Array]) -> Array:
    """Return an array of the shape to read from while outputs are written."""
    whole = np.ascontiguousarray(np.broadcast_to(array, shape))
    if any(np.may_share_memory(whole, output) for output in outputs.values()):
        return whole.copy()
    return whole


def state_size(model: mujoco.MjModel, spec: int) -> int:
    """Return the length of a vector of what `spec` names."""
    return int(mujoco.mj_stateSize(model, spec))
