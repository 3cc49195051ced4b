"""Channels of a trajectory: what one recorder wrote, when, and how well.

The poses of a trajectory are one channel, each of its sensors, kinds of events and scalars another.
Whatever is compared with a recording, shown or tested is so channel by channel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.problem.layout import POSES, Block
from dashpot.calibrate.problem.observables import Sensor

Array = NDArray[np.float64]
ChannelKind = Literal["poses", "sensor", "event", "scalar", "residual"]

__all__ = ["POSES", "Channel", "ChannelKind"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Channel:
    """One recorder's numbers of one trajectory.

    Attributes
    ----------
    name
        ``"poses"``, or the name of the sensor, event, scalar or function of residuals.
    kind
        What it is of.
    time
        (rows,) s from the first frame. Of scalars, of residuals, and of what happens at a time that
        is itself observed, the end of the trajectory.
    observed
        (rows, columns) in the unit of the channel; of poses (frames, 7 bodies), position and
        quaternion. Any finite number stands for what was not measured.
    sigma
        (columns,) standard deviations, inf where nothing was measured; of poses (6 bodies,).
    measured
        (rows, columns) whether it was measured; of poses (frames, 6 bodies).
    sensor
        The sensor of the model.
    window
        s, over which a sensor takes means, before each of its times; 0: it reads at these times.
    own_clock
        Whether its times are not those of the frames.
    turn
        rad, within which an angle was read that is now counted on from there; 0: of others.
    """

    name: str
    kind: ChannelKind
    time: Array
    observed: Array
    sigma: Array
    measured: NDArray[np.bool_]
    sensor: Sensor | None = None
    window: float = 0.0
    own_clock: bool = False
    turn: float = 0.0

    @property
    def block(self) -> Block:
        """Where its residuals stand: rows and columns."""
        return Block(self.name, *self.measured.shape)

    @property
    def with_frames(self) -> bool:
        """Whether its times are of frames, which may be farther apart than stated, or less."""
        return not (self.own_clock or self.kind == "event")

    def off(self, reading: Array) -> Array:
        """Return (..., rows, columns) numbers read less those observed.

        Which turn an angle starts in, one that is read within a turn does not tell.
        """
        error = reading - self.observed
        if self.turn:
            first = error[..., int(np.argmax(self.measured[:, 0])), :]
            error = error - self.turn * np.round(first / self.turn)[..., None, :]
        return np.asarray(error)
