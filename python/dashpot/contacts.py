"""What a step leaves behind: contacts and energies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any, SupportsIndex

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.object_ids import Element, object_id
from dashpot.step_tables import contacts_table, energy_table
from dashpot.tables import table_html, table_text

__all__ = ["Contacts", "Energy"]


@dataclass(frozen=True, eq=False, repr=False)
class Contacts:
    """Contacts of the last step: the ``n`` that touched in it or overlapped at its start.

    They print, and show in notebooks, as a table with names and units.

    What detection saw ahead and did not touch is counted in ``StepStats.contacts`` alone.

    Geometry and velocity are those at the start of the step, force and torque its mean, and
    compression, displacement and sticking those at its end. Vectors are in the contact frame, whose
    rows are the normal (from geom 1 to geom 2) and two tangents. Motion is that of geom 2 relative
    to geom 1 and force acts on geom 2.

    Attributes
    ----------
    geom : (n, 2) int array
        Geom ids; -1 where that side is a flex.
    flex : (n, 2) int array
        Flex ids; -1 where that side is a geom.
    names : (n, 2) array of strings
        Names of the geoms or flexes; of those without one, kind and id, as "geom 3".
    position : (n, 3) array
        Contact points, world, m.
    frame : (n, 3, 3) array
        Contact frames; rows are normal, tangent 1, tangent 2 in the world.
    gap : (n,) array
        Distance between the surfaces less the margin of the contact, m, negative in overlap.
    velocity : (n, 3) array
        Relative velocity of the surfaces, m/s; the first component is the gap rate.
    force : (n, 3) array
        Contact force, N; only the adhesion of geoms makes the first component negative.
    torque : (n, 3) array
        Torsional and rolling friction torque, N m.
    compression : (n,) array
        Compression of the normal spring, m, >= 0.
    displacement : (n, 3) array
        Elastic displacement, m: the negative compression and the two sliding springs.
    sticking : (n,) bool array
        Whether friction held at the end of the step.

    Examples
    --------
    >>> contacts = engine.contacts(data, body="ball")
    >>> contacts.force.round(3)  # N: the weight, along the normal
    array([[9.81, 0.  , 0.  ]])
    >>> contacts.compression.round(6)  # m
    array([0.000981])
    """

    geom: NDArray[np.int32]
    flex: NDArray[np.int32]
    names: NDArray[np.str_]
    position: NDArray[np.float64]
    frame: NDArray[np.float64]
    gap: NDArray[np.float64]
    velocity: NDArray[np.float64]
    force: NDArray[np.float64]
    torque: NDArray[np.float64]
    compression: NDArray[np.float64]
    displacement: NDArray[np.float64]
    sticking: NDArray[np.bool_]

    def __len__(self) -> int:
        if np.ndim(self.gap) == 0:
            raise TypeError("a single contact has no length")
        return len(self.gap)

    def __getitem__(
        self,
        chosen: NDArray[np.bool_]
        | NDArray[np.integer[Any]]
        | Sequence[bool]
        | Sequence[int]
        | slice
        | SupportsIndex,
    ) -> Contacts:
        """Return the contacts that indices, a mask or a slice choose.

        An integer, or iteration, gives single contacts: their fields have no first axis.
        """
        return Contacts(**{f.name: getattr(self, f.name)[chosen] for f in fields(self)})

    def __iter__(self) -> Iterator[Contacts]:
        """Yield single contacts."""
        return (self[i] for i in range(len(self)))

    def __repr__(self) -> str:
        """Return the table as text, of up to twenty contacts."""
        return table_text(contacts_table(self)).rstrip()

    def _repr_html_(self) -> str:
        """Return the table for notebooks."""
        return table_html(contacts_table(self))


def names_of_sides(model: mujoco.MjModel) -> NDArray[np.str_]:
    """Return the names of all geoms, then of all flexes, that contacts may have as a side."""
    geoms = [model.geom(i).name or f"geom {i}" for i in range(model.ngeom)]
    flex = mujoco.mjtObj.mjOBJ_FLEX
    flexes = [mujoco.mj_id2name(model, flex, i) or f"flex {i}" for i in range(model.nflex)]
    return np.array([*geoms, *flexes], dtype=np.str_)


def of_objects(
    found: Contacts,
    model: mujoco.MjModel,
    geom: Element | None,
    body: Element | None,
    pair: Sequence[Element] | None,
) -> Contacts:
    """Return the contacts of a geom, of a body's own geoms and between a pair, where given."""
    chosen = np.ones(len(found), dtype=np.bool_)
    if geom is not None:
        chosen &= (found.geom == object_id(model, geom, "geom", "geom")).any(axis=1)
    if body is not None:
        index = object_id(model, body, "body", "body")
        of_body = model.geom_bodyid[found.geom] == index
        chosen &= (of_body & (found.geom >= 0)).any(axis=1)
    if pair is not None:
        if not isinstance(pair, tuple | list) or len(pair) != 2:
            raise ValueError(f"pair is {pair!r}; it must be two geoms")
        first, second = (object_id(model, g, "geom", "pair") for g in pair)
        if first == second:
            raise ValueError(f"pair is {pair!r}: the same geom twice")
        chosen &= (found.geom == first).any(axis=1) & (found.geom == second).any(axis=1)
    return found if chosen.all() else found[chosen]


@dataclass(frozen=True, repr=False)
class Energy:
    """Energies in J; dissipated ones are totals since the data were made or reset.

    It prints, and shows in notebooks, as a table.

    ``potential`` is that of gravity, of springs of joints and tendons, and of flexes. Flexes that
    are interpolated between nodes (``dof="trilinear"`` and its like) are left out: totals change
    with what they store. ``elastic`` is stored in the springs of contacts, limits and equalities,
    and ``dissipated_constraint`` is what limits, equalities and dry friction loss have dissipated.
    ``dissipated_normal`` is what dampers of contacts took, and the error in the energy of bodies
    that turn while they hit, of either sign. Of elastic hits it is that error alone.
    ``dissipated_recovery`` is elastic energy given up where geometry left a spring behind, less
    what the recovery of unstressed overlap put in; it can be negative. ``dissipated_damping`` went
    to the dampers of joints and tendons and to fluids. In steps with impacts on damped joints, its
    split from what the rows dissipated is of first order in the time step. ``work`` is what
    actuators, applied forces, gravity compensation and the motion of mocap bodies did, its negative
    what they took. Where the user moves springs or masses in jumps (states, far jumps of mocap
    bodies, edits of the model), energy changes by what that does. So it does by the weight of mocap
    bodies, times what it is lifted, where they get their first pose after the energy was asked for.
    They are taken there without motion.

    Examples
    --------
    >>> energy = engine.energy(data)
    >>> round(energy.elastic, 6), round(energy.dissipated_normal, 3)
    (0.00483, 0.986)
    """

    kinetic: float
    potential: float
    elastic: float
    dissipated_normal: float
    dissipated_friction: float
    dissipated_constraint: float
    dissipated_recovery: float
    dissipated_damping: float
    work: float

    @property
    def mechanical(self) -> float:
        """Kinetic, potential and elastic energy."""
        return self.kinetic + self.potential + self.elastic

    @property
    def dissipated(self) -> float:
        """Everything that contacts, constraints and dampers took out."""
        return (
            self.dissipated_normal
            + self.dissipated_friction
            + self.dissipated_constraint
            + self.dissipated_recovery
            + self.dissipated_damping
        )

    @property
    def total(self) -> float:
        """Mechanical and dissipated energy less the work done: constant but for integration."""
        return self.mechanical + self.dissipated - self.work

    def __repr__(self) -> str:
        """Return the table as text."""
        return table_text(energy_table(self)).rstrip()

    def _repr_html_(self) -> str:
        """Return the table for notebooks."""
        return table_html(energy_table(self))
