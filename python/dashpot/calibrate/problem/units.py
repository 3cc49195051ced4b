"""Units of parameters and sensors, as tables and figures say them."""

from __future__ import annotations

import mujoco

from dashpot.calibrate.problem.inertia_setter import UNITS, InertiaSetter
from dashpot.calibrate.problem.parameters import Parameter
from dashpot.calibrate.problem.pixels import lens_of
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.problem.sensing import SensingSetter
from dashpot.calibrate.problem.setters import MaterialSetter, ModelSetter, PairSetter
from dashpot.calibrate.problem.vectors import Joint
from dashpot.object_ids import id_of_name, object_id

_OF_QUANTITY = {
    "stiffness": "N/m",
    "damping": "N s/m",
    "torsional_friction": "m",
    "rolling_friction": "m",
    "friction_load": "N",
}
_OF_ARRAY = {
    "body_mass": "kg",
    "body_inertia": "kg m²",
    "body_ipos": "m",
    "body_pos": "m",
    "geom_pos": "m",
    "geom_size": "m",
    "geom_margin": "m",
    "geom_gap": "m",
    "site_pos": "m",
    "jnt_pos": "m",
}
# Where one number stands for a force on a slide and for a torque on a hinge.
_LINEAR = {
    "dof_damping": "N s/m",
    "dof_frictionloss": "N",
    "dof_armature": "kg",
    "jnt_stiffness": "N/m",
}
_ANGULAR = {
    "dof_damping": "N m s/rad",
    "dof_frictionloss": "N m",
    "dof_armature": "kg m²",
    "jnt_stiffness": "N m/rad",
}
_S = mujoco.mjtSensor
_OF_SENSOR = {
    _S.mjSENS_TOUCH: "N",
    _S.mjSENS_FORCE: "N",
    _S.mjSENS_TORQUE: "N m",
    _S.mjSENS_ACCELEROMETER: "m/s²",
    _S.mjSENS_FRAMELINACC: "m/s²",
    _S.mjSENS_FRAMEANGACC: "rad/s²",
    _S.mjSENS_VELOCIMETER: "m/s",
    _S.mjSENS_FRAMELINVEL: "m/s",
    _S.mjSENS_SUBTREELINVEL: "m/s",
    _S.mjSENS_TENDONVEL: "m/s",
    _S.mjSENS_GYRO: "rad/s",
    _S.mjSENS_FRAMEANGVEL: "rad/s",
    _S.mjSENS_BALLANGVEL: "rad/s",
    _S.mjSENS_RANGEFINDER: "m",
    _S.mjSENS_FRAMEPOS: "m",
    _S.mjSENS_SUBTREECOM: "m",
    _S.mjSENS_TENDONPOS: "m",
    _S.mjSENS_GEOMDIST: "m",
    _S.mjSENS_TENDONACTFRC: "N",
    _S.mjSENS_CLOCK: "s",
    _S.mjSENS_E_POTENTIAL: "J",
    _S.mjSENS_E_KINETIC: "J",
}
# Sensors of a joint: on a slide, on a hinge.
_OF_JOINT_SENSOR = {
    _S.mjSENS_JOINTPOS: ("m", "rad"),
    _S.mjSENS_JOINTVEL: ("m/s", "rad/s"),
    _S.mjSENS_JOINTACTFRC: ("N", "N m"),
}


def parameter_unit(parameter: Parameter, problem: Problem, model: mujoco.MjModel) -> str:
    """Return the unit of a parameter; empty where it has none, or none is known."""
    setter = parameter.apply
    if isinstance(setter, SensingSetter):
        seen = [v for t in problem.trajectories for v in t.views.values()]
        of_camera = [view for view in seen if view.camera == setter.channel]
        if of_camera and setter.quantity != "delay":
            plain = lens_of(of_camera[0], model).perspective
            return {"scale": "px" if plain else "px/m", "tilt": "rad"}.get(setter.quantity, "px")
        observed = any(setter.channel in t.sensors for t in problem.trajectories)
        if setter.quantity == "offset":
            return sensor_unit(model, setter.channel) if observed else ""
        return "s" if setter.quantity == "delay" else ""
    if isinstance(setter, MaterialSetter | PairSetter):
        return _OF_QUANTITY.get(setter.quantity, "")
    if isinstance(setter, Joint) and isinstance(setter.function, InertiaSetter):
        return UNITS.get(setter.function.labels[parameter.component or 0], "")
    if not isinstance(setter, ModelSetter):
        return ""
    name = setter.attribute
    if name in _LINEAR:
        joint = object_id(model, setter.elements[0], "joint", "elements")
        return (_LINEAR if _slides(model, joint) else _ANGULAR)[name]
    if name.endswith("_friction"):
        column = setter.columns[0] if setter.columns else 0
        return "m" if column else ""
    return _OF_ARRAY.get(name, "")


def sensor_unit(model: mujoco.MjModel, name: str) -> str:
    """Return the unit of a sensor; empty where none is known."""
    row = id_of_name(model, mujoco.mjtObj.mjOBJ_SENSOR, name)
    if row < 0:
        return "px"
    kind = _S(int(model.sensor_type[row]))
    if kind in _OF_JOINT_SENSOR:
        return _OF_JOINT_SENSOR[kind][0 if _slides(model, int(model.sensor_objid[row])) else 1]
    return _OF_SENSOR.get(kind, "")


def _slides(model: mujoco.MjModel, joint: int) -> bool:
    return bool(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE)
