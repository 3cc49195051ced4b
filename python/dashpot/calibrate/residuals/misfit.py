"""Residuals as noise of the size and the correlation in time that they have, channel by channel.

Of a robust loss they stand for its scores, which outliers do not move.

Of a model that is not quite right residuals hang together from reading to reading, and intervals of
independent ones are too narrow. With the Jacobian J and the covariance C of the residuals the
covariance of a least-squares estimate is

    (J^T J)^-1 J^T C J (J^T J)^-1

(Huber, 1967; White, Econometrica 48, 1980). C is diagonal for a channel that is white, with the
variance of its residuals. Else each of its columns has the autocovariances of its residuals,
tapered by Bartlett's window (Newey and West, Econometrica 55, 1987), whose width is that of an
autoregressive process of first order of the same correlation (Andrews, Econometrica 59, 1991).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import matmul_toeplitz

from dashpot.calibrate.residuals.objective import Objective

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Column:
    """The residuals of one number of a channel, and the covariance of these."""

    rows: NDArray[np.intp]
    autocovariance: Array  # of as many lags as it has, 0 beyond


@dataclass(frozen=True, eq=False)
class ResidualCovariance:
    """A covariance (m, m) of residuals that is made of blocks."""

    columns: tuple[_Column, ...]

    def apply(self, vectors: Array) -> Array:
        """Return the products (k, m) with vectors (k, m)."""
        result = np.zeros_like(vectors)
        for column in self.columns:
            own = vectors[:, column.rows]
            if column.autocovariance.size == 1:
                result[:, column.rows] = column.autocovariance[0] * own
                continue
            lags = np.zeros(column.rows.size)
            lags[: column.autocovariance.size] = column.autocovariance
            result[:, column.rows] = matmul_toeplitz(lags, own.T).T
        return result


def residual_covariance(
    objective: Objective, residuals: Array, counted: NDArray[np.bool_], coloured: Collection[str]
) -> ResidualCovariance:
    """Return the covariance of residuals (m,), of those `counted`, for channels by name.

    Those of `coloured` channels hang together in time; the others are white, each channel with a
    variance of its own.
    """
    found: dict[str, list[NDArray[np.intp]]] = {}
    for first, layout in zip(objective.offsets, objective.layouts, strict=False):
        for name, places in layout.groups():
            kept = [column[counted[column]] for column in (first + places).T]
            found.setdefault(name, []).extend(column for column in kept if column.size)
    columns = []
    for name, all_rows in found.items():
        if not all_rows:
            continue
        together = np.concatenate(all_rows)
        variance = float(np.mean(residuals[together] ** 2))
        for rows in all_rows:
            own = _tapered(residuals[rows]) if name in coloured else np.array([variance])
            columns.append(_Column(rows, own))
    starts = np.flatnonzero(counted & ~objective.moving)
    if starts.size:
        columns.append(_Column(starts, np.ones(1)))
    return ResidualCovariance(tuple(columns))


def _tapered(values: Array) -> Array:
    """Return autocovariances at lags from 0, those of Bartlett's window."""
    count = values.size
    square = float(values @ values)
    correlation = float(values[1:] @ values[:-1]) / square if square > 0.0 else 0.0
    correlation = min(max(correlation, 0.0), 0.97)
    steep = 4.0 * correlation**2 / (1.0 - correlation**2) ** 2
    width = min(1.1447 * (steep * count) ** (1.0 / 3.0), 0.5 * count)
    lags = np.arange(int(width) + 1)
    full = np.array([values[k:] @ values[: count - k] for k in lags]) / count
    return np.asarray(full * (1.0 - lags / (width + 1.0)))
