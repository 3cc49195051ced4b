"""What a comparison found: time series of each run, statistics, table and plots."""

from __future__ import annotations

import html
import os
import textwrap
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dashpot.checks import number
from dashpot.tables import table_html, table_text

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure
    from rich.table import Table

# A setting gains energy where it is more than this share of what the runs lose or gain. Work is
# measured at recorded states, which leaves up to one per cent of servos that start with a jump.
_GAIN = 0.02
# Energies are sums of terms that are rounded: smaller ones than this share of the terms are none.
_ROUNDING = 1e-9
# Characters of a line of notes.
_LINE = 79


@dataclass(frozen=True)
class Statistics:
    """Summary of one run. Penetration in m, over all touching contacts of all instants.

    ``settled`` is the part from ``Comparison.settled_after`` on, ``falling`` the part before.
    ``energy_lost`` and ``energy_gained`` (J) compare kinetic plus potential energy with the
    start and the ``work`` (J) that actuators did since. They say what is gone at the end, and how
    far above it the energy ever rose. A gain is an error of the stepper, or energy of a start that
    violates a limit, an equality or a surface. ``energy_lost`` is negative where such a gain
    remains at the end.

    Examples
    --------
    >>> comparison = dashpot.compare.run(engine, duration=0.5, settings=["dashpot"])
    >>> statistics = comparison.statistics()["dashpot"]
    >>> bool(statistics.energy_gained < 1e-6)
    True
    """

    penetration_falling_mean: float
    penetration_falling_max: float
    penetration_settled_mean: float
    penetration_settled_max: float
    energy_lost: float
    energy_gained: float
    work: float
    contacts_settled_mean: float
    wall_time: float
    realtime_factor: float


@dataclass(frozen=True, eq=False)
class Run:
    """One setting's run; arrays over T recorded instants.

    Attributes
    ----------
    name, description
        Of the setting.
    time
        (T,) s.
    penetration_sum, penetration_max
        (T,) m, sum and maximum of the depth of all touching contacts; 0 without contact.
    contacts
        (T,) number of touching contacts (overlap > 0).
    kinetic, potential
        (T,) J, of the pristine model at the recorded state.
    elastic
        (T,) J stored in contact springs where the stepper knows it (dashpot), else NaN.
    work
        (T,) J that actuators and gravity compensation did since the start: their forces in the
        pristine model at the recorded states, times the way between these.
    position
        (nq,) generalised position at the end.
    wall_time
        s, spent stepping; recording is not counted.
    unstable_at
        s, the time at which the run diverged, or None. Recording ends there.
    warnings
        What MuJoCo warned of, kind by kind; of dashpot, what diverged.

    Examples
    --------
    >>> dashpot_run = dashpot.compare.run(engine, duration=0.5, settings=["dashpot"]).runs[0]
    >>> dashpot_run.time.shape == dashpot_run.penetration_max.shape
    True
    """

    name: str
    description: str
    time: NDArray[np.float64]
    penetration_sum: NDArray[np.float64]
    penetration_max: NDArray[np.float64]
    contacts: NDArray[np.int64]
    kinetic: NDArray[np.float64]
    potential: NDArray[np.float64]
    elastic: NDArray[np.float64]
    work: NDArray[np.float64]
    position: NDArray[np.float64]
    wall_time: float
    unstable_at: float | None = None
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return what was run and for how long, without the arrays."""
        end = "" if self.unstable_at is None else f", diverged at {self.unstable_at:.3g} s"
        return f"Run({self.name!r}, {len(self.time)} instants to {self.time[-1]:.6g} s{end})"

    @property
    def energy(self) -> NDArray[np.float64]:
        """Kinetic plus potential energy, J: measured the same way for every run."""
        return self.kinetic + self.potential

    @property
    def excess(self) -> NDArray[np.float64]:
        """(T,) J, kinetic plus potential energy above that of the start and the work done since.

        Never above 0 in what is right: springs only store energy, and contacts take some.
        """
        excess: NDArray[np.float64] = self.energy - self.energy[0] - self.work
        return excess

    @property
    def penetration_mean(self) -> NDArray[np.float64]:
        """(T,) m, mean depth of the touching contacts; 0 without contact."""
        return self.penetration_sum / np.maximum(self.contacts, 1)

    def statistics(self, settled_after: float) -> Statistics:
        """Summarise the run, split at `settled_after` (s).

        A part without any contact has penetration NaN.
        """
        split = number("settled_after", settled_after)
        if np.isnan(split):
            raise ValueError(f"settled_after must be a time, got {settled_after!r}")
        settled = self.time >= split

        def mean_and_max(part: NDArray[np.bool_]) -> tuple[float, float]:
            count = int(self.contacts[part].sum())
            if count == 0:
                return float("nan"), float("nan")
            return (
                float(self.penetration_sum[part].sum() / count),
                float(self.penetration_max[part].max()),
            )

        falling_mean, falling_max = mean_and_max(~settled)
        settled_mean, settled_max = mean_and_max(settled)
        simulated = float(self.time[-1] - self.time[0])
        return Statistics(
            falling_mean,
            falling_max,
            settled_mean,
            settled_max,
            energy_lost=float(0.0 - self.excess[-1]),
            energy_gained=float(max(0.0, self.excess.max())),
            work=float(self.work[-1]),
            contacts_settled_mean=(
                float(self.contacts[settled].mean()) if settled.any() else float("nan")
            ),
            wall_time=self.wall_time,
            realtime_factor=simulated / self.wall_time if self.wall_time > 0 else float("inf"),
        )


@dataclass(frozen=True, eq=False)
class Comparison:
    """The same model stepped in several ways from the same state.

    Attributes
    ----------
    scene
        Name or file of the scene.
    timestep, duration
        s.
    settled_after
        s; statistics split there into "falling" and "settled".
    runs
        In the order of the settings.
    model
        SHA-256 of the compiled model, in hexadecimal digits; empty where it is not known.
    softness
        Which geoms' own ``solref`` decides how soft contacts are, and where; empty for none.
    violations
        Which limits, equalities and surfaces the start violates; empty for none.

    Examples
    --------
    >>> comparison = dashpot.compare.run(model, duration=0.5)
    >>> comparison.timestep, comparison.runs[0].name
    (0.005, 'dashpot')
    """

    scene: str
    timestep: float
    duration: float
    settled_after: float
    runs: tuple[Run, ...]
    model: str = ""
    softness: str = ""
    violations: str = ""

    def __getitem__(self, name: str) -> Run:
        for candidate in self.runs:
            if candidate.name == name:
                return candidate
        raise KeyError(f"{name!r} is none of the runs {[r.name for r in self.runs]}")

    def __contains__(self, name: object) -> bool:
        return any(run.name == name for run in self.runs)

    def __iter__(self) -> Iterator[str]:
        return (run.name for run in self.runs)

    def __str__(self) -> str:
        """Return the table as text, what settings mean, and what has to be known to read it."""
        return f"{table_text(self.table())}\n{self.explanation()}"

    def explanation(self) -> str:
        """Return what the settings mean, a line each, and the notes, as text."""
        told = [f"{run.name}: {run.description}" for run in self.runs]
        notes = [textwrap.fill(note, _LINE) for note in self.notes()]
        return "\n".join([*told, "", *notes]).rstrip()

    def _repr_html_(self) -> str:
        """Return the table for notebooks, what settings mean, and the notes."""
        told = [f"{run.name}: {run.description}" for run in self.runs]
        items = "".join(f"<li>{html.escape(line)}</li>" for line in [*told, *self.notes()])
        return f"{table_html(self.table())}<ul>{items}</ul>"

    def __repr__(self) -> str:
        """Return the scene and its runs, without the arrays."""
        runs = ", ".join(run.name for run in self.runs)
        return (
            f"Comparison({self.scene!r}, {self.duration:g} s at {1e3 * self.timestep:g} ms: {runs})"
        )

    def statistics(self) -> dict[str, Statistics]:
        """Summarise every run, by setting."""
        return {run.name: run.statistics(self.settled_after) for run in self.runs}

    def gaining(self) -> tuple[str, ...]:
        """Return the settings that gained more than 2 % of what any run lost or gained."""
        found = self.statistics().values()
        scale = max(max(abs(s.energy_lost), s.energy_gained) for s in found)
        least = max(_GAIN * scale, _ROUNDING * self._energy_scale())
        return tuple(n for n, s in self.statistics().items() if s.energy_gained > least)

    def label(self, name: str) -> str:
        """Return the name of a setting, and that it gains energy, where it does."""
        return f"{name} (gains energy)" if name in self.gaining() else name

    def notes(self) -> tuple[str, ...]:
        """Return what has to be known to read the table, a text for each fact."""
        found = [self.softness] if self.softness else []
        if any(run.work.any() for run in self.runs):
            found.append(
                "Actuators did work: energy lost and gained are what is left once it is taken off."
            )
        statistics = self.statistics()
        gains = ", ".join(f"{n} {statistics[n].energy_gained:.3g} J" for n in self.gaining())
        if gains and self.violations:
            found.append(
                f"Energy above that of the start: {gains}. The start violates {self.violations}. "
                "What mends that pushes bodies, in any setting; more than it takes is an error."
            )
        elif gains:
            found.append(
                f"Energy out of nothing: {gains}. Such a setting is no peer of the others, since "
                "its motion is not that of the scene."
            )
        return tuple(found)

    def _energy_scale(self) -> float:
        """Return the largest energy of any run, J: rounding errors are shares of it."""
        return max(float(np.abs([run.kinetic, run.potential]).max()) for run in self.runs)

    def rows(self) -> tuple[list[str], list[list[str]]]:
        """Return header and cells of the table, as text; penetration in mm.

        Energies that are rounding errors are 0. Energy lost is "-" where more was gained.
        """
        driven = any(run.work.any() for run in self.runs)
        rounding = _ROUNDING * self._energy_scale()
        header = [
            "setting",
            "falling mean [mm]",
            "falling max [mm]",
            "settled mean [mm]",
            "settled max [mm]",
            *(["work done [J]"] if driven else []),
            "energy lost [J]",
            "energy gained [J]",
            "contacts",
            "wall time [s]",
        ]
        cells = []
        for run in self.runs:
            s = run.statistics(self.settled_after)
            depths = (
                s.penetration_falling_mean,
                s.penetration_falling_max,
                s.penetration_settled_mean,
                s.penetration_settled_max,
            )
            lost = _rounded(s.energy_lost, rounding)
            note = "" if run.unstable_at is None else f" (diverged at {run.unstable_at:.3g} s)"
            cells.append(
                [
                    self.label(run.name) + note,
                    *(_number(1e3 * depth) for depth in depths),
                    *([_number(s.work)] if driven else []),
                    _number(lost if lost >= 0.0 else float("nan")),
                    _number(_rounded(s.energy_gained, rounding)),
                    "-" if np.isnan(s.contacts_settled_mean) else f"{s.contacts_settled_mean:.3g}",
                    f"{s.wall_time:.2f}",
                ]
            )
        return header, cells

    def table(self) -> Table:
        """Return the statistics as a rich table."""
        from rich import box
        from rich.table import Table
        from rich.text import Text

        header, cells = self.rows()
        title = f"{self.scene}: {self.duration:g} s at {1e3 * self.timestep:g} ms"
        # Narrow enough for 80 columns: one word of a heading to a line.
        table = Table(title=Text(title), box=box.SIMPLE, padding=0, pad_edge=False)
        for index, name in enumerate(header):
            table.add_column(
                Text(name.replace(" ", "\n")),
                justify="left" if index == 0 else "right",
                no_wrap=index > 0,
                min_width=max(len(run.name) for run in self.runs) if index == 0 else None,
                overflow="fold",
            )
        for row in cells:
            table.add_row(*(Text(cell) for cell in row))
        return table

    def plot(self, path: str | os.PathLike[str] | None = None) -> Figure:
        """Draw penetration and energy over time; needs no display.

        Parameters
        ----------
        path
            Where to write the figure too, in the format of its suffix.
        """
        from dashpot.compare.plots import plot_comparison

        figure = plot_comparison(self)
        if path is not None:
            figure.savefig(path, dpi=150)
        return figure

    def report(self, path: str | os.PathLike[str], *, title: str | None = None) -> Path:
        """Write a report as one HTML file that needs nothing from outside.

        It has the table, both plots, penetration and energy of each setting, and what settings
        mean. Needs the extra ``report`` (Jinja2), and no display.

        Parameters
        ----------
        path
            Of the file.
        title
            Of the page; None: the scene's name.

        Raises
        ------
        ImportError
            Where Jinja2 is not installed, naming the extra.
        """
        from dashpot.compare.page import write_report

        return write_report(self, path, f"Comparison: {self.scene}" if title is None else title)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain numbers and lists, for JSON; NaN becomes None."""
        return {
            "scene": self.scene,
            "timestep": self.timestep,
            "duration": self.duration,
            "settled_after": self.settled_after,
            "notes": list(self.notes()),
            "runs": [
                {
                    "name": run.name,
                    "description": run.description,
                    "unstable_at": run.unstable_at,
                    "warnings": list(run.warnings),
                    "statistics": {
                        key: _plain(value)
                        for key, value in asdict(run.statistics(self.settled_after)).items()
                    },
                    "time": run.time.tolist(),
                    "penetration_sum": run.penetration_sum.tolist(),
                    "penetration_mean": run.penetration_mean.tolist(),
                    "penetration_max": run.penetration_max.tolist(),
                    "contacts": run.contacts.tolist(),
                    "kinetic": run.kinetic.tolist(),
                    "potential": run.potential.tolist(),
                    "elastic": [_plain(value) for value in run.elastic.tolist()],
                    "work": run.work.tolist(),
                    "position": [_plain(value) for value in run.position.tolist()],
                }
                for run in self.runs
            ],
        }


def _plain(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _rounded(value: float, rounding: float) -> float:
    return value if abs(value) > rounding else 0.0


def _number(value: float) -> str:
    """Three digits, or two, in at most seven characters, so that tables fit into 80 columns."""
    if np.isnan(value):
        return "-"
    texts = (f"{value:.3g}", f"{value:.2g}", f"{value:.1e}")
    return next((text for text in texts if len(text) <= 7), texts[-1])
