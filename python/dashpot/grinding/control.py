"""How the arm is controlled: by position, by impedance, or by force."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dashpot.checks import positive_number

__all__ = ["Control"]


@dataclass(frozen=True)
class Control:
    """A controller of the arm, which sends set points at a rate and holds them in between.

    Parameters
    ----------
    kind
        ``"position"``: the servos of the joints follow angles, with what torque the motion needs
        fed forward. ``"impedance"``: the tip hangs on springs at a moving pose; gravity is
        compensated. ``"force"``: position control whose offset along the normal follows the force
        that is read, ``offset' = gain (wanted - read)``.
    rate
        Set points, and readings of the force, per second, 1/s, > 0. A controller that
        interpolates is one with the rate of its interpolation.
    stiffness, damping
        Of position servos, N m/rad and N m s/rad; None: those of the arm's own actuators.
    linear_stiffness, angular_stiffness
        Of the impedance, N/m and N m/rad, > 0.
    linear_damping, angular_damping
        N s/m and N m s/rad, > 0.
    gain
        Of the force control, m/(N s), > 0.
    feeds_force
        Whether set points are ahead by what the force that is expected bends the arm, so that it
        stays on the path: load and friction deflect an arm sideways too.

    Examples
    --------
    >>> grinding.Control("impedance", linear_stiffness=4000.0).kind
    'impedance'
    """

    kind: Literal["position", "impedance", "force"] = "position"
    rate: float = 500.0
    stiffness: float | None = None
    damping: float | None = None
    linear_stiffness: float = 1e4
    linear_damping: float = 400.0
    angular_stiffness: float = 500.0
    angular_damping: float = 20.0
    gain: float = 5e-4
    feeds_force: bool = True

    def __post_init__(self) -> None:
        if self.kind not in ("position", "impedance", "force"):
            raise ValueError(
                f"Control: kind is {self.kind!r}, none of 'position', 'impedance', 'force'"
            )
        for name in (
            "rate",
            "linear_stiffness",
            "linear_damping",
            "angular_stiffness",
            "angular_damping",
            "gain",
        ):
            positive_number(f"Control: {name}", getattr(self, name))
        if (self.stiffness is None) != (self.damping is None):
            raise ValueError("Control: give stiffness and damping of the servos, or neither")
        if self.stiffness is not None:
            positive_number("Control: stiffness", self.stiffness)
            positive_number("Control: damping", self.damping)

    @property
    def period(self) -> float:
        """Time between set points, s."""
        return 1.0 / self.rate
