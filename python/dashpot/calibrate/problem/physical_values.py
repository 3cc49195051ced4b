"""Which values of a model's arrays make a body, a joint or a contact at all."""

from __future__ import annotations

import mujoco
import numpy as np

# What moves has mass, inertia and size.
_POSITIVE = ("body_mass", "body_inertia", "geom_size")
# Below 0 these would give energy, or mean nothing. Springs may have any sign.
_NON_NEGATIVE = (
    "dof_damping",
    "dof_armature",
    "dof_frictionloss",
    "geom_friction",
    "geom_solmix",
    "pair_friction",
    "tendon_damping",
    "tendon_armature",
    "tendon_frictionloss",
    "actuator_damping",
    "actuator_armature",
)
# Of flat bodies the largest moment is the sum of the others to rounding.
_ROUNDING = 1e-9


def check_bounds(attribute: str, elements: str, bounds: tuple[float, float]) -> None:
    """Raise ValueError where values between `bounds` are none that `attribute` can have."""
    lower = bounds[0]
    if attribute in _POSITIVE and not lower > 0.0:
        raise ValueError(f"{attribute} of {elements} must be > 0, and bounds begin at {lower:g}")
    if attribute in _NON_NEGATIVE and lower < 0.0:
        raise ValueError(f"{attribute} of {elements} must be >= 0, and bounds begin at {lower:g}")


def check_inertia(model: mujoco.MjModel, body: int) -> None:
    """Raise ValueError where the moments of inertia of a body are those of no body.

    Each is at most the sum of the other two.
    """
    moments = model.body_inertia[body]
    largest, others = float(moments.max()), float(np.sort(moments)[:2].sum())
    if largest > others * (1.0 + _ROUNDING):
        name = model.body(body).name or str(body)
        listed = ", ".join(f"{moment:.6g}" for moment in moments)
        raise ValueError(
            f"body_inertia of body '{name}' would be ({listed}), that of no body: {largest:.6g} "
            f"is more than the other two together, {others:.6g}"
        )
