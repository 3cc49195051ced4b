"""The least-squares problem of a plan: unevenness, time and bounds against feed and force."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dashpot.grinding.cell import Cell
from dashpot.grinding.feed_bound import Need, Target
from dashpot.grinding.motion import Command, Motion
from dashpot.grinding.path import Path, reach
from dashpot.grinding.profile import Profiles
from dashpot.grinding.removal import depth_by_step, track_width
from dashpot.grinding.simulation import Pass, Simulator
from dashpot.grinding.tools import Disc

__all__ = ["Problem", "Target"]

Array = NDArray[np.float64]

# Unknowns of one kind that are this many apart are varied in one rollout: a spline acts on four
# intervals, and the arm settles within the next few.
_APART_FEEDS, _APART_FORCES = 6, 10
_FEED_CHANGE = 0.02
_FORCE_CHANGE = 0.01
_SMALLEST_SHARE = 0.1
_PEAK_WEIGHT, _LOAD_WEIGHT, _MARGIN = 3.0, 100.0, 0.5
_BEND_WEIGHT = 0.3
_HOVER = 1e-3  # m
_LEAST_LANDING = 0.005  # m


@dataclass(frozen=True, eq=False)
class Trial:
    """One candidate, simulated."""

    unknowns: Array
    command: Command
    found: Pass
    deviation: Array


class Problem:
    """Residuals of candidates, and their derivatives by rollouts that vary many unknowns each.

    Parameters
    ----------
    cell, path, target
        What moves where, and to what end.
    before
        What earlier passes removed at points (m, 3) with normals, as a function that returns (m,)
        m; None: nothing.
    nthread
        Threads of the rollouts.
    tick
        Called with the number of rollouts that were done.
    """

    def __init__(
        self,
        cell: Cell,
        path: Path,
        target: Target,
        *,
        before: Callable[[Array, Array], Array] | None = None,
        nthread: int | None = None,
        tick: Callable[[int], None] = lambda count: None,
    ) -> None:
        self.cell, self.path, self.target = cell, path, target
        # By the first place that is judged, all of the tool has to be down.
        self._landing = path.run_in - reach(cell) - cell.tool.footprint
        if self._landing < _LEAST_LANDING:
            needed = reach(cell) + cell.tool.footprint + _LEAST_LANDING
            raise ValueError(
                f"path: run_in is {path.run_in:g} m; the tool needs {needed:.3g} m to come down "
                "before all of it is where depth is judged"
            )
        self.motion = Motion(cell, path)
        self.simulator = Simulator(self.motion, nthread=nthread)
        self.points, self.normals = path.judged_points(cell.tool.footprint / 2)
        self.before = np.zeros(len(self.points))
        if before is not None:
            self.before = before(self.points, self.normals)
        self._left = target.depth - float(self.before.mean())
        self.rollouts = 0
        footprint = cell.tool.footprint
        self._tick = tick
        width = 2 * cell.tool.radius if isinstance(cell.tool, Disc) else track_width(footprint)
        self._need = Need(cell, path, target, self._left, width)
        self.time_weight = 1.0
        self._make_profiles()

    def _make_profiles(self) -> None:
        self.profiles = Profiles.of(
            self.cell,
            self.path,
            self._need.largest_feed(),
            feed_spacing=max(0.03, self.path.length / 100),
            force_spacing=max(0.008, 0.8 * reach(self.cell), self.path.length / 400),
            acceleration=self.target.acceleration,
            hover=_HOVER,
            landing=self._landing,
        )
        self.best_time = self.profiles.law(np.ones(self.size)).duration

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.profiles.feeds + self.profiles.forces

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the unknowns."""
        feeds, forces = self.profiles.feeds, self.profiles.forces
        smallest = max(
            _SMALLEST_SHARE, self.target.feed[0] / float(self.profiles.largest_feed.max())
        )
        lower = np.r_[np.full(feeds, min(smallest, 0.99)), np.zeros(forces)]
        return lower, np.r_[np.ones(feeds), np.full(forces, 1.2 * self.target.max_force)]

    def start(self) -> Trial:
        """Return a first candidate, whose force was corrected by the depth that it leaves."""
        share = np.full(len(self.profiles.way), 0.95)
        trial = self.evaluate([self._forced(share)])[0]
        # The width of a track is that of the tool's points together.
        worn = 1.0 + float(np.mean(trial.deviation)) * self.target.depth / self._left
        if not worn > 0:
            raise ValueError("plan: the tool does not touch along the path; is it on the part?")
        if abs(worn - 1) > 0.2:
            self._need = replace(self._need, width=self._need.width / worn)
            self._make_profiles()
            trial = self.evaluate([self._forced(share)])[0]
        return trial

    def _forced(self, share: Array) -> Array:
        profiles, path = self.profiles, self.path
        law = profiles.law(profiles.fitted(share, np.zeros_like(share)))
        way = profiles.way
        feed = np.interp(path.distance, way, law.speed)
        force = np.interp(way, path.distance, self._need.needed_force(np.maximum(feed, 1e-3)))
        edge = np.minimum(way, path.length - way) / self._landing
        rise = np.clip((edge - 0.2) / 0.8, 0.0, 1.0)
        lower, upper = self.bounds
        return np.clip(profiles.fitted(share, force * rise**2 * (3 - 2 * rise)), lower, upper)

    def corrected(self, trial: Trial) -> Array:
        """Return unknowns whose force is scaled by what is missing of the depth, point by point."""
        way = np.linspace(self.path.run_in, self.path.length - self.path.run_in, len(self.points))
        missing = -trial.deviation * self.target.depth / self._left
        ratio = np.clip(1.0 + missing, 0.5, 2.0)
        scale = np.interp(self.profiles.way, way, ratio)
        share = self.profiles.feed_basis @ trial.unknowns[: self.profiles.feeds]
        lower, upper = self.bounds
        force = scale * self.profiles.force(trial.unknowns)
        return np.clip(self.profiles.fitted(share, force), lower, upper)

    def evaluate(self, candidates: list[Array]) -> list[Trial]:
        """Simulate candidates, all in one batch."""
        commands = [self.profiles.command(each) for each in candidates]
        passes = self.simulator.run(commands)
        self.rollouts += len(candidates)
        self._tick(len(candidates))
        return [
            Trial(each, command, found, self._deviation(found))
            for each, command, found in zip(candidates, commands, passes, strict=True)
        ]

    def _deviation(self, found: Pass) -> Array:
        owner = np.zeros(len(found.time), dtype=np.intp)
        removed = self.before + self._depth(found, owner, 1)[:, 0]
        return np.asarray(removed / self.target.depth - 1.0)

    def _depth(self, found: Pass, owner: NDArray[np.intp], count: int) -> Array:
        return depth_by_step(
            found,
            self.points,
            self.normals,
            owner,
            count,
            preston=self.target.preston,
            footprint=self.cell.tool.footprint,
        )

    def residuals(self, trial: Trial) -> Array:
        """Return unevenness, what is beyond the largest deviation, time, and load beyond bounds."""
        target, deviation = self.target, trial.deviation
        root = math.sqrt(len(deviation))
        beyond = np.maximum(np.abs(deviation) - _MARGIN * target.largest, 0.0)
        load = max(float(trial.found.total.max()) / (0.98 * target.max_force) - 1.0, 0.0)
        return np.concatenate(
            [
                deviation / target.uniformity / root,
                _PEAK_WEIGHT * beyond / target.largest,
                [self.time_weight * trial.command.law.duration / self.best_time],
                [_LOAD_WEIGHT * load],
                self._bends @ trial.unknowns,
            ]
        )

    @property
    def _bends(self) -> Array:
        """Return how uneven neighbouring forces are, as rows over the unknowns: a faint weight.

        Depth says little of forces closer together than the patch; the run-in is left out.
        """
        profiles, path = self.profiles, self.path
        second = np.diff(np.eye(profiles.forces), 2, axis=0)
        centres = profiles.centres[profiles.feeds :][1:-1]
        inner = (centres > 1.5 * path.run_in) & (centres < path.length - 1.5 * path.run_in)
        weight = _BEND_WEIGHT / max(float(self._need.needed_force(self._slow()).mean()), 1e-9)
        rows = weight * inner[:, None] * second
        return np.concatenate([np.zeros((len(rows), profiles.feeds)), rows], axis=1)

    def _slow(self) -> Array:
        return np.full(len(self.path), 0.5 * sum(self.target.feed))

    def derivative(self, trial: Trial) -> Array:
        """Return the derivatives (residuals, unknowns), by one batch of rollouts."""
        profiles, target = self.profiles, self.target
        nominal = float(np.max(profiles.force(trial.unknowns)))
        change = np.r_[
            np.full(profiles.feeds, -_FEED_CHANGE),
            np.full(profiles.forces, _FORCE_CHANGE * nominal),
        ]
        groups = [
            np.arange(first, profiles.feeds, _APART_FEEDS)
            for first in range(min(_APART_FEEDS, profiles.feeds))
        ] + [
            profiles.feeds + np.arange(first, profiles.forces, _APART_FORCES)
            for first in range(min(_APART_FORCES, profiles.forces))
        ]
        candidates = []
        for group in groups:
            varied = trial.unknowns.copy()
            varied[group] += change[group]
            candidates.append(varied)
        slopes = np.zeros((len(self.points), self.size))
        centres = profiles.centres
        for group, other in zip(groups, self.evaluate(candidates), strict=True):
            # What changes near a place is due to the member of the group that acts there.
            edges = 0.5 * (centres[group][1:] + centres[group][:-1]) + self._lag(group)
            by_member = [
                self._depth(each.found, self._owner(each, edges), len(group))
                for each in (other, trial)
            ]
            slopes[:, group] = (by_member[0] - by_member[1]) / change[group] / target.depth
        return self._rows(trial, slopes, change)

    def _lag(self, group: NDArray[np.intp]) -> float:
        """Return how much later than its place an unknown acts in the middle, m."""
        return 0.01 if group[0] >= self.profiles.feeds else 0.0

    def _owner(self, trial: Trial, edges: Array) -> NDArray[np.intp]:
        way, _, _ = trial.command.law.at(trial.found.time)
        return np.asarray(np.searchsorted(edges, way), dtype=np.intp)

    def _rows(self, trial: Trial, slopes: Array, change: Array) -> Array:
        profiles, target, deviation = self.profiles, self.target, trial.deviation
        root = math.sqrt(len(deviation))
        beyond = np.abs(deviation) > _MARGIN * target.largest
        peak = _PEAK_WEIGHT * np.where(beyond, np.sign(deviation), 0.0) / target.largest
        duration = trial.command.law.duration
        time = np.zeros(self.size)
        for index in range(profiles.feeds):
            varied = trial.unknowns.copy()
            varied[index] += change[index]
            time[index] = (profiles.law(varied).duration - duration) / change[index]
        load = np.zeros(self.size)
        total = trial.found.total
        if total.max() > 0.98 * target.max_force:
            way, _, _ = trial.command.law.at(trial.found.time[[int(total.argmax())]])
            node = int(np.searchsorted(profiles.way, way[0]).clip(0, len(profiles.way) - 1))
            load[profiles.feeds :] = _LOAD_WEIGHT * profiles.force_basis[node] / target.max_force
        return np.concatenate(
            [
                slopes / target.uniformity / root,
                peak[:, None] * slopes,
                [self.time_weight * time / self.best_time],
                [load],
                self._bends,
            ]
        )
