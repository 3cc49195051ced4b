"""What a plan does where something differs from what it was made for, and in MuJoCo."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.checks import positive_number
from dashpot.grinding.cell import Cell
from dashpot.grinding.motion import Motion
from dashpot.grinding.passes import receded
from dashpot.grinding.removal import depth_along
from dashpot.grinding.simulation import Pass, Simulator
from dashpot.tables import table_html, table_text

if TYPE_CHECKING:
    from rich.table import Table

    from dashpot.grinding.plan import Plan

__all__ = ["Check", "Checks", "check_in", "check_plan", "mujoco_models", "replay"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Check:
    """One way to simulate a plan.

    Attributes
    ----------
    name
        What differs.
    passes
        What happened.
    depth
        (m,) depth at the plan's places, m.
    target
        Depth asked for, m.

    Examples
    --------
    >>> check = plan.check(timestep=0.002, mujoco=False).rows[0]
    >>> bool(abs(check.mean_depth / check.target - 1) < 0.01)
    True
    """

    name: str
    passes: tuple[Pass, ...]
    depth: Array
    target: float

    @property
    def uniformity(self) -> float:
        """Standard deviation of the depth over the depth asked for."""
        return float((self.depth / self.target).std())

    @property
    def largest(self) -> float:
        """Largest deviation of the depth over the depth asked for."""
        return float(np.abs(self.depth / self.target - 1).max())

    @property
    def mean_depth(self) -> float:
        """Mean depth, m."""
        return float(self.depth.mean())

    @property
    def peak_force(self) -> float:
        """Largest normal force, N."""
        return max(float(each.total.max()) for each in self.passes)

    @property
    def mean_force(self) -> float:
        """Mean normal force from the first touch of each pass to its last, N."""
        loads = [each.total for each in self.passes if (each.total > 0).any()]
        cut = [load[np.flatnonzero(load)[0] : np.flatnonzero(load)[-1] + 1] for load in loads]
        return float(np.concatenate(cut).mean()) if cut else 0.0


@dataclass(frozen=True, eq=False)
class Checks:
    """All ways to simulate a plan; prints as a table.

    Examples
    --------
    >>> checks = plan.check(timestep=0.002, mujoco=False)
    >>> checks.cells()[0][1]
    'mean depth um'
    """

    rows: tuple[Check, ...]

    def __getitem__(self, name: str) -> Check:
        """Return the row of a name."""
        for row in self.rows:
            if row.name == name:
                return row
        raise KeyError(f"no check {name!r}; there are {', '.join(r.name for r in self.rows)}")

    def cells(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Return the header and the rows as text."""
        header = ("", "mean depth um", "std %", "largest %", "mean force N", "peak force N")
        rows: list[tuple[str, ...]] = [
            (
                row.name,
                f"{1e6 * row.mean_depth:.2f}",
                f"{100 * row.uniformity:.2f}",
                f"{100 * row.largest:.2f}",
                f"{row.mean_force:.2f}",
                f"{row.peak_force:.1f}",
            )
            for row in self.rows
        ]
        return header, rows

    def table(self) -> Table:
        """Return a rich table."""
        from rich.table import Table

        header, rows = self.cells()
        table = Table(title="The same set points")
        for index, name in enumerate(header):
            table.add_column(name, justify="left" if index == 0 else "right")
        for row in rows:
            table.add_row(*row)
        return table

    def __str__(self) -> str:
        return table_text(self.table())

    def _repr_html_(self) -> str:
        return table_html(self.table())


def check_plan(
    plan: Plan,
    *,
    timestep: float,
    friction: float | None,
    stiffness: float,
    with_mujoco: bool,
    nthread: int | None,
) -> Checks:
    """Do what `Plan.check` says."""
    positive_number("check: timestep", timestep)
    positive_number("check: stiffness", stiffness)
    cell = plan.cell
    other = 4 / 3 * cell.friction if friction is None else friction
    changed = {
        "as planned": cell,
        f"friction {other:.3g}": cell.with_changes(friction=other),
        f"stiffness x {stiffness:.3g}": cell.with_changes(stiffness=cell.stiffness * stiffness),
        f"stiffness / {stiffness:.3g}": cell.with_changes(stiffness=cell.stiffness / stiffness),
    }
    rows = [_row(plan, f"plan, {1e3 * cell.timestep:g} ms", replay(plan, cell, nthread=nthread))]
    for name, each in changed.items():
        passes = replay(plan, each, timestep=timestep, nthread=nthread)
        rows.append(_row(plan, f"{name}, {1e3 * timestep:g} ms", passes))
    if with_mujoco:
        for name in mujoco_models(cell):
            for step in (cell.timestep, timestep):
                passes = replay(plan, cell, timestep=step, setting=name, nthread=nthread)
                rows.append(_row(plan, f"{name}, {1e3 * step:g} ms", passes))
    return Checks(tuple(rows))


def replay(
    plan: Plan,
    cell: Cell,
    *,
    timestep: float | None = None,
    setting: str | None = None,
    nthread: int | None = None,
) -> tuple[Pass, ...]:
    """Simulate the set points of a plan in a cell that may differ from the one it was made for.

    Parameters
    ----------
    plan
        The plan.
    cell
        The cell as it is.
    timestep
        s; None: the cell's.
    setting
        Of MuJoCo, a name of `mujoco_models`; None: dashpot.
    nthread
        Threads; None: one per core.
    """
    passes: list[Pass] = []
    for planned in plan.passes:
        motion = Motion(planned.cell, planned.path)
        # Its own workpiece: a height field recedes by what this simulation removes.
        simulator = Simulator(motion, cell=cell, timestep=timestep, nthread=nthread)
        model = None if setting is None else mujoco_models(cell)[setting]
        found = simulator.run([planned.command], mujoco_model=model)[0]
        passes.append(found)
        if cell.part.heights is not None and len(passes) < len(plan.passes):
            cell, _ = receded(cell, planned.path, found, plan.target.preston)
    return tuple(passes)


def mujoco_models(cell: Cell) -> dict[str, mujoco.MjModel]:
    """Return MuJoCo models of a cell by name: as shipped, and fitted to the contact's stiffness.

    A row of MuJoCo at rest, of impedance d, bears ``s / ((1 - d) A)`` newtons per metre with the
    direct ``solref`` (-s, -c), where A is its estimate of the inverse mass. Both fitted settings
    have s and c such that this is the cell's stiffness, and its damping, exactly. All step with
    ``implicitfast``, at which they are closest to it.
    """
    pristine = cell.parts.model
    models = {}
    for name, impedance in (
        ("MuJoCo as shipped", None),
        ("MuJoCo, direct solref", 0.9),
        ("MuJoCo, impedance 0.5", 0.5),
    ):
        model = copy.deepcopy(pristine)
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        touching = [*cell.parts.points, cell.parts.work]
        model.geom_friction[touching, 0] = cell.friction
        if impedance is not None:
            model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
            share = 1.0 / len(cell.parts.points)
            for point in cell.parts.points:
                inverse = float(model.body_invweight0[model.geom_bodyid[point], 0])
                scale = share * (1 - impedance) * inverse
                model.geom_solref[point] = -cell.stiffness * scale, -cell.damping * scale
                model.geom_solimp[point, :2] = impedance
                model.geom_priority[point] = 1
        models[name] = model
    return models


def check_in(plan: Plan, cell: Cell, name: str, *, timestep: float) -> Check:
    """Return what the set points of a plan do in a cell that may differ."""
    return _row(plan, name, replay(plan, cell, timestep=timestep))


def _row(plan: Plan, name: str, passes: tuple[Pass, ...]) -> Check:
    points, normals = plan.path.judged_points(plan.cell.tool.footprint / 4)
    depth = np.zeros(len(points))
    for each in passes:
        depth += depth_along(
            each,
            points,
            normals,
            preston=plan.target.preston,
            footprint=plan.cell.tool.footprint,
        )
    return Check(name, passes, depth, plan.target.depth)
