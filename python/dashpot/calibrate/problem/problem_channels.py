"""What a problem compares: channels of its trajectories, and their noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.channels import Channel
from dashpot.calibrate.problem.channels_of import channels_of
from dashpot.calibrate.problem.known_starts import is_reading
from dashpot.calibrate.problem.layout import Layout
from dashpot.calibrate.problem.own_residuals import own_channels
from dashpot.calibrate.problem.problem_fields import ProblemFields
from dashpot.calibrate.problem.sensing import SensingSetter

if TYPE_CHECKING:
    from dashpot.calibrate.problem.problem import Problem


class ProblemChannels(ProblemFields):
    """The methods of `Problem` that tell what is compared."""

    def channels(self, trajectory: Trajectory) -> list[Channel]:
        """Return the channels of a trajectory of the problem, within the window."""
        used = trajectory if self.window is None else trajectory.head(self.window)
        read = channels_of(
            used,
            self.sigma,
            [(self._sensors[name], self.sensor_sigma[name]) for name in used.sensors],
            self.event_sigma,
            self.scalar_sigma,
            self.delays(trajectory),
        )
        return [*read, *own_channels(self.own, trajectory, used)]

    def sensing_setters(self, trajectory: Trajectory) -> dict[str, SensingSetter]:
        """Return by name the parameters that say how channels of a trajectory read."""
        return {
            p.name: p.apply
            for p in self.parameters
            if isinstance(p.apply, SensingSetter) and p.acts_in(trajectory.name)
        }

    def delays(self, trajectory: Trajectory) -> dict[str, tuple[float, float]]:
        """Return by channel of a trajectory the bounds of its delay, s."""
        late = {
            channel: p.bounds
            for p in self.parameters
            if isinstance(p.apply, SensingSetter)
            and p.apply.quantity == "delay"
            and p.acts_in(trajectory.name)
            for channel in p.apply.channels
        }
        seen = {n: late[v.camera] for n, v in trajectory.views.items() if v.camera in late}
        return {**seen, **late}

    def layouts(self) -> list[Layout]:
        """Return by trajectory where its residuals within the window stand."""
        return [
            Layout(
                tuple(channel.block for channel in self.channels(t)),
                int(np.count_nonzero(is_reading(sigma))),
            )
            for t, sigma in zip(self.trajectories, self.start_sigma, strict=True)
        ]

    def measured(self) -> list[NDArray[np.bool_]]:
        """Return by trajectory which of its residuals (as `layouts`) are of what was measured."""
        return [
            np.concatenate(
                [
                    *(channel.measured.reshape(-1) for channel in self.channels(t)),
                    np.ones(layout.starts, dtype=bool),
                ]
            )
            for t, layout in zip(self.trajectories, self.layouts(), strict=True)
        ]

    def with_window(self, window: float | None) -> Problem:
        """Return the same problem over another window.

        Examples
        --------
        >>> problem.with_window(0.2).window
        0.2
        """
        return replace(cast("Problem", self), window=window)

    def with_noise(self, factors: Mapping[str, float]) -> Problem:
        """Return the same problem with standard deviations multiplied by `factors`.

        Parameters
        ----------
        factors
            By name: ``"position"``, ``"rotation"``, sensors, events and scalars; those that are not
            named stay.
        """

        def times(stated: Mapping[str, Any]) -> dict[str, Any]:
            return {
                name: tuple(factors.get(name, 1.0) * np.atleast_1d(sigma))
                if np.ndim(sigma)
                else factors.get(name, 1.0) * sigma
                for name, sigma in stated.items()
            }

        return replace(
            cast("Problem", self),
            position_sigma=tuple(factors.get("position", 1.0) * self.sigma[:3]),
            rotation_sigma=factors.get("rotation", 1.0) * self.rotation_sigma,
            sensor_sigma=times(self.sensor_sigma),
            event_sigma=times(self.event_sigma),
            scalar_sigma=times(self.scalar_sigma),
            residuals={
                name: replace(own, sigma=factors.get(name, 1.0) * own.sigma)
                for name, own in self.own.items()
            },
        )
