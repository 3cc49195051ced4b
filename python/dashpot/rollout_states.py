"""States with contact memory, of which most numbers are zero."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# Of one rollout: the numbers that are not zero, their places, and where each step ends among them.
_SparseRows = tuple[Array, NDArray[np.int32], NDArray[np.int64]]


class RolloutStates:
    """States with contact memory, as `rollout(with_memory=True)` returns them.

    They read as an array (nbatch, nstep, nstate) of integration states, but only numbers that are
    not zero are kept: of contact memory those of contacts that touch. What is read is an ordinary
    array, of which nothing is written back: `states[i, k]` for ``mj_setState``, `states[:, -1]` to
    roll out from, `states[..., 1 : 1 + nq]` for positions. `numpy.asarray` makes all of it dense.
    An array of indices of the last axis takes whole rollouts and steps alone.

    Examples
    --------
    >>> engine = dashpot.Engine(mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
    ...   <geom type="plane" size="1 1 1"/>
    ...   <body pos="0 0 .1"><freejoint/><geom size=".1"/></body></worldbody></mujoco>'''))
    >>> start = [0.0, 0, 0, 0.1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0]  # time, qpos, qvel
    >>> states, _ = dashpot.rollout(engine, start, nstep=100, with_memory=True)
    >>> further, _ = dashpot.rollout(engine, states[:, 49], nstep=50)
    >>> bool((further[0, -1] == states[0, -1, :14]).all())
    True
    """

    dtype = np.dtype(np.float64)
    ndim = 3

    def __init__(self, rollouts: Sequence[_SparseRows], nstep: int, nstate: int) -> None:
        self._rollouts = list(rollouts)
        self.shape = (len(self._rollouts), nstep, nstate)

    @property
    def nbytes(self) -> int:
        """Bytes that are kept."""
        return sum(array.nbytes for rows in self._rollouts for array in rows)

    def __len__(self) -> int:
        """Return the number of rollouts."""
        return self.shape[0]

    def __iter__(self) -> Iterator[Array]:
        """Give the states of one rollout after another, (nstep, nstate)."""
        return (self[index] for index in range(len(self)))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Return all states, most of which are zeros, as an array; always a copy."""
        if copy is False:
            raise ValueError("sparse states are no array: a copy is needed")
        whole: Array = self[:]
        return whole.astype(dtype or self.dtype, copy=False)

    def __getitem__(self, key: Any) -> Any:
        """Return numbers as an array would, as a copy."""
        keys = list(key) if isinstance(key, tuple) else [key]
        for place, each in enumerate(keys):
            if each is Ellipsis:
                keys[place : place + 1] = [slice(None)] * (self.ndim - len(keys) + 1)
                break
        if len(keys) > self.ndim or any(each is None or each is Ellipsis for each in keys):
            raise IndexError(f"states have three axes to index, got {key!r}")
        numbers = keys[2] if len(keys) == self.ndim else slice(None)
        if not isinstance(numbers, slice | int | np.integer) and keys[:2] != [slice(None)] * 2:
            raise IndexError("take states[rollout, step] first, and an array of indices of it then")
        nbatch, nstep, nstate = self.shape
        rows = np.asarray(np.arange(nbatch * nstep).reshape(nbatch, nstep)[tuple(keys[:2])])
        result = np.empty(rows.shape + np.empty(nstate)[numbers].shape)
        for index, row in np.ndenumerate(rows):
            result[index] = self._row(int(row))[numbers]
        return result[()]

    def __repr__(self) -> str:
        """Return shape and size."""
        return f"RolloutStates(shape={self.shape}, nbytes={self.nbytes})"

    def _row(self, index: int) -> Array:
        """Return the state of a rollout and step, numbered through; NaN once it has diverged."""
        rollout, step = divmod(index, self.shape[1])
        values, places, ends = self._rollouts[rollout]
        if step >= len(ends):
            return np.full(self.shape[2], np.nan)
        row = np.zeros(self.shape[2])
        numbers = slice(ends[step - 1] if step else 0, ends[step])
        row[places[numbers]] = values[numbers]
        return row
