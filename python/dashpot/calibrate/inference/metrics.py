"""How far off a fit is, in the units of what was measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.problem.problem import Problem

Array = NDArray[np.float64]


def root_mean_squares(
    problem: Problem, poses: Sequence[Array], sensors: Sequence[Mapping[str, Array]]
) -> dict[str, float]:
    """Return by name root mean squares of the lengths of residuals, weights taken off.

    Parameters
    ----------
    problem
        What was observed.
    poses
        By trajectory, (frames, bodies, 6) weighted residuals.
    sensors
        By trajectory and name, (frames, size) weighted residuals.
    """
    squares: dict[str, list[Array]] = {}
    for t in range(len(problem.trajectories)):
        for name, errors, measured in _errors(problem, t, poses[t], sensors[t]):
            seen = measured.any(axis=-1)
            lengths = np.sum(np.where(measured, errors, 0.0)[seen] ** 2, axis=-1)
            squares.setdefault(name, []).append(lengths)
    pooled = {name: np.concatenate(parts) for name, parts in squares.items()}
    return {name: float(np.sqrt(np.mean(all_))) for name, all_ in pooled.items() if all_.size}


def _errors(
    problem: Problem, t: int, poses: Array, sensors: Mapping[str, Array]
) -> Iterator[tuple[str, Array, NDArray[np.bool_]]]:
    """Yield name, errors (..., components) and whether these were measured, of a trajectory."""
    seen_poses, channels = problem.layouts()[t].split(problem.measured()[t])
    sigma = np.where(np.isfinite(problem.sigma), problem.sigma, 0.0)
    for name, part in (("position_rms", slice(0, 3)), ("rotation_rms", slice(3, 6))):
        yield name, poses[..., part] * sigma[part], seen_poses[..., part]
    for name, seen in problem.trajectories[t].by_sensor(channels).items():
        deviations = np.asarray(problem.sensor_sigma[name])
        deviations = np.where(np.isfinite(deviations), deviations, 0.0)
        yield f"sensors.{name}_rms", sensors[name] * deviations, seen
