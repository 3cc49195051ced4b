"""How far off a fit is, in the units of what was measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.problem.channels import Channel
from dashpot.calibrate.problem.problem import Problem

Array = NDArray[np.float64]


def root_mean_squares(
    problem: Problem, residuals: Sequence[Mapping[str, Array]]
) -> dict[str, float]:
    """Return by name root mean squares of the lengths of residuals, weights taken off.

    Parameters
    ----------
    problem
        What was observed.
    residuals
        By trajectory and channel, (rows, columns) weighted residuals.
    """
    squares: dict[str, list[Array]] = {}
    for trajectory, of_channels in zip(problem.trajectories, residuals, strict=True):
        for channel in problem.channels(trajectory):
            for name, errors, measured in _errors(channel, of_channels[channel.name]):
                seen = measured.any(axis=-1)
                lengths = np.sum(np.where(measured, errors, 0.0)[seen] ** 2, axis=-1)
                squares.setdefault(name, []).append(lengths)
    pooled = {name: np.concatenate(parts) for name, parts in squares.items()}
    return {name: float(np.sqrt(np.mean(all_))) for name, all_ in pooled.items() if all_.size}


def _errors(channel: Channel, weighted: Array) -> Iterator[tuple[str, Array, NDArray[np.bool_]]]:
    """Yield name, errors (..., components) and whether these were measured, of a channel."""
    errors = weighted * np.where(np.isfinite(channel.sigma), channel.sigma, 0.0)
    if channel.kind != "poses":
        yield f"{channel.kind}s.{channel.name}_rms", errors, channel.measured
        return
    errors, measured = errors.reshape(-1, 6), channel.measured.reshape(-1, 6)
    yield "position_rms", errors[:, :3], measured[:, :3]
    yield "rotation_rms", errors[:, 3:], measured[:, 3:]
