"""What a fit writes: reports, files, models."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal, cast

if TYPE_CHECKING:
    from pathlib import Path

    import mujoco

    from dashpot.calibrate.data.trajectory import Trajectory
    from dashpot.calibrate.mjcf import WrittenModel
    from dashpot.calibrate.problem.problem import Problem
    from dashpot.calibrate.report.record import Record
    from dashpot.calibrate.result import Fit


class Outputs:
    """The methods of `Fit` that write files."""

    if TYPE_CHECKING:
        _record: Record | None

    @property
    def _fit(self) -> Fit:
        return cast("Fit", self)

    def record(self, *, nthread: int | None = None) -> Record:
        """Return what a report tells beside the estimates: curves, spread, profiles, outlines.

        The first call takes some tens of simulations of the problem.
        """
        from dashpot.calibrate.report.making import make_record

        if self._record is None:
            object.__setattr__(self, "_record", make_record(self._fit, nthread))
        assert self._record is not None
        return self._record

    def report(
        self,
        path: str | os.PathLike[str],
        *,
        held_out: Sequence[Trajectory] | None = None,
        head: float | None = None,
        beside: Mapping[str, Fit] | None = None,
        title: str = "Calibration",
        nthread: int | None = None,
    ) -> Path:
        """Write a report as one HTML file that needs nothing from outside.

        It shows what was measured and simulated, residuals and their correlation, parameters with
        units, intervals and statements, the cost along each, animations, and how it was made. Needs
        the extra ``report`` (Jinja2), and no display.

        Parameters
        ----------
        path
            Of the file.
        held_out
            Trajectories that were not fitted, to be predicted as `predict` does.
        head
            Seconds of each of these to which its initial state is fitted.
        beside
            Other fits by name, such as ``{"MuJoCo": fit(replace(problem, system=model))}``: of the
            same trajectories, drawn and listed beside this one.
        title
            Of the page.
        nthread
            Number of threads, >= 1. None: one per core.

        Returns
        -------
        The file.

        Raises
        ------
        ImportError
            Where Jinja2 is not installed, naming the extra.
        TypeError, ValueError
            As `predict`; and where `beside` holds something else than fits.

        Examples
        --------
        >>> path = result.report("ball.html", title="A thrown ball")
        >>> path.name
        'ball.html'
        """
        from dashpot.calibrate.report.page import write_report

        return write_report(
            self._fit,
            path,
            held_out=held_out,
            head=head,
            beside=beside,
            title=title,
            nthread=nthread,
        )

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the fit as plain JSON, with all that tables, reports and draws need.

        The model and functions of the user's own are not in it; what needs them says so once the
        fit is loaded. ``dashpot simulate scene.xml --fit FILE`` steps with its values.

        Returns
        -------
        The file.

        Examples
        --------
        >>> from dashpot.calibrate import Fit
        >>> path = result.save("ball.json")
        >>> Fit.load(path).values == result.values
        True
        """
        from dashpot.calibrate.saved import save

        return save(self._fit, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, problem: Problem | None = None) -> Fit:
        """Read a fit that `save` wrote.

        Parameters
        ----------
        path
            Of the file.
        problem
            That was fitted, for what needs it: `predict`, and to build systems. None: these say
            that they need it, and the rest is as it was.

        Raises
        ------
        ValueError
            If the file is no saved fit, naming what is missing, unknown or of another type; or if
            `problem` has other parameters.
        FileNotFoundError
            If there is no such file.

        Examples
        --------
        >>> from dashpot.calibrate import Fit
        >>> path = result.save("ball.json")
        >>> again = Fit.load(path, problem=problem)
        >>> len(again.predict())
        1
        """
        from dashpot.calibrate.saved import load

        return load(path, problem)

    def write_mjcf(
        self,
        path: str | os.PathLike[str],
        *,
        scene: str | os.PathLike[str] | mujoco.MjSpec | None = None,
        materials: Literal["numeric", "solref"] = "numeric",
        trajectory: str | None = None,
    ) -> WrittenModel:
        """Write the model with the fitted values as an MJCF, and say what is in it.

        What parameters set in the model is written as the model's own attributes. Materials are
        custom numerics, which `dashpot.Engine` reads and MuJoCo ignores. With ``"solref"`` there
        are contact pairs beside them, whose ``solref`` and ``solimp`` press in at rest as far as
        the materials do, for steps of MuJoCo's own.

        Parameters
        ----------
        path
            Of the file.
        scene
            What the model was compiled from: a file, MJCF text or a specification. None: the MJCF
            that MuJoCo compiled last, if it is the fitted one.
        materials
            ``"numeric"`` or ``"solref"``.
        trajectory
            Whose values are written, where parameters have one for each (``per``).

        Returns
        -------
        WrittenModel
            Where it is, and notes of what it says and does not say. Prints as these.

        Raises
        ------
        ValueError
            Naming the parameter that a function of the user's own sets. Where the scene is not the
            fitted model, or cannot say a value. With ``"solref"`` the contact that MuJoCo has no
            counterpart for.

        Examples
        --------
        >>> written = result.write_mjcf("ball.xml", scene=scene)
        >>> written.path.name
        'ball.xml'
        """
        from dashpot.calibrate.mjcf import write_mjcf

        return write_mjcf(self._fit, path, scene, materials, trajectory)
