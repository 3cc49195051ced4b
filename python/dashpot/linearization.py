"""Derivatives of a step, for controllers and estimators."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot import _core
from dashpot.checks import finite_array, flag, number, thread_count
from dashpot.engine import Engine
from dashpot.step_tables import linearization_table
from dashpot.tables import table_html, table_text

Array = NDArray[np.float64]

_LEAST_EPS, _MOST_EPS = 1e-10, 1e-2
# What a step starts from, without user data: contact memory lies there.
_START = int(mujoco.mjtState.mjSTATE_INTEGRATION) & ~int(mujoco.mjtState.mjSTATE_USERDATA)
_END = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)


@dataclass(frozen=True, eq=False, repr=False)
class Linearization:
    """A step about a state and controls, ``x' = A x + B u`` and ``y = C x + D u``.

    All are deviations. x is (displacement of the configuration (nv), velocity (nv), activation
    (na)), nx = 2 nv + na numbers in the units of the model. Displacements are tangent vectors, as
    ``mj_differentiatePos`` has them: of a quaternion a rotation vector in the body's frame. u are
    controls, y the sensors of the step. It prints, and shows in notebooks, as a table of shapes and
    of A's largest eigenvalues: a motion that grows has one above 1.

    Attributes
    ----------
    A : (nx, nx)
    B : (nx, nu)
    C : (nsensordata, nx)
    D : (nsensordata, nu)

    Examples
    --------
    >>> step = dashpot.linearize(engine, data)
    >>> step.A.shape, step.B.shape, step.C.shape, step.D.shape
    ((24, 24), (24, 0), (0, 24), (0, 0))
    """

    A: Array
    B: Array
    C: Array
    D: Array

    def __repr__(self) -> str:
        """Return the table as text."""
        return table_text(linearization_table(self)).rstrip()

    def _repr_html_(self) -> str:
        """Return the table for notebooks."""
        return table_html(linearization_table(self))


def linearize(
    engine: Engine,
    data: mujoco.MjData,
    *,
    eps: float = 1e-6,
    centered: bool = True,
    nthread: int | None = None,
) -> Linearization:
    """Differentiate one step by finite differences, as ``mujoco.mjd_transitionFD`` does.

    The step is that of a state without contact memory. Friction springs start unstretched where the
    bodies are. Contacts of a given stiffness are compressed by their overlap, as in the first step
    of data. So the result is a function of the state alone, and what sticks has no stiffness
    against a displacement, but keeps its place. Where contact begins, ends or starts to slip within
    the step, the derivative jumps, and differences are of either side. Where a rigid contact is hit
    with friction within it, even the step jumps, by 1 to 3 % of the speed with where in the step
    that is. Differences are noise then. A material with a stiffness is smooth.

    Velocities at its end are those that the next step starts from. They have the second half of the
    step that `Engine.step` adds there to what contacts, limits and equalities hold, once it knows
    the forces at the end (docs/method.md, section 6). So powers of A follow the motion of many
    steps. What sticks by rigid friction gives way anew in each of these, as on a stiff damper. An
    upright pendulum of two links on a foot of 3 kg falls at 11.4/s by powers of A, at 11.1/s by
    steps.

    Parameters
    ----------
    engine
        Steps; it is only read.
    data
        Made by :meth:`Engine.make_data`: state, controls, applied forces, mocap poses and active
        equalities to linearize about. It is only read.
    eps
        Size of the differences, in [1e-10, 0.01], in the unit of each number that is displaced:
        smaller ones are lost in rounding, larger ones see no derivative.
    centered
        Differences of both sides, with errors of order ``eps**2``, in twice the number of steps.
        Controls at a limit of theirs are displaced away from it.
    nthread
        Number of threads, >= 1. None: one per core. The result does not depend on it.

    Raises
    ------
    TypeError
        If `engine` is no `Engine`, `data` no ``mujoco.MjData``, `eps` no number or
        `centered` no bool.
    ValueError
        If `eps` is out of range, `data` was made from another model, or a step fails.
    DivergenceError
        If the motion of a step diverges.

    Examples
    --------
    >>> flying = engine.make_data()
    >>> flying.qpos[2] = 2.0
    >>> A = dashpot.linearize(engine, flying).A
    >>> A[2, [2, engine.model.nv + 2]].round(6)  # height after a step, by height and by speed
    array([1.   , 0.005])
    """
    if not isinstance(engine, Engine):
        raise TypeError(f"engine is {type(engine).__name__}; it must be a dashpot.Engine")
    eps = number("eps", eps)
    if not _LEAST_EPS <= eps <= _MOST_EPS:
        raise ValueError(f"eps must be in [{_LEAST_EPS:g}, {_MOST_EPS:g}], got {eps:g}")
    centered = flag("centered", centered)
    engine._check_data(data)
    model = engine.model
    start = np.empty(mujoco.mj_stateSize(model, _START))
    mujoco.mj_getState(model, data, start, _START)

    nx = 2 * model.nv + model.na
    # By column of (A, B): the displacements of both sides, 0 where a side is left out.
    sides = np.zeros((nx + model.nu, 2))
    sides[:, 0] = -eps if centered else 0.0
    sides[:, 1] = eps
    _keep_within_limits(model, start[_places(model, mujoco.mjtState.mjSTATE_CTRL)], sides[nx:], eps)
    columns, of_side = np.nonzero(sides)
    states = _displaced(model, start, columns, sides[columns, of_side])
    stepped = np.empty((len(states), 1, mujoco.mj_stateSize(model, _END)))
    sensordata = np.empty((len(states), 1, model.nsensordata))
    _core.roll_out(
        [engine._rollout_workers()],
        finite_array("state", states),
        _START,
        control=None,
        control_spec=0,
        nthread=thread_count(nthread),
        differentiable=True,
        fills_diverged=False,
        state=stepped,
        sensordata=sensordata,
        last_state=None,
    )
    state, sensor = stepped[:, 0], sensordata[:, 0]

    index = np.zeros(sides.shape, dtype=int)  # of the step of each side; 0, that of no displacement
    index[columns, of_side] = 1 + np.arange(len(columns))
    width = np.diff(sides, axis=1)
    by_state = (_difference(model, state[index[:, 0]], state[index[:, 1]]) / width).T
    by_sensor = ((sensor[index[:, 1]] - sensor[index[:, 0]]) / width).T
    return Linearization(
        A=by_state[:, :nx], B=by_state[:, nx:], C=by_sensor[:, :nx], D=by_sensor[:, nx:]
    )


def _keep_within_limits(model: mujoco.MjModel, control: Array, sides: Array, eps: float) -> None:
    """Leave out displacements of a control (nu, 2) beyond a limit of its range.

    Where both are, both are kept: no step feels them.
    """
    limited = model.actuator_ctrllimited.astype(bool)
    limited &= not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
    least, most = model.actuator_ctrlrange.T
    at_low, at_high = limited & (control - eps < least), limited & (control + eps > most)
    sides[at_low & ~at_high] = [0.0, eps]
    sides[at_high & ~at_low] = [-eps, 0.0]


def _places(model: mujoco.MjModel, element: mujoco.mjtState) -> slice:
    """Return where an element lies in vectors of `_START`, and of `_END` if it is of both."""
    first = mujoco.mj_stateSize(model, _START & (int(element) - 1))
    return slice(first, first + mujoco.mj_stateSize(model, int(element)))


def _displaced(model: mujoco.MjModel, start: Array, columns: NDArray[np.int_], by: Array) -> Array:
    """Return `start`, then states in which number `columns[i]` of (x, u) is moved by `by[i]`."""
    states = np.tile(start, (1 + len(columns), 1))
    position = _places(model, mujoco.mjtState.mjSTATE_QPOS)
    numbers = np.arange(len(start))
    elements = (mujoco.mjtState.mjSTATE_QVEL, mujoco.mjtState.mjSTATE_ACT)
    rest = np.concatenate(
        [numbers[_places(model, each)] for each in (*elements, mujoco.mjtState.mjSTATE_CTRL)]
    )
    turns = columns < model.nv
    for row in np.flatnonzero(turns):
        direction = np.zeros(model.nv)
        direction[columns[row]] = 1.0
        mujoco.mj_integratePos(model, states[1 + row, position], direction, by[row])
    others = np.flatnonzero(~turns)
    states[1 + others, rest[columns[others] - model.nv]] += by[others]
    return states


def _difference(model: mujoco.MjModel, before: Array, after: Array) -> Array:
    """Return x (n, nx) of states at the end less that of others."""
    position, velocity, activation = (
        _places(model, each)
        for each in (
            mujoco.mjtState.mjSTATE_QPOS,
            mujoco.mjtState.mjSTATE_QVEL,
            mujoco.mjtState.mjSTATE_ACT,
        )
    )
    displacement = np.empty((len(before), model.nv))
    for row in range(len(before)):
        mujoco.mj_differentiatePos(
            model, displacement[row], 1.0, before[row, position], after[row, position]
        )
    change = after - before
    return np.hstack([displacement, change[:, velocity], change[:, activation]])
