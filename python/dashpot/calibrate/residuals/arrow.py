"""Jacobians of many trajectories whose initial states are unknown: block-arrow matrices.

The residuals of a trajectory depend on the parameters, which all share, and on its own initial
state, not on those of others. Everything else is 0 and not stored: of 400 throws that is 99.7 %.

Unknowns are in the order parameters, initial state of trajectory 0, of trajectory 1 ...
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ArrowMatrix:
    """A matrix (m, n) whose last columns are block-diagonal.

    Attributes
    ----------
    shared
        (m, p) columns of the parameters.
    own
        (m, s) of each row the columns of its own trajectory.
    offsets
        (trajectories + 1,) trajectory t has rows [t] to [t + 1].
    """

    shared: Array
    own: Array
    offsets: NDArray[np.intp]

    @classmethod
    def of_dense(cls, matrix: Array) -> ArrowMatrix:
        """Return a matrix of shared columns only."""
        return cls(matrix, np.empty((len(matrix), 0)), np.array([0, len(matrix)]))

    @property
    def trajectories(self) -> int:
        """Number of trajectories."""
        return len(self.offsets) - 1

    @property
    def size(self) -> int:
        """Number of columns, n."""
        return int(self.shared.shape[1] + self.trajectories * self.own.shape[1])

    def rows(self, trajectory: int) -> slice:
        """Return the rows of a trajectory."""
        return slice(self.offsets[trajectory], self.offsets[trajectory + 1])

    def parts(self, vectors: Array) -> tuple[Array, Array]:
        """Return views of ``(..., n)``: of the parameters, and of states (..., trajectories, s)."""
        count, size = self.shared.shape[1], self.own.shape[1]
        own = vectors[..., count:].reshape(*vectors.shape[:-1], self.trajectories, size)
        return vectors[..., :count], own

    def apply(self, vectors: Array) -> Array:
        """Return the products (..., m) with vectors (..., n)."""
        shared, own = self.parts(vectors)
        product = shared @ self.shared.T
        for t in range(self.trajectories):
            product[..., self.rows(t)] += own[..., t, :] @ self.own[self.rows(t)].T
        return np.asarray(product)

    def sums(self, products: Array) -> Array:
        """Return the sums (trajectories, ...) of the rows (m, ...) of each trajectory."""
        return np.asarray(np.add.reduceat(products, self.offsets[:-1], axis=0))

    def column_norms(self) -> Array:
        """Return the norms (n,) of the columns."""
        squares = np.concatenate(
            [np.sum(self.shared**2, axis=0), self.sums(self.own**2).reshape(-1)]
        )
        return np.asarray(np.sqrt(squares))

    def select(self, rows: NDArray[np.bool_]) -> ArrowMatrix:
        """Return the matrix with all rows but some (m,) set to 0."""
        weights = rows[:, None].astype(np.float64)
        return ArrowMatrix(self.shared * weights, self.own * weights, self.offsets)

    def held(self, weights: Array) -> tuple[ArrowMatrix, NDArray[np.intp]]:
        """Return the matrix with one more row for each initial state, and where its rows are then.

        The rows, behind those of the trajectory, weigh the distance from a state by (s,) `weights`;
        they are 0 for states on which nothing depends.
        """
        count, size = self.shared.shape[1], self.own.shape[1]
        rows = np.arange(len(self.shared))
        places = rows + size * (np.searchsorted(self.offsets, rows, side="right") - 1)
        offsets = self.offsets + size * np.arange(len(self.offsets))
        shared, own = np.zeros((offsets[-1], count)), np.zeros((offsets[-1], size))
        shared[places], own[places] = self.shared, self.own
        for t in range(self.trajectories):
            moves = self.own[self.rows(t)].any(axis=0)
            own[offsets[t + 1] - size : offsets[t + 1]] = np.diag(np.where(moves, weights, 0.0))
        return ArrowMatrix(shared, own, offsets), places

    def dense(self) -> Array:
        """Return it as an array (m, n), for problems that are small."""
        matrix = np.zeros((len(self.shared), self.size))
        shared, own = self.parts(matrix)
        shared[:] = self.shared
        for t in range(self.trajectories):
            own[self.rows(t), t] = self.own[self.rows(t)]
        return matrix


class ArrowInverse:
    """The pseudo-inverse of a block-arrow matrix, by elimination of the initial states.

    Columns are scaled to unit norm, so that rank is judged free of units. Of each trajectory, what
    of the parameters' columns its own can make up for is taken out; what is left of all of them
    determines the parameters.

    Parameters
    ----------
    matrix
        To be inverted.
    tolerance
        A direction whose singular value is below this fraction of the largest is undetermined, and
        so is an unknown of which more than its square root is in such a direction.

    Attributes
    ----------
    rank
        How many directions are determined.
    determined
        (n,) whether an unknown is.
    """

    def __init__(self, matrix: ArrowMatrix, tolerance: float) -> None:
        self._matrix = matrix
        norms = matrix.column_norms()
        self._scale = np.where(norms > 0.0, norms, 1.0)
        scale, own_scale = matrix.parts(self._scale)
        count, size, number = len(scale), matrix.own.shape[1], matrix.trajectories
        left = matrix.shared / scale
        blocks = [
            np.linalg.svd(matrix.own[matrix.rows(t)] / own_scale[t], full_matrices=False)
            for t in range(number if size else 0)
        ]
        largest = max((float(singular[0]) for _, singular, _ in blocks), default=0.0)
        #: (s, m_t) of each trajectory, pseudo-inverse of its own columns.
        self._own: list[Array] = []
        #: (trajectories, s, p) how its state makes up for a change of the parameters.
        self._follow = np.zeros((number, size, count))
        lost = np.zeros(matrix.size)
        _, lost_own = matrix.parts(lost)
        self.rank = 0
        self._leverage = np.zeros(len(matrix.shared))
        for t, (u, singular, v) in enumerate(blocks):
            kept = singular > tolerance * largest
            rows = matrix.rows(t)
            basis = u[:, kept]
            self._leverage[rows] = np.sum(basis**2, axis=1)
            self._own.append((v[kept].T / singular[kept]) @ basis.T)
            self._follow[t] = self._own[t] @ left[rows]
            left[rows] -= basis @ (basis.T @ left[rows])
            self.rank += int(np.count_nonzero(kept))
            lost_own[t] = np.abs(_null_space(v, kept)).max(axis=0, initial=0.0)
        u, singular, v = np.linalg.svd(left, full_matrices=False)
        kept = singular > tolerance * max(largest, float(singular.max(initial=0.0)))
        self.rank += int(np.count_nonzero(kept))
        self._leverage += np.sum(u[:, kept] ** 2, axis=1)
        #: (p, m) pseudo-inverse of what is left of the parameters' columns.
        self._shared = (v[kept].T / singular[kept]) @ u[:, kept].T
        for direction in _null_space(v, kept):
            whole = np.concatenate([direction, -(self._follow @ direction).reshape(-1)])
            lost = np.maximum(lost, np.abs(whole) / np.linalg.norm(whole))
        self.determined = (norms > 0.0) & (lost <= np.sqrt(tolerance))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the matrix."""
        return len(self._matrix.shared), self._matrix.size

    def leverages(self) -> Array:
        """Return the diagonal (m,) of the hat matrix, whose sum is the rank."""
        return self._leverage

    def solve(self, vectors: Array) -> Array:
        """Return the least-squares solutions (k, n) of ``J x = v`` for vectors (k, m)."""
        solutions = np.zeros((len(vectors), self._matrix.size))
        shared, own = self._matrix.parts(solutions)
        shared[:] = vectors @ self._shared.T
        for t, inverse in enumerate(self._own):
            own[:, t] = vectors[:, self._matrix.rows(t)] @ inverse.T - shared @ self._follow[t].T
        return solutions / self._scale

    def independent(self) -> Array:
        """Return the covariance blocks of the solution for residuals of unit variance."""
        number, size, count = self._follow.shape
        own = np.array([inverse @ inverse.T for inverse in self._own]).reshape(number, size, size)
        parameters = self._shared @ self._shared.T
        return self._blocks(parameters, np.zeros((number, count, size)), own)

    def clustered(self, scores: Array, offsets: NDArray[np.intp]) -> Array:
        """Return the covariance blocks for scores (m,) that hang together within clusters.

        They have the row ranges `offsets`, those of the trajectories where these have states.
        """
        moves = np.add.reduceat(self._shared * scores, offsets[:-1], axis=1).T
        parameters = moves.T @ moves
        number, size, count = self._follow.shape
        if size == 0:
            return self._blocks(parameters, np.zeros((number, count, 0)), np.zeros((number, 0, 0)))
        rows = self._matrix.rows
        states = np.array([inverse @ scores[rows(t)] for t, inverse in enumerate(self._own)])
        mixed = moves[:, :, None] * states[:, None, :]
        return self._blocks(parameters, mixed, states[:, :, None] * states[:, None, :])

    def correlated(self, covariance: Callable[[Array], Array]) -> Array:
        """Return the covariance blocks for residuals of a covariance C.

        Parameters
        ----------
        covariance
            Returns the products (k, m) of C with vectors (k, m).
        """
        number, size, count = self._follow.shape
        moved = covariance(self._shared)
        parameters = moved @ self._shared.T
        mixed, own = np.zeros((number, count, size)), np.zeros((number, size, size))
        for t, inverse in enumerate(self._own):
            rows = self._matrix.rows(t)
            mixed[t] = moved[:, rows] @ inverse.T
            whole = np.zeros((size, moved.shape[1]))
            whole[:, rows] = inverse
            own[t] = covariance(whole)[:, rows] @ inverse.T
        return self._blocks(parameters, mixed, own)

    def _blocks(self, parameters: Array, mixed: Array, own: Array) -> Array:
        """Return covariances (trajectories, p + s, p + s) of parameters and each initial state.

        A state is ``z - follow @ parameters``; `mixed` (trajectories, p, s) is the covariance of
        the parameters and z, `own` that of z. Undetermined unknowns have infinite variance.
        """
        count, follow = len(parameters), self._follow
        back = np.swapaxes(follow, 1, 2)
        blocks = np.empty((len(own), count + own.shape[1], count + own.shape[1]))
        blocks[:, :count, :count] = parameters
        blocks[:, :count, count:] = mixed - parameters @ back
        blocks[:, count:, :count] = np.swapaxes(blocks[:, :count, count:], 1, 2)
        cross = follow @ mixed
        blocks[:, count:, count:] = (
            follow @ parameters @ back - cross - np.swapaxes(cross, 1, 2) + own
        )
        scale = blocks_of(self._matrix, self._scale)
        blocks /= scale[:, :, None] * scale[:, None, :]
        lost = blocks_of(self._matrix, np.where(self.determined, 0.0, 1.0)) > 0.0
        blocks[lost[:, :, None] | lost[:, None, :]] = 0.0
        t, i = np.nonzero(lost)
        blocks[t, i, i] = np.inf
        return blocks


def blocks_of(matrix: ArrowMatrix, vectors: Array) -> Array:
    """Return ``(..., n)`` by trajectory: (..., trajectories, p + s), parameters first in each."""
    shared, own = matrix.parts(vectors)
    shape = (*shared.shape[:-1], matrix.trajectories, shared.shape[-1])
    return np.concatenate([np.broadcast_to(shared[..., None, :], shape), own], axis=-1)


def _null_space(v: Array, kept: NDArray[np.bool_]) -> Array:
    """Return the right singular vectors that are not kept, those beyond the rows included."""
    missing = v.shape[1] - len(v)
    if missing == 0:
        return v[~kept]
    rest = np.linalg.svd(v, full_matrices=True)[2][len(v) :]
    return np.concatenate([v[~kept], rest])
