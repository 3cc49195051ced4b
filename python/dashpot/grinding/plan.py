"""Plans of passes: feed and force along a path, in the least time, for an even depth."""

from __future__ import annotations

import math
import os
import time
from dataclasses import dataclass, replace
from pathlib import Path as File
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dashpot.checks import number, positive_count, positive_number, thread_count
from dashpot.grinding.cell import Cell
from dashpot.grinding.passes import PlannedPass, after, removed_by
from dashpot.grinding.path import Path, reach
from dashpot.grinding.problem import Problem, Target
from dashpot.grinding.progress import rollout_bar
from dashpot.grinding.removal import DepthMap
from dashpot.grinding.search import search

if TYPE_CHECKING:
    from dashpot.figures import ShownFigure
    from dashpot.grinding.checks import Checks

__all__ = ["Plan", "PlannedPass", "plan"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Plan:
    """Passes that remove a depth along a path; made by `plan`.

    Attributes
    ----------
    cell, path, target
        What was asked for; `target` has the depth of all passes.
    passes
        In their order.
    way
        (m,) places along the path at which depth is judged, m.
    depth
        (m,) depth that all passes leave there, m.
    met
        Whether depth is as even, and force as low, as was asked for.
    rollouts, seconds
        How many passes were simulated, and the time that took, s.

    Examples
    --------
    >>> bool(abs(plan.depth.mean() / 50e-6 - 1) < 0.01)
    True
    """

    cell: Cell
    path: Path
    target: Target
    passes: tuple[PlannedPass, ...]
    way: Array
    depth: Array
    met: bool
    rollouts: int
    seconds: float

    @property
    def duration(self) -> float:
        """Of all passes, from rest to rest, s."""
        return sum(each.duration for each in self.passes)

    @property
    def deviation(self) -> Array:
        """(m,) of the depth from the one asked for, as a share of it."""
        return self.depth / self.target.depth - 1.0

    @property
    def uniformity(self) -> float:
        """Standard deviation of the depth over the depth asked for."""
        return float(self.deviation.std())

    @property
    def largest(self) -> float:
        """Largest deviation of the depth over the depth asked for."""
        return float(np.abs(self.deviation).max())

    @property
    def peak_force(self) -> float:
        """Largest normal force, N."""
        return max(float(each.found.total.max()) for each in self.passes)

    def check(
        self,
        *,
        timestep: float = 2.5e-4,
        friction: float | None = None,
        stiffness: float = 1.2,
        mujoco: bool = True,
        nthread: int | None = None,
    ) -> Checks:
        """Return what the plan does where something differs from what it was made for.

        Parameters
        ----------
        timestep
            Of all simulations of the check, s.
        friction
            Another coefficient. None: a third more.
        stiffness
            Factor of the contact's stiffness, tried with its inverse.
        mujoco
            Whether MuJoCo steps the plan too.
        nthread
            Threads; None: one per core.
        """
        from dashpot.grinding.checks import check_plan

        return check_plan(
            self,
            timestep=timestep,
            friction=friction,
            stiffness=stiffness,
            with_mujoco=mujoco,
            nthread=nthread,
        )

    def depth_map(self, *, spacing: float | None = None) -> DepthMap:
        """Return the depth over the surface, on nodes of a `spacing` in m (a quarter patch)."""
        footprint = self.cell.tool.footprint
        found = DepthMap.around(
            self.cell.part,
            self.path,
            spacing=footprint / 4 if spacing is None else spacing,
            margin=reach(self.cell) + footprint,
        )
        for each in self.passes:
            found = found.with_pass(each.found, preston=self.target.preston, footprint=footprint)
        return found

    def save(self, file: str | os.PathLike[str]) -> File:
        """Write set points as CSV that a controller reads; see `dashpot.grinding.waypoints`.

        Examples
        --------
        >>> plan.save("pass.csv").name
        'pass.csv'
        """
        from dashpot.grinding.waypoints import write_waypoints

        return write_waypoints(self, file)

    def plot(self, file: str | os.PathLike[str] | None = None) -> ShownFigure:
        """Return, and write where a file is given, the depth map and the depth along the path."""
        from dashpot.grinding.plots import plot_plan

        figure = plot_plan(self)
        if file is not None:
            figure.savefig(file, dpi=150)
        return figure

    def report(self, file: str | os.PathLike[str], *, checks: Checks | None = None) -> File:
        """Write a report as one HTML file; with `checks`, what `check` returned."""
        from dashpot.grinding.report import write_report

        return write_report(self, file, checks)

    def video(self, file: str | os.PathLike[str], *, frames: int = 60) -> File:
        """Write an animation (GIF): rendered where a GL is there, else drawn."""
        from dashpot.grinding.video import write_video

        return write_video(self, file, frames)

    def __repr__(self) -> str:
        """Return depth, evenness and time."""
        return (
            f"Plan({1e6 * self.target.depth:.4g} um in {self.duration:.3f} s, standard deviation "
            f"{100 * self.uniformity:.2f} %, largest {100 * self.largest:.2f} %, at most "
            f"{self.peak_force:.3g} N{'' if self.met else ', not as asked'})"
        )


def plan(
    cell: Cell,
    path: Path,
    depth: float,
    *,
    preston: float,
    max_force: float,
    feed: tuple[float, float] = (0.02, 0.2),
    acceleration: float = 2.0,
    uniformity: float = 0.005,
    largest: float = 0.02,
    passes: int = 1,
    start: Plan | None = None,
    nthread: int | None = None,
    progress: bool = False,
) -> Plan:
    """Choose feed and force along a path, so that a depth comes off evenly in the least time.

    The unknowns are coefficients of splines along the path. `scipy.optimize.least_squares` weighs
    unevenness against time, within bounds; the rollouts of a derivative are one batch, each of
    which varies many unknowns whose effects lie apart. Time is weighed less until depth is as even
    as was asked for. The same call gives the same plan.

    Parameters
    ----------
    cell, path
        What moves where.
    depth
        To remove along the path, m, > 0.
    preston
        Preston's coefficient, 1/Pa, > 0: depth a second per pressure and sliding speed.
    max_force
        Largest normal force, N, > 0.
    feed
        Smallest and largest feed, m/s, > 0.
    acceleration
        Largest along the path, m/s^2, > 0.
    uniformity, largest
        Standard deviation and largest deviation of the depth that are allowed, as shares of it.
    passes
        How many passes share the depth, >= 1. A height field recedes from one to the next.
    start
        A plan of the same path to begin with, as after a press trial.
    nthread
        Threads of the rollouts; None: one per core. Plans are the same for any number.
    progress
        Whether to show a bar on standard error.

    Raises
    ------
    ValueError
        Naming the argument, or where force and joint speeds do not allow the depth.

    Examples
    --------
    >>> plan = grinding.plan(cell, path, depth=50e-6, preston=4.7e-10, max_force=90)
    >>> plan.met, len(plan.passes)
    (True, 1)
    """
    target = _target(depth, preston, max_force, feed, acceleration, uniformity, largest)
    count = positive_count("plan: passes", passes)
    thread_count(nthread)
    begun = time.perf_counter()
    done: list[PlannedPass] = []
    rollouts = 0
    met = True
    with rollout_bar(progress) as tick:
        for index in range(count):
            goal = replace(target, depth=target.depth * (index + 1) / count)
            present, laid = (cell, path) if not done else after(done[-1], target.preston)
            first = start.passes[min(index, len(start.passes) - 1)] if start else None
            if first is None and done:
                first = done[-1]
            problem = Problem(
                present,
                laid,
                goal,
                before=removed_by(done, target.preston),
                nthread=nthread,
                tick=tick,
            )
            trial, pass_met = search(
                problem, None if first is None else (first.profiles, first.unknowns)
            )
            met &= pass_met
            rollouts += problem.rollouts
            done.append(PlannedPass(present, laid, problem.profiles, trial.unknowns, trial.found))
    points, normals = path.judged_points(cell.tool.footprint / 4)
    return Plan(
        cell,
        path,
        target,
        tuple(done),
        np.linspace(path.run_in, path.length - path.run_in, len(points)),
        removed_by(done, target.preston)(points, normals),
        met,
        rollouts,
        time.perf_counter() - begun,
    )


def _target(
    depth: float,
    preston: float,
    max_force: float,
    feed: tuple[float, float],
    acceleration: float,
    uniformity: float,
    largest: float,
) -> Target:
    given = {"depth": depth, "preston": preston, "max_force": max_force}
    given |= {"acceleration": acceleration, "uniformity": uniformity, "largest": largest}
    checked = {name: positive_number(f"plan: {name}", value) for name, value in given.items()}
    low, high = (number(f"plan: feed[{i}]", feed[i]) for i in range(2))
    if not (0 < low < high and math.isfinite(high)):
        raise ValueError(f"plan: feed must be two numbers, 0 < smallest < largest, got {feed!r}")
    return Target(feed=(low, high), **checked)
