"""Passes of a plan, and the workpiece that they leave."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashpot.grinding.cell import Cell
from dashpot.grinding.motion import Command
from dashpot.grinding.path import Path
from dashpot.grinding.profile import Profiles
from dashpot.grinding.removal import DepthMap, depth_along
from dashpot.grinding.simulation import Pass

__all__ = ["PlannedPass", "after", "receded", "removed_by"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PlannedPass:
    """One pass of a plan.

    Attributes
    ----------
    cell
        With the workpiece as it is before the pass.
    path
        On that workpiece.
    profiles, unknowns
        Feed and force along the path.
    found
        What the simulation found.

    Examples
    --------
    >>> (planned,) = plan.passes
    >>> bool(planned.found.force.max() < 90)  # N
    True
    """

    cell: Cell
    path: Path
    profiles: Profiles
    unknowns: Array
    found: Pass

    @property
    def command(self) -> Command:
        """Motion, offset and expected force."""
        return self.profiles.command(self.unknowns)

    @property
    def duration(self) -> float:
        """From rest to rest, s."""
        return self.command.law.duration


def removed_by(done: list[PlannedPass], preston: float) -> Callable[[Array, Array], Array]:
    """Return what passes removed, as a function of points and normals."""

    def removed(points: Array, normals: Array) -> Array:
        depth = np.zeros(len(points))
        for each in done:
            depth += depth_along(
                each.found,
                points,
                normals,
                preston=preston,
                footprint=each.cell.tool.footprint,
            )
        return depth

    return removed


def after(last: PlannedPass, preston: float) -> tuple[Cell, Path]:
    """Return the cell and the path after a pass: a height field has receded."""
    return receded(last.cell, last.path, last.found, preston)


def receded(cell: Cell, path: Path, found: Pass, preston: float) -> tuple[Cell, Path]:
    """Return cell and path after a pass; other workpieces than height fields stay as they are."""
    if cell.part.heights is None:
        return cell, path
    worn = DepthMap.of_height_field(cell.part).with_pass(
        found, preston=preston, footprint=cell.tool.footprint
    )
    new = cell.with_changes(work=worn.receded(cell.part))
    return new, path.again(new)
