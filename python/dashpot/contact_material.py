"""What contacts between two geoms have, after combination and overrides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["ContactMaterial"]


@dataclass(frozen=True, kw_only=True)
class ContactMaterial:
    """What contacts between two geoms have, after combination and overrides.

    A contact of apparent mass m (kg) has ``damping + 2 damping_ratio sqrt(stiffness m)`` in N s/m.

    Attributes
    ----------
    source
        Where stiffness and damping come from. ``"pair"``: the pair's own material. ``"geoms"``: the
        combination of the geoms' materials. ``"solref"``: the model's own ``solref`` and
        ``solimp``, where neither geom was given a material. ``"rigid"``: the model sets none
        either.
    stiffness
        Stiffness k, N/m. None where it is not the material's. Rigid contacts are as stiff as the
        micro-step resolves. Those of a ``solref`` have that of
        :func:`dashpot.law.solref_to_spring_at_rest`, which depends on the masses and the load.
    damping
        N s/m, of materials that were given in N s/m.
    damping_ratio
        Of materials that were given by damping ratio or restitution, and of ``solref``. Where one
        of each kind meet, this and `damping` both act.
    restitution
        Of a contact without load, where its damping is fixed by the damping ratio. None where it
        depends on the masses (`damping`). None, too, of rigid contacts that were not given a
        restitution: their ratio is that of all rigid contacts together.
    friction
        At light load: two sliding coefficients, one torsional and two rolling ones (m), as in
        ``mjContact``.
    condim
        1, 3, 4 or 6: which of them act, as in ``mjContact.dim``.
    loaded_friction, friction_load, tangential_ratio, tangential_damping_ratio
        As in `Material`.
    solref, solimp
        What MuJoCo reads for the pair; without effect unless `source` is ``"solref"``.

    Examples
    --------
    >>> contact = engine.contact_material("ball", "floor")
    >>> contact.source, contact.stiffness, contact.restitution, contact.friction[0]
    ('pair', 10000.0, 0.6, 0.3)
    >>> engine.contact_material("box", "floor").source
    'rigid'
    """

    source: Literal["pair", "geoms", "solref", "rigid"]
    stiffness: float | None
    damping: float
    damping_ratio: float
    restitution: float | None
    friction: tuple[float, float, float, float, float]
    condim: int
    loaded_friction: float
    friction_load: float
    tangential_ratio: float
    tangential_damping_ratio: float
    solref: tuple[float, float]
    solimp: tuple[float, float, float, float, float]
