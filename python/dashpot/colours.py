"""Colours of the package's figures: one for each way of stepping, the same in every figure."""

from __future__ import annotations

from collections.abc import Iterable

# Okabe and Ito's palette, told apart by colour-blind readers; dashpot comes first, in blue.
COLOURS = ("#0072b2", "#d55e00", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#000000")

MEASURED = "#3c4043"

_OWN = {
    name: COLOURS[index]
    for index, names in enumerate(
        (
            ("dashpot",),
            ("mujoco-default", "MuJoCo", "mujoco"),
            ("elliptic",),
            ("impratio",),
            ("solref-direct",),
            ("discrete",),
            ("noslip",),
        )
    )
    for name in names
}


def colours_of(settings: Iterable[str]) -> dict[str, str]:
    """Return the colour of each setting: its own where it is known, else one that is left."""
    names = list(settings)
    chosen = {name: _OWN[name] for name in names if name in _OWN}
    left = [colour for colour in COLOURS[1:] if colour not in chosen.values()] or [COLOURS[-1]]
    others = [name for name in names if name not in chosen]
    for index, name in enumerate(others):
        chosen[name] = left[index % len(left)]
    return chosen
