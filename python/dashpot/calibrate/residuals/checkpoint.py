"""What a fit has simulated, kept in a file, so that a fit that was ended goes on.

A fit is a function of its problem and options: made again, it asks for the same points in the same
order. So the file holds residuals by the points that they are of, and a fit with them does nothing
twice and comes to the same bits. It is written whole, to a new file that then takes the place of
the old one: every ten seconds or more, at an exception, and at the end.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.residuals.candidates import SimulationError
from dashpot.data.archive import ArrayArchive

if TYPE_CHECKING:
    from dashpot.calibrate.residuals.objective import Objective

Array = NDArray[np.float64]

_FORMAT = 1
_KEY = 20  # bytes of a key
_LEAST_INTERVAL = 10.0
# Of the time, writing takes at most one part of so many.
_SHARE = 20.0


class Checkpoint:
    """A file of residuals by points.

    Parameters
    ----------
    path
        Where it is; it need not be there.

    Raises
    ------
    ValueError
        Where the file is no checkpoint.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._known: dict[bytes, tuple[Array, dict[int, str]]] = {}
        self._checked = False
        self._written = time.monotonic()
        self._interval = _LEAST_INTERVAL
        self.reused = 0
        if self.path.exists():
            self._load()
        if not self.path.absolute().parent.is_dir():
            raise ValueError(f"checkpoint: there is no folder {self.path.absolute().parent}")

    def __enter__(self) -> Checkpoint:
        return self

    def __exit__(self, *exception: object) -> None:
        """Write the file, whatever ended the fit."""
        self.write()

    def find(
        self, objective: Objective, points: Array
    ) -> tuple[Array, dict[int, SimulationError]] | None:
        """Return what is known of points of an objective, None where nothing is.

        Raises
        ------
        ValueError
            Where a first point, simulated again, is not what the file says: it is of another fit.
        """
        known = self._known.get(_key(objective, points))
        if known is None:
            return None
        if not self._checked:
            again, _ = objective.simulate(points[:1])
            if not np.array_equal(again[0], known[0][0]):
                raise ValueError(
                    f"checkpoint {self.path} is of another problem, or of other software: its "
                    "first residuals are others; remove it to begin anew"
                )
            self._checked = True
        self.reused += len(points)
        residuals, failures = known
        return residuals.copy(), {row: SimulationError(why) for row, why in failures.items()}

    def add(
        self,
        objective: Objective,
        points: Array,
        residuals: Array,
        failures: Mapping[int, SimulationError],
    ) -> None:
        """Keep what was simulated, and write it where the last time is long ago."""
        self._checked = True
        kept = {row: str(failure) for row, failure in failures.items()}
        self._known[_key(objective, points)] = residuals.copy(), kept
        if time.monotonic() - self._written > self._interval:
            self.write()

    def write(self) -> None:
        """Write the file."""
        began = time.monotonic()
        entries = list(self._known.values())
        failures = {k: entry[1] for k, entry in enumerate(entries) if entry[1]}
        new = self.path.with_name(self.path.name + ".new")
        with new.open("wb") as file:
            np.savez(
                file,
                format=np.array([_FORMAT]),
                keys=np.frombuffer(b"".join(self._known), np.uint8).reshape(-1, _KEY),
                shapes=np.array([entry[0].shape for entry in entries]).reshape(-1, 2),
                residuals=np.concatenate([np.empty(0), *(entry[0].ravel() for entry in entries)]),
                failures=np.frombuffer(json.dumps(failures).encode(), np.uint8),
            )
        os.replace(new, self.path)
        self._written = time.monotonic()
        self._interval = max(_LEAST_INTERVAL, _SHARE * (self._written - began))

    def _load(self) -> None:
        try:
            # Its numbers are not packed, so that they take no more than the file does.
            with ArrayArchive(self.path, 2 * self.path.stat().st_size) as archive:
                names = {"format", "keys", "shapes", "residuals", "failures"}
                if set(archive) != names:
                    raise ValueError(f"it holds {', '.join(archive) or 'nothing'}")
                found = {name: archive.read(name) for name in names}
            if found["format"].tolist() != [_FORMAT]:
                raise ValueError(f"its format is {found['format']}, not {_FORMAT}")
            self._take(found)
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
            raise ValueError(f"checkpoint {self.path} cannot be read: {error}") from error

    def _take(self, found: Mapping[str, NDArray[Any]]) -> None:
        keys, shapes, numbers = found["keys"], found["shapes"], found["residuals"]
        if keys.dtype != np.uint8 or keys.ndim != 2 or keys.shape[1] != _KEY:
            raise ValueError("its keys are no keys")
        if shapes.dtype != np.int64 or shapes.shape != (len(keys), 2) or (shapes < 0).any():
            raise ValueError("its shapes are no shapes")
        sizes = [int(rows) * int(columns) for rows, columns in shapes]
        if numbers.dtype != np.float64 or numbers.shape != (sum(sizes),):
            raise ValueError("its residuals are not as many as it says")
        failures = json.loads(bytes(found["failures"].astype(np.uint8)).decode())
        parts = np.split(numbers, np.cumsum(sizes)[:-1]) if sizes else []
        for k, (key, shape, part) in enumerate(zip(keys, shapes, parts, strict=True)):
            why = {int(row): str(text) for row, text in failures.get(str(k), {}).items()}
            if any(not 0 <= row < shape[0] for row in why):
                raise ValueError("it says of rows that fail which are none")
            self._known[key.tobytes()] = part.reshape(shape), why


def _key(objective: Objective, points: Array) -> bytes:
    """Return a name of points of an objective: of what it compares, not only where."""
    digest = hashlib.sha256(objective.fingerprint)
    digest.update(np.ascontiguousarray(points).tobytes())
    return digest.digest()[:_KEY]
