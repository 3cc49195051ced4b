"""The stiffness and damping of a contact from a recorded press, and what it costs to be wrong."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate import Fit, Parameter, Problem, Trajectory, fit
from dashpot.checks import positive_number
from dashpot.engine import Engine
from dashpot.grinding.cell import Cell
from dashpot.grinding.cell_model import LOAD
from dashpot.grinding.press import PressLog, press_controls, press_motion, press_start

if TYPE_CHECKING:
    from dashpot.grinding.checks import Check
    from dashpot.grinding.plan import Plan

__all__ = ["PressFit", "press_trial"]

Array = NDArray[np.float64]
Sampling = Literal["instant", "mean"]

# By how much the sum of squared residuals, over their variance, has to differ for one way of
# sampling to be told from the other: about a hundred to one.
_TOLD = 9.2
_WIDE = 20.0
_HEIGHT = 2e-3  # m
_STEP = 5e-4  # s, the longest of the simulation


@dataclass(frozen=True, eq=False)
class PressFit:
    """What a press says of the contact.

    Attributes
    ----------
    cell
        The cell with the fitted stiffness and damping.
    stiffness, damping
        N/m and N s/m.
    stiffness_interval, damping_interval
        (lower, upper) of 95 %.
    height
        How much higher the surface is than the cell has it, m; 0 where that was not fitted.
    sampling
        How the load cell reads, as given or as the log says.
    told
        Whether the log tells the two ways of reading apart; True where it was given.
    fit
        The calibration, with all that it says.

    Examples
    --------
    >>> import dataclasses
    >>> log = grinding.record_press(cell, (0.0, 0.5, 0.3), depth=1e-3, duration=0.3)
    >>> log = dataclasses.replace(log, sampling="mean")
    >>> found = grinding.press_trial(cell, log, height=False)
    >>> found.height, found.cell.stiffness == found.stiffness
    (0.0, True)
    """

    cell: Cell
    stiffness: float
    damping: float
    stiffness_interval: tuple[float, float]
    damping_interval: tuple[float, float]
    height: float
    sampling: Sampling
    told: bool
    fit: Fit

    def plan_again(self, plan: Plan, **options: Any) -> Plan:
        """Return a plan for the fitted cell, begun from one that was made before.

        Options are those of `dashpot.grinding.plan`.
        """
        from dashpot.grinding.plan import plan as make_plan

        target = plan.target
        given: dict[str, Any] = {
            "preston": target.preston,
            "max_force": target.max_force,
            "feed": target.feed,
            "acceleration": target.acceleration,
            "uniformity": target.uniformity,
            "largest": target.largest,
            "passes": len(plan.passes),
            "start": plan,
        } | options
        return make_plan(self.cell, plan.path, target.depth, **given)

    def cost(self, plan: Plan, *, timestep: float = 2.5e-4) -> Check:
        """Return what a plan does in the fitted cell: what its wrong stiffness costs."""
        from dashpot.grinding.checks import check_in

        name = f"{plan.cell.stiffness:.4g} N/m planned, {self.stiffness:.4g} N/m fitted"
        return check_in(plan, self.cell, name, timestep=timestep)

    def __str__(self) -> str:
        low, high = self.stiffness_interval
        least, most = self.damping_interval
        sure = "" if self.told else " (the log does not tell it from the other)"
        return (
            f"stiffness {self.stiffness:.5g} N/m ({low:.5g} to {high:.5g})\n"
            f"damping {self.damping:.4g} N s/m ({least:.4g} to {most:.4g})\n"
            f"surface {1e6 * self.height:+.1f} um from where the cell has it\n"
            f"the load cell reads {'means' if self.sampling == 'mean' else 'instants'}{sure}"
        )


def press_trial(
    cell: Cell,
    log: PressLog,
    *,
    noise: float = 0.5,
    height: bool = True,
    nthread: int | None = None,
    progress: bool = False,
) -> PressFit:
    """Fit stiffness and damping of the contact to a recorded press.

    The whole cell is simulated, arm and all, under the positions that the log says; the load cell's
    readings are compared. `dashpot.calibrate.fit` does the rest.

    Parameters
    ----------
    cell
        The cell, whose stiffness and damping are where the search starts.
    log
        The press.
    noise
        Standard deviation of the load cell's readings where it starts, N; it is estimated.
    height
        Whether the height of the surface is fitted too, within 2 mm. A part is rarely where a
        drawing has it to hundredths of a millimetre.
    nthread, progress
        As of `dashpot.calibrate.fit`.

    Raises
    ------
    ValueError
        Where the log's units are wrong, or its press does not touch.

    Examples
    --------
    >>> from dataclasses import replace
    >>> softer = cell.with_changes(stiffness=1.6e4)
    >>> log = grinding.record_press(softer, (0.0, 0.5, 0.3), depth=1e-3, duration=0.3)
    >>> found = grinding.press_trial(cell, replace(log, sampling="mean"), height=False)
    >>> f"{found.stiffness:.1e} N/m"
    '1.6e+04 N/m'
    """
    log.check_stiffness(cell)
    positive_number("press_trial: noise", noise)
    ways: tuple[Sampling, ...] = ("instant", "mean") if log.sampling == "auto" else (log.sampling,)
    motion = press_motion(cell, log.point, log.direction, float(log.position.max()))
    fits = {}
    for way in ways:
        problem = _problem(cell, log, motion, way, noise, height)
        fits[way] = fit(problem, starts=0, nthread=nthread, progress=progress)
    squares = {way: _squares(found, noise) for way, found in fits.items()}
    best = min(fits, key=lambda way: squares[way])
    others = [squares[way] for way in fits if way != best]
    count = len(log.time)
    # Of Gaussian noise of unknown size: twice the difference of the log likelihoods.
    told = all(count * np.log(other / squares[best]) > _TOLD for other in others)
    found = fits[best]
    points = len(cell.parts.points)
    stiffness, damping = found["stiffness"], found["damping"]
    return PressFit(
        cell.with_changes(stiffness=points * stiffness.value, damping=points * damping.value),
        points * stiffness.value,
        points * damping.value,
        (points * stiffness.lower, points * stiffness.upper),
        (points * damping.lower, points * damping.upper),
        found["height"].value if height else 0.0,
        best,
        told,
        found,
    )


def _problem(
    cell: Cell, log: PressLog, motion: Any, way: Sampling, noise: float, height: bool
) -> Problem:
    parts = cell.parts
    pairs = [(point, parts.work) for point in parts.points]
    share = 1.0 / len(pairs)
    stiffness, damping = cell.stiffness * share, max(cell.damping, 1.0) * share
    parameters = [
        Parameter.pair(
            pairs, "stiffness", start=stiffness, bounds=(stiffness / _WIDE, stiffness * _WIDE)
        ),
        Parameter.pair(pairs, "damping", start=damping, bounds=(damping / _WIDE, damping * _WIDE)),
    ]
    if height:
        parameters.append(
            Parameter(
                "height",
                0.0,
                (-_HEIGHT, _HEIGHT),
                transform="linear",
                apply=_Raised(parts.work, motion.path.normals[len(motion.path) // 2]),
                changes_model=True,
            )
        )
    return Problem(
        _engine(cell),
        parameters,
        [_trajectory(cell, log, motion, way)],
        sensor_sigma={LOAD: noise},
        noise="estimate",
    )


def _engine(cell: Cell) -> Engine:
    engine = cell.engine()
    engine.model.opt.timestep = min(_STEP, cell.timestep)
    return engine


@dataclass(frozen=True)
class _Raised:
    """Moves the workpiece along the normal of the pressed point."""

    geom: int
    normal: Array

    def __call__(self, system: Any, value: float) -> None:
        model = getattr(system, "model", system)
        # The geoms of a workpiece from a file may hang on a body; all of them are fixed.
        body = int(model.geom_bodyid[self.geom])
        if body == 0:
            model.geom_pos[self.geom] += value * self.normal
        else:
            model.body_pos[body] += value * self.normal


def _trajectory(cell: Cell, log: PressLog, motion: Any, way: Sampling) -> Trajectory:
    """Return the log on the grid of the simulation's steps, the readings at their own times."""
    parts = max(1, math.ceil(log.spacing / min(_STEP, cell.timestep) - 1e-9))
    time = np.linspace(log.time[0], log.time[-1], (len(log.time) - 1) * parts + 1)
    # A mean over the time before the first reading is of what was not simulated.
    first = 1 if way == "mean" else 0
    return Trajectory.of_sensors(
        "press",
        time,
        {LOAD: log.force[first:]},
        initial_qpos=press_start(motion, float(log.position[0])),
        initial_qvel=np.zeros(cell.parts.model.nv),
        control=press_controls(motion, log.time, log.position, time[:-1]),
        sampling={LOAD: way},
        sensor_times={LOAD: log.time[first:]},
    )


def _squares(found: Fit, noise: float) -> float:
    """Return the sum of squared residuals of the load in units of the first stated noise."""
    sigma = found.problem.sensor_sigma[LOAD]
    weighted = np.concatenate([each[LOAD].ravel() for each in found.sensor_residuals])
    scale = float(np.atleast_1d(np.asarray(sigma, dtype=float))[0]) / noise
    return float(np.nansum((scale * weighted) ** 2))
