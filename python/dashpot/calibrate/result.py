"""The result of a calibration."""

from __future__ import annotations

import html
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.inference.combinations import Combination, combinations
from dashpot.calibrate.inference.estimate import Estimate
from dashpot.calibrate.inference.explanation import Explanation
from dashpot.calibrate.inference.metrics import root_mean_squares
from dashpot.calibrate.inference.misfit_report import ChannelReport
from dashpot.calibrate.inference.sampling import draw
from dashpot.calibrate.inference.stated_noise import noise_explains, noise_overstated
from dashpot.calibrate.outputs import Outputs
from dashpot.calibrate.prediction import Predictions, predict, predictions
from dashpot.calibrate.problem.channels import POSES
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.provenance import Provenance
from dashpot.calibrate.readback import Readback
from dashpot.calibrate.residuals.losses import LossName
from dashpot.checks import positive_count, thread_count, whole_number
from dashpot.tables import table_html, table_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dashpot.calibrate.report.record import Record

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Fit(Outputs, Readback):
    """Estimates, their intervals and how well they explain the data.

    It can be pickled where the functions of its parameters and system can. A search goes on from it
    where parameters start at its ``values``.

    Attributes
    ----------
    estimates
        One `Estimate` per parameter; ``fit["name"]`` finds one by name.
    correlation
        (parameters, parameters) correlation of the estimates in the search coordinates.
    channel_residuals
        By trajectory and channel (``"poses"``, names of sensors, kinds of events and scalars),
        (rows, columns): weighted residuals at the estimate; 0 of what was not measured.
    cost
        Half the sum of squares, after the loss.
    cost_history
        (batches of the search,) lowest cost so far in the window being searched.
    residual_variance
        Variance of the weighted residuals that carry noise (chi-square per degree of freedom):
        near 1 when the stated noise explains them. Standard errors are scaled with its root. Of
        robust losses the square of the 0.7-quantile of their magnitudes over that of normal noise.
        It stays below 1.4 up to about 10 % of outliers, and a misfit of more than 30 % shows.
    live_residuals
        Number of residuals that carry noise. Channels (trajectory, body, component) that were not
        measured, or whose residuals all vanish, do not count. All that were measured do where there
        is no noise at all.
    evaluations
        Simulated sets of all trajectories, those for derivatives and intervals included.
    seconds
        Wall time of the fit.
    method, loss, loss_scale, errors, confidence
        How it was made; ``errors`` is "independent" or "clustered".
    converged
        Whether the search ended by its own criterion rather than by the budget; where not, no
        parameter counts as identified.
    message
        The search's last word.
    channels
        What the residuals say of each channel: their size, and whether they hang together.
    explanations
        Where some do, or are larger than stated noise: which delay, gain, offset, scale or sampling
        of a recorder would explain it, best first; empty where none does.
    initial_velocity, initial_displacement
        (trajectories, nv) where estimated, else None.
    frame_pace
        (trajectories,) how many times as far apart as stated frames are; None where no trajectory
        has a rate that is not known exactly (``rate_sigma``).
    made
        Versions, seed, date and the hash of the model.

    Examples
    --------
    >>> {name: float(f"{value:.2g}") for name, value in result.values.items()}
    {'stiffness': 10000.0, 'restitution': 0.6}
    >>> result.converged, round(result.residual_variance, 1)
    (True, 0.9)
    """

    estimates: tuple[Estimate, ...]
    correlation: Array
    channel_residuals: tuple[Mapping[str, Array], ...]
    cost: float
    cost_history: Array
    residual_variance: float
    live_residuals: int
    evaluations: int
    seconds: float
    method: str
    loss: LossName
    loss_scale: float
    errors: str
    confidence: float
    converged: bool
    message: str
    problem: Problem = field(repr=False)
    initial_velocity: Array | None = None
    initial_displacement: Array | None = None
    channels: tuple[ChannelReport, ...] = ()
    explanations: tuple[Explanation, ...] = ()
    made: Provenance | None = None
    frame_pace: Array | None = None
    _record: Record | None = field(default=None, repr=False)

    def __getitem__(self, name: str) -> Estimate:
        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        known = ", ".join(e.name for e in self.estimates)
        raise KeyError(f"no parameter named {name!r}; there are {known}")

    def __contains__(self, name: object) -> bool:
        return any(estimate.name == name for estimate in self.estimates)

    def __iter__(self) -> Iterator[str]:
        return (estimate.name for estimate in self.estimates)

    def __str__(self) -> str:
        """Return the table as text."""
        return table_text(self.table())

    def _repr_html_(self) -> str:
        """Return the table for notebooks, and the statements."""
        said = [f"{e.name}: {e.statement}" for e in self.estimates]
        items = "".join(f"<li>{html.escape(s)}</li>" for s in [*said, *map(str, self.explanations)])
        return f"{table_html(self.table())}<ul>{items}</ul>"

    def __repr__(self) -> str:
        """Return estimates and how the search ended, without the arrays."""
        values = ", ".join(f"{name}={value:.6g}" for name, value in self.values.items())
        return (
            f"Fit({values}, residual_variance={self.residual_variance:.3g}, "
            f"converged={self.converged})"
        )

    @property
    def values(self) -> dict[str, float]:
        """Estimates by name, then the values of frozen parameters."""
        return {e.name: e.value for e in self.estimates} | self.problem.held

    @property
    def residuals(self) -> tuple[Array, ...]:
        """Weighted residuals of poses at the estimate, by trajectory (frames, bodies, 6).

        Of positions in the world frame, then rotation vectors of ``R_observed^T R_simulated``; 0 of
        what was not measured.
        """
        return tuple(
            channels.get(POSES, np.empty((0, 0))).reshape(-1, len(trajectory.bodies), 6)
            if trajectory.bodies
            else np.empty((trajectory.frames, 0, 6))
            for trajectory, channels in zip(
                self.problem.trajectories, self.channel_residuals, strict=True
            )
        )

    @property
    def sensor_residuals(self) -> tuple[dict[str, Array], ...]:
        """By trajectory and sensor, (readings, size): weighted residuals at the estimate."""
        return tuple(
            {name: channels[name] for name in trajectory.sensors}
            for trajectory, channels in zip(
                self.problem.trajectories, self.channel_residuals, strict=True
            )
        )

    @property
    def covariance(self) -> Array:
        """(parameters, parameters) covariance in the parameters' units, to first order.

        As `scipy.optimize.curve_fit` gives it: scaled with the residuals, and infinite where the
        data say nothing of a parameter. Intervals follow the cost and go farther where that is not
        a parabola.
        """
        error = np.array([e.standard_error for e in self.estimates])
        unknown = ~np.isfinite(error)
        known = np.where(unknown, 1.0, error)
        return np.asarray(
            np.where(
                unknown[:, None] | unknown[None, :],
                np.inf,
                self.correlation * np.outer(known, known),
            )
        )

    def sample(self, count: int, *, seed: int) -> list[dict[str, float]]:
        """Draw values of the parameters by name, as likely as the fit holds them.

        ``[fit.problem.build(values) for values in fit.sample(16, seed=1)]`` are engines for
        `dashpot.rollout`, whose spread is what the fit leaves open.

        Each parameter has the distribution of which its interval is that of the confidence, and
        together they have the `correlation`. What the data say nothing of is spread over its range
        (`dashpot.calibrate.inference.sampling`). They hold where the intervals do.

        Parameters
        ----------
        count
            Number of draws, >= 1.
        seed
            Of chance, >= 0: the same draws for the same seed.

        Raises
        ------
        TypeError, ValueError
            If a number is no integer or out of range.

        Examples
        --------
        >>> drawn = result.sample(3, seed=0)
        >>> engines = [problem.build(values) for values in drawn]
        >>> len(engines), sorted(drawn[0])
        (3, ['restitution', 'stiffness'])
        """
        values = draw(
            self.problem.unknowns,
            self.estimates,
            self.correlation,
            self.confidence,
            positive_count("count", count),
            np.random.default_rng(whole_number("seed", seed, lowest=0)),
        )
        names = [e.name for e in self.estimates]
        held = self.problem.held
        return [dict(zip(names, map(float, row), strict=True)) | held for row in values]

    @property
    def noise_explains(self) -> bool:
        """Whether the stated noise explains the residuals: their variance is 1 to three sigma.

        Robust losses are allowed a tenth of outliers beside.

        Where it does not, the model may differ from what was observed. Independent errors are too
        small then: see ``errors`` of `fit`) or the search ended in a bad valley (try more
        ``starts``, or ``windows``).
        """
        return noise_explains(
            self.residual_variance, self.live_residuals, robust=self.loss != "linear"
        )

    @property
    def noise_overstated(self) -> bool:
        """Whether the stated noise is far larger than the residuals: their variance is below 0.67.

        Data without any noise are so too.
        """
        return noise_overstated(
            self.residual_variance, self.live_residuals, robust=self.loss != "linear"
        )

    @property
    def misfits(self) -> tuple[ChannelReport, ...]:
        """Channels in which the model is not right, or noise is not white.

        Their residuals hang together in time. A right model with white noise has such a channel in
        less than one of a hundred fits. `explanations` say what may be behind it.
        """
        return tuple(channel for channel in self.channels if channel.misfit)

    @property
    def combinations(self) -> tuple[Combination, ...]:
        """Products of powers of parameters that the data know independently of each other.

        Those known best come first; of all parameters that are searched in the logarithm and that
        the residuals depend on. They hold where the intervals of these parameters do.
        """
        chosen = [
            i
            for i, (parameter, estimate) in enumerate(
                zip(self.problem.unknowns, self.estimates, strict=True)
            )
            if parameter.transform == "log" and np.isfinite(estimate.standard_error)
        ]
        estimates = [self.estimates[i] for i in chosen]
        return combinations(
            [e.name for e in estimates],
            [e.value for e in estimates],
            np.array([e.standard_error / e.value for e in estimates]),
            self.correlation[np.ix_(chosen, chosen)],
        )

    def predict(
        self,
        trajectories: Sequence[Trajectory] | None = None,
        *,
        head: float | None = None,
        nthread: int | None = None,
    ) -> Predictions:
        """Simulate trajectories to their ends with the estimates, and compare.

        Parameters
        ----------
        trajectories
            Others than those fitted, each from the state that it carries, or that is fitted to its
            `head` with the estimates held: see `dashpot.calibrate.predict`. None: those fitted,
            from the initial states that the fit estimates; within the problem's window their
            errors are its residuals, unweighted.
        head
            Seconds of each of `trajectories`, > 0 and shorter than it, to which its initial state
            is fitted, with the loss of the fit.
        nthread
            Number of threads, >= 1. None: one per core. The result does not depend on it.

        Raises
        ------
        TypeError, ValueError
            As `dashpot.calibrate.predict`; and for a `head` without `trajectories`.

        Examples
        --------
        >>> (prediction,) = result.predict()
        >>> prediction.position.shape
        (41, 1, 3)
        """
        if not isinstance(self.problem, Problem):
            raise ValueError(
                f"predict needs the problem, which the fit was loaded without: {self.problem}; "
                "give it to Fit.load"
            )
        if trajectories is not None:
            return predict(
                self.problem,
                self.values,
                trajectories,
                head=head,
                loss=self.loss,
                loss_scale=self.loss_scale,
                nthread=nthread,
            )
        if head is not None:
            raise ValueError("head is for other trajectories; the fit has the states of its own")
        return predictions(self.problem, self.values, self.states, thread_count(nthread))

    @property
    def states(self) -> Array:
        """Unknowns beside the parameters as in points of the search, trajectory by trajectory."""
        pace = None if self.frame_pace is None else self.frame_pace[:, None] - 1.0
        parts = [self.initial_velocity, self.initial_displacement, pace]
        found = [part for part in parts if part is not None]
        return np.concatenate(found, axis=1).reshape(-1) if found else np.empty(0)

    def metrics(self) -> dict[str, float]:
        """Return root mean squares over all frames and bodies.

        ``position_rms`` (m, of the distance in the coordinates that were measured) and
        ``rotation_rms`` (rad, of the angle), neither where nothing of it was measured.
        ``sensors.NAME_rms`` of each sensor (in its unit, of the length of its vector),
        ``events.NAME_rms``, ``scalars.NAME_rms``, and ``residual_variance``.

        Examples
        --------
        >>> result.metrics()["position_rms"] < 3e-4  # m
        True
        """
        if self._record is not None:
            return dict(self._record.metrics)
        result = root_mean_squares(self.problem, self.channel_residuals)
        return {**result, "residual_variance": self.residual_variance}

    def table(self, truth: dict[str, float] | None = None) -> Table:
        """Return a rich table of the estimates; with `truth`, beside the true values.

        Raises
        ------
        ValueError
            Where `truth` lacks a parameter, naming it.

        Examples
        --------
        >>> print(result.table().columns[0].header)
        parameter
        """
        from dashpot.calibrate.report.fit_report import fit_table

        return fit_table(self, truth)

    def plot(self, path: str | os.PathLike[str] | None = None) -> Figure:
        """Draw residuals over time, how they are distributed, and correlations of the estimates.

        Residuals that are noise keep to one standard deviation at all times and have the normal
        distribution that is drawn beside theirs. Needs no display.

        Parameters
        ----------
        path
            Where to write the figure too, in the format of its suffix.

        Examples
        --------
        >>> figure = result.plot()
        """
        from dashpot.calibrate.report.plots import plot_fit

        figure = plot_fit(self)
        if path is not None:
            figure.savefig(path, dpi=150)
        return figure

    def to_dict(self) -> dict[str, Any]:
        """Return everything but problem and residuals as plain types, for JSON; inf is None.

        Examples
        --------
        >>> sorted(result.to_dict())[:3]
        ['channels', 'combinations', 'confidence']
        """
        from dashpot.calibrate.report.fit_report import fit_dict

        return fit_dict(self)
