"""The contact law of the C++ core, vectorised over numpy arrays.

One contact has the gap ``g`` (m, negative in penetration), the gap rate ``u = g'`` (m/s) and the
apparent inverse mass ``w`` (1/kg). With the acceleration ``b`` (m/s^2) of the gap from everything
but its own force it obeys

    g'' = b + w f,    f = max(0, -k g - d g')  while g < 0,  else 0.

Between events this is linear and its flow is closed form; onset, release and re-contact inside the
interval are solved. All arguments broadcast; results have the broadcast shape.
"""

from __future__ import annotations

from dashpot.law.flow import Flow, Propagator, flow_contact, flow_spring, propagate
from dashpot.law.friction import radial_return, return_to_limit
from dashpot.law.restitution import damping_ratio_to_restitution, restitution_to_damping_ratio
from dashpot.law.solref import solref_to_spring, solref_to_spring_at_rest

__all__ = [
    "Flow",
    "Propagator",
    "damping_ratio_to_restitution",
    "flow_contact",
    "flow_spring",
    "propagate",
    "radial_return",
    "restitution_to_damping_ratio",
    "return_to_limit",
    "solref_to_spring",
    "solref_to_spring_at_rest",
]
