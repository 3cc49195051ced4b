"""Materials as contact pairs for steps of MuJoCo's own, with a solref of equal statics.

With one impedance d for all depths, a direct ``solref = (-s, -b)`` and A, MuJoCo's estimate of the
inverse mass of a contact, a row at rest carries a load with the stiffness s / ((1 - d) A), and it
swings with the damping ratio that b has to s (`dashpot.law.solref_to_spring_at_rest`). So a spring
k and a damper c are, with w the inverse mass that moves,

    s = k (1 - d) A,      b = 2 zeta sqrt(s),      zeta = c sqrt(w / k) / 2.
"""

from __future__ import annotations

import mujoco
import numpy as np

from dashpot.engine import Engine

# MuJoCo's default at depth: less would let contacts swing slower than their masses do.
_IMPEDANCE = 0.95


def add_pairs(spec: mujoco.MjSpec, engine: Engine) -> list[str]:
    """Add a contact pair for each two geoms whose materials are soft; return notes.

    Raises
    ------
    ValueError
        Naming the contact that MuJoCo has no counterpart for.
    """
    model = engine.model
    written, rigid = [], 0
    for first, second in _touching(engine):
        material = engine.contact_material(first, second)
        if material.source not in ("pair", "geoms"):
            continue
        names = [model.geom(geom).name for geom in (first, second)]
        label = f"the contact of geoms {names[0] or first!r} and {names[1] or second!r}"
        if material.stiffness is None:
            rigid += 1
            continue
        if not all(names):
            raise ValueError(f"{label} cannot be a <pair>: a geom has no name")
        if material.loaded_friction != 1.0:
            raise ValueError(f"{label} has friction that falls with load, which MuJoCo's does not")
        estimate = sum(
            float(model.body_invweight0[model.geom_bodyid[g], 0]) for g in (first, second)
        )
        if estimate <= 0.0:
            continue
        stiffness = float(material.stiffness) * (1.0 - _IMPEDANCE) * estimate
        ratio = float(material.damping_ratio) + 0.5 * float(material.damping) * np.sqrt(
            estimate / float(material.stiffness)
        )
        sliding, _, torsional, rolling, _ = material.friction
        spec.add_pair(
            geomname1=names[0],
            geomname2=names[1],
            solref=[-stiffness, -2.0 * ratio * np.sqrt(stiffness)],
            solimp=[_IMPEDANCE, _IMPEDANCE, 0.001, 0.5, 2.0],
            friction=[sliding, sliding, torsional, rolling, rolling],
            condim=int(max(model.geom_condim[first], model.geom_condim[second])),
        )
        written.append(f"{names[0]} with {names[1]}")
    notes = []
    if written:
        # Of a pyramidal cone the edges bear a load together, more stiffly by its friction.
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        notes.append(
            "As solref and solimp of contact pairs, for MuJoCo with elliptic cones, which sink in "
            f"at rest as far as the materials do: {', '.join(written)}. Impacts last longer there: "
            "MuJoCo's contacts move as if their masses were 20 times as large."
        )
    if rigid:
        notes.append(f"Without a solref, as they are rigid: {rigid} contacts.")
    return notes


def _touching(engine: Engine) -> list[tuple[int, int]]:
    """Return the pairs of geoms of which one has a material and that the model lets touch."""
    model = engine.model
    chosen = set(engine.materials) | {geom for pair in engine.pair_materials for geom in pair}
    present = {tuple(sorted(pair)) for pair in zip(model.pair_geom1, model.pair_geom2, strict=True)}
    found = []
    for first in range(model.ngeom):
        for second in range(first + 1, model.ngeom):
            if not chosen & {first, second} or (first, second) in present:
                continue
            bodies = model.body_weldid[model.geom_bodyid[[first, second]]]
            collide = (model.geom_contype[first] & model.geom_conaffinity[second]) or (
                model.geom_contype[second] & model.geom_conaffinity[first]
            )
            if collide and bodies[0] != bodies[1]:
                found.append((first, second))
    return found
