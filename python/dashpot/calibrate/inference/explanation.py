"""What would explain a misfit, in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dashpot.calibrate.inference.recorder_trials import Quantity
from dashpot.calibrate.problem.channels import POSES


@dataclass(frozen=True)
class Explanation:
    """A parameter of a recorder that would explain a misfit.

    Attributes
    ----------
    channel
        That reads so: ``"poses"``, or the name of a sensor, camera, event or scalar.
    quantity
        As the methods of `Parameter`; ``"sampling"``: as ``Trajectory(sampling=...)``.
    value
        The estimate, in the unit of the parameter. Of sampling 1: the other than now.
    standard_error
        In the same unit.
    share
        Of the misfit that it explains, up to 1.
    white
        Whether nothing of the misfit is seen any more with it.
    unit
        Of the value; empty where there is none.
    remedy
        How the problem would say it.
    beside
        Of a delay, the channel beside which alone it is known; empty where it is known by itself.

    Examples
    --------
    >>> from dashpot.calibrate import Explanation
    >>> late = Explanation("load", "delay", 0.02, 1e-3, 0.9, True, "s", 'Parameter.delay("load")')
    >>> print(late)
    load looks 20 ± 1 ms late (Parameter.delay("load")): explains 90 % of the misfit
    """

    channel: str
    quantity: Quantity
    value: float
    standard_error: float
    share: float
    white: bool
    unit: str = ""
    remedy: str = ""
    beside: str = ""

    def __str__(self) -> str:
        """Return what it looks like, how it is said, and how much it explains."""
        rest = "" if self.white else ", and leaves some"
        share = f"{100.0 * self.share:.0f} %"
        return f"{self._looks} ({self.remedy}): explains {share} of the misfit{rest}"

    @property
    def _looks(self) -> str:
        value, error = self.value, self.standard_error
        if self.quantity == "delay":
            which = "late" if value > 0.0 else "early"
            beside = f" beside {self.beside}" if self.beside else ""
            look = "look" if self.channel == POSES else "looks"
            told = _told(1e3 * abs(value), 1e3 * error)
            return f"{self.channel} {look} {told} ms {which}{beside}"
        if self.quantity == "gain":
            return f"{self.channel} looks {_told(value, error)} times as large as it is"
        if self.quantity == "scale":
            which = "large" if value > 1.0 else "small"
            told = _told(100.0 * abs(value - 1.0), 100.0 * error)
            return f"positions look {told} % too {which}"
        if self.quantity == "offset":
            which = "large" if value > 0.0 else "small"
            return f"{self.channel} looks {_told(abs(value), error)} {self.unit} too {which}"
        mean = "mean" in self.remedy
        return (
            f"{self.channel} looks like {'means, not instants' if mean else 'instants, no means'}"
        )


def _told(value: float, error: float) -> str:
    """Return a value with the digits that its error leaves, and the error."""
    digits = int(np.clip(np.ceil(-np.log10(error)), 0, 9)) if error > 0.0 else 6
    return f"{value:.{digits}f} ± {error:.{digits}f}"
