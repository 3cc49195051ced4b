"""Contacts and energies as tables: names, units and what each number is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from rich.table import Table

    from dashpot.contacts import Contacts, Energy
    from dashpot.linearization import Linearization

__all__ = ["contacts_table", "energy_table", "linearization_table"]

# As many contacts are shown; the rest is counted.
_MOST_ROWS = 20

_OF_STEP = {
    "A": "state after the step, by the state before it",
    "B": "state after the step, by the controls",
    "C": "sensors, by the state before the step",
    "D": "sensors, by the controls",
}
# As many eigenvalues are shown.
_MOST_EIGENVALUES = 6

_MEANING = {
    "kinetic": "of motion",
    "potential": "of gravity, and of springs of joints, tendons and flexes",
    "elastic": "in springs of contacts, limits and equalities",
    "mechanical": "sum of the three above",
    "dissipated_normal": "by dampers of contacts",
    "dissipated_friction": "by friction of contacts",
    "dissipated_constraint": "by limits, equalities and dry friction",
    "dissipated_recovery": "by springs that geometry left behind",
    "dissipated_damping": "by dampers of joints and tendons, and by fluids",
    "dissipated": "sum of the five above",
    "work": "done by actuators, applied forces and mocap bodies",
    "total": "mechanical + dissipated - work: constant",
}


def contacts_table(contacts: Contacts) -> Table:
    """Return a table with a row for each contact, up to twenty."""
    positions = np.reshape(contacts.position, (-1, 3))
    gaps, forces = np.atleast_1d(contacts.gap), np.reshape(contacts.force, (-1, 3))
    count = len(gaps)
    table = _empty(f"{count} contact{'' if count == 1 else 's'}")
    table.add_column("geom 1", overflow="fold")
    table.add_column("geom 2", overflow="fold")
    for heading in (
        "position\n[m]",
        "gap\n[m]",
        "compression\n[m]",
        "normal\nforce [N]",
        "friction\n[N]",
    ):
        table.add_column(_plain(heading), justify="right", no_wrap=True)
    table.add_column("sticks")
    names = np.reshape(contacts.names, (-1, 2))
    compressions = np.atleast_1d(contacts.compression)
    sticking = np.atleast_1d(contacts.sticking)
    for i in range(min(count, _MOST_ROWS)):
        numbers = (
            " ".join(f"{round(float(x), 4) + 0.0:.4f}" for x in positions[i]),
            f"{gaps[i]:.3g}",
            f"{compressions[i]:.3g}",
            f"{forces[i, 0]:.4g}",
            f"{np.linalg.norm(forces[i, 1:]):.4g}",
        )
        held = "yes" if sticking[i] else "no"
        table.add_row(*map(_plain, (*names[i], *numbers, held)))
    if count > _MOST_ROWS:
        table.caption = f"and {count - _MOST_ROWS} more"
    return table


def energy_table(energy: Energy) -> Table:
    """Return a table with a row for each account and each sum."""
    table = _empty("energy")
    table.add_column("")
    table.add_column(_plain("[J]"), justify="right")
    table.add_column("what it is")
    for name, meaning in _MEANING.items():
        table.add_row(name, f"{getattr(energy, name):.6g}", meaning)
    return table


def linearization_table(step: Linearization) -> Table:
    """Return a table with a row for each matrix; the largest eigenvalues of A are below it."""
    table = _empty("a step, x' = A x + B u, y = C x + D u")
    table.add_column("")
    table.add_column("shape")
    table.add_column("largest entry", justify="right")
    table.add_column("what it is")
    for name, meaning in _OF_STEP.items():
        matrix = getattr(step, name)
        largest = f"{np.abs(matrix).max(initial=0.0):.4g}"
        table.add_row(name, str(matrix.shape), largest, meaning)
    if step.A.size and np.isfinite(step.A).all():
        sizes = np.sort(np.abs(np.linalg.eigvals(step.A)))[::-1]
        more = ", ..." if len(sizes) > _MOST_EIGENVALUES else ""
        told = ", ".join(f"{size:.5g}" for size in sizes[:_MOST_EIGENVALUES])
        table.caption = f"eigenvalues of A, magnitude: {told}{more}"
    return table


def _empty(title: str) -> Table:
    from rich import box
    from rich.table import Table

    return Table(
        title=title,
        box=box.SIMPLE,
        padding=(0, 1, 0, 0),
        pad_edge=False,
        title_justify="left",
        caption_justify="left",
    )


def _plain(text: str) -> str:
    """Return a text whose brackets rich does not read as markup."""
    from rich.markup import escape

    return escape(text)
