"""What has to be known to read a comparison: softness of the model's own, and a start that strains.

Energy that a run ends with above its start has two honest sources: actuators, whose work is
measured and taken off, and a start that violates a limit, an equality or a surface. What mends that
pushes bodies, and no measurement can tell its work from an error.
"""

from __future__ import annotations

import mujoco
import numpy as np

from dashpot.engine import Engine

__all__ = ["softness_of_the_model", "violations_at_start"]

# m or rad; what a start violates by less is rounding of the numbers in the MJCF.
_STRAIN = 1e-4
# m; bodies at rest overlap by less.
_OVERLAP = 1e-3
_NAMED = 3

_EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
_LIMITS = {
    int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT): (mujoco.mjtObj.mjOBJ_JOINT, "joint"),
    int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON): (mujoco.mjtObj.mjOBJ_TENDON, "tendon"),
}


def softness_of_the_model(engine: Engine) -> str:
    """Say which geoms' own ``solref`` or ``solimp`` decide how soft contacts are, "" for none."""
    model = engine.model
    default = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom size="1"/></worldbody></mujoco>'
    )
    touching = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    own = (model.geom_solref != default.geom_solref[0]).any(axis=1)
    own |= (model.geom_solimp != default.geom_solimp[0]).any(axis=1)
    soft = [int(g) for g in np.flatnonzero(own & touching) if int(g) not in engine.materials]
    if not soft or engine.law == "comfree":
        return ""
    names = [model.geom(g).name or f"geom {g}" for g in soft]
    return (
        f"{len(soft)} of {int(touching.sum())} geoms have a solref or solimp of their own: "
        f"{_listed(names)}. How deep these sink at rest is the model's choice, in dashpot as in "
        "MuJoCo, and solref-direct keeps it. A material takes its place; Material() is rigid."
    )


def violations_at_start(model: mujoco.MjModel, start: mujoco.MjData) -> str:
    """Say which limits, equalities and surfaces a start violates, and by how much; "" for none."""
    data = mujoco.MjData(model)
    mujoco.mj_copyState(model, start, data, int(mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_forward(model, data)
    found: dict[str, tuple[float, str]] = {}

    def add(what: str, amount: float, unit: str) -> None:
        if amount > found.get(what, (0.0, ""))[0]:
            found[what] = (amount, unit)

    for row in range(data.nefc):
        kind, index = int(data.efc_type[row]), int(data.efc_id[row])
        amount = float(data.efc_pos[row])
        if kind == _EQUALITY and abs(amount) > _STRAIN:
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_EQUALITY, index)
            add(f"equality {name or index}", abs(amount), "")
        elif kind in _LIMITS and -amount > _STRAIN:
            object_type, word = _LIMITS[kind]
            name = mujoco.mj_id2name(model, object_type, index)
            slides = word == "tendon" or model.jnt_type[index] == mujoco.mjtJoint.mjJNT_SLIDE
            add(f"the limit of {word} {name or index}", -amount, "m" if slides else "rad")
    for contact in data.contact:
        if -contact.dist > _OVERLAP and (contact.geom >= 0).all():
            names = [model.geom(g).name or f"geom {g}" for g in contact.geom]
            add(f"the surfaces of {names[0]} and {names[1]}", -float(contact.dist), "m")
    worst = sorted(found.items(), key=lambda item: -item[1][0])
    told = [f"{what} by {amount:.3g} {unit}".rstrip() for what, (amount, unit) in worst]
    return _listed(told)


def _listed(names: list[str]) -> str:
    """Join names, the first three and how many more there are."""
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more
