"""Predictions as a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

if TYPE_CHECKING:
    from dashpot.calibrate.prediction import Prediction

Array = NDArray[np.float64]


def prediction_errors(prediction: Prediction) -> dict[str, float]:
    """Return root mean squares of the errors, over what was measured.

    ``position_rms`` (m), ``rotation_rms`` (rad), ``sensors.NAME_rms``, ``events.NAME_rms`` and
    ``scalars.NAME_rms`` (in their units), each of the length of the vector; what was not measured
    is left out.
    """
    trajectory = prediction.trajectory
    moments = {
        f"{kind}.{name}_rms": (prediction.moments[name] - observed)[:, None]
        for kind, all_ in (("events", trajectory.events), ("scalars", trajectory.scalars))
        for name, observed in all_.items()
    }
    errors = {
        "position_rms": prediction.position_error,
        "rotation_rms": prediction.rotation_error,
        **{f"sensors.{name}_rms": error for name, error in prediction.sensor_errors.items()},
        **moments,
        **{f"residuals.{name}_rms": r[:, None] for name, r in prediction.residuals.items()},
    }
    return {name: _rms(error) for name, error in errors.items() if np.isfinite(error).any()}


def prediction_table(predictions: Sequence[Prediction]) -> Table:
    """Return a table with the errors of predictions, one row each."""
    rows = [prediction_errors(prediction) for prediction in predictions]
    names = list(dict.fromkeys(name for row in rows for name in row))
    table = Table(title="Prediction", caption="root mean squares over what was measured")
    table.add_column("trajectory")
    table.add_column("frames", justify="right")
    for name in names:
        table.add_column(_heading(name), justify="right")
    for prediction, row in zip(predictions, rows, strict=True):
        cells = [f"{row[name]:.4g}" if name in row else "-" for name in names]
        table.add_row(prediction.trajectory.name, str(prediction.trajectory.frames), *cells)
    return table


def _heading(name: str) -> str:
    units = {"position_rms": "position, m", "rotation_rms": "rotation, rad"}
    return units.get(name, name.partition(".")[2].removesuffix("_rms"))


def _rms(error: Array) -> float:
    seen = np.isfinite(error).any(axis=-1)
    return float(np.sqrt(np.mean(np.sum(np.nan_to_num(error[seen]) ** 2, axis=-1))))
