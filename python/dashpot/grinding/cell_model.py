"""The MuJoCo model of a cell, and which of its numbers are what."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.grinding.tools import BODY, TIP
from dashpot.grinding.work import GEOM

if TYPE_CHECKING:
    from dashpot.grinding.cell import Cell

Array = NDArray[np.float64]
Pose = tuple[Array, Array]

_TOOL = "tool_"
SPINDLE = _TOOL + "spindle"
SITE = _TOOL + TIP
LOAD = "load"
_WIDE = 10.0  # m, of the zone in which contacts count for the load: all
REFERENCE, LED = "impedance_reference", "impedance_tip"
# A height field may have a contact with each of several facets under one ball.
_FACETS = 12
_FIELDS = ("FOUND", "FORCE", "POS", "NORMAL", "TANGENT", "LINVEL")
CONTACT_WIDTH = 1 + 5 * 3
"""Numbers of a contact in the sensors: found, force, position, normal, tangent, velocity."""


@dataclass(frozen=True, eq=False)
class CellModel:
    """A compiled cell.

    Attributes
    ----------
    model
        The model.
    joints
        Addresses of the arm's joints in ``qpos`` and ``qvel``.
    actuators
        Ids of the actuators that move the arm: of joints, or six of the tip under impedance.
    turning
        Ids of the two actuators that are the imbalance; empty without one.
    points
        Ids of the tool's geoms that touch.
    work
        Id of the geom that is ground.
    slots
        Contacts that the sensors of one point tell.
    """

    model: mujoco.MjModel
    joints: NDArray[np.intp]
    actuators: NDArray[np.intp]
    turning: NDArray[np.intp]
    points: tuple[int, ...]
    work: int
    slots: int

    @property
    def spindle(self) -> int | None:
        """Address of the spindle's joint, None without one."""
        joint = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, SPINDLE)
        return None if joint < 0 else int(self.model.jnt_qposadr[joint])

    @property
    def tip(self) -> int:
        """Id of the site at the tool's working end."""
        return int(self.model.site(SITE).id)

    @property
    def joint_names(self) -> list[str]:
        """Names of the arm's joints."""
        return [self.model.joint(int(j)).name or f"joint {j}" for j in self.joints]


def build(cell: Cell, *, visual: bool = False) -> CellModel:
    """Return the compiled model of a cell; ValueError names what its files lack.

    Without `visual` the arm has no shapes: nothing touches them, and models are copied often.
    """
    name = os.fspath(cell.arm.file)
    spec = mujoco.MjSpec.from_file(name)
    sites = {site.name: site for site in spec.sites}
    if cell.arm.flange not in sites:
        raise ValueError(
            f"arm {name!r} has no site {cell.arm.flange!r} for its flange; it has {sorted(sites)}"
        )
    for key in list(spec.keys):
        spec.delete(key)
    if not visual:
        _strip(spec)
    arm_joints = [joint.name for joint in spec.joints]
    if "" in arm_joints:
        raise ValueError(f"arm {name!r} has joints without names")
    _add_tool(cell, spec, sites[cell.arm.flange])
    cell.part.add_to(spec)
    _control(cell, spec, arm_joints, sites[cell.arm.flange])
    turning = _add_imbalance(cell, spec)
    slots = _FACETS if cell.part.kind in ("height_field", "mesh", "mjcf") else 1
    points = [geom.name for geom in spec.geoms if geom.name.startswith(_TOOL + "point")]
    for geom in spec.geoms:
        if geom.name in points:
            geom.contype, geom.conaffinity = 1, 0
        elif geom.name == GEOM:
            geom.contype, geom.conaffinity = 0, 1
        else:
            geom.contype = geom.conaffinity = 0
    _add_sensors(spec, points, slots)
    spec.option.timestep = cell.timestep
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{cell.integrator.upper()}")
    model = spec.compile()
    return _described(cell, model, arm_joints, points, turning, slots)


def _strip(spec: mujoco.MjSpec) -> None:
    """Delete shapes that no inertia comes from, and the meshes that they leave unused."""
    for body in spec.bodies:
        if body.explicitinertial or body.name == "world":
            for geom in list(body.geoms):
                spec.delete(geom)
    used = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        # A mesh without a name is called after its file.
        if not used & {mesh.name, mesh.file, mesh.file.rsplit(".", 1)[0]}:
            spec.delete(mesh)


def _described(
    cell: Cell,
    model: mujoco.MjModel,
    arm_joints: list[str],
    points: list[str],
    turning: list[str],
    slots: int,
) -> CellModel:
    name = os.fspath(cell.arm.file)
    joints = [model.joint(joint) for joint in arm_joints]
    linear = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    for joint in joints:
        if mujoco.mjtJoint(int(joint.type[0])) not in linear:
            raise ValueError(f"arm {name!r}: joint {joint.name!r} is neither a hinge nor a slide")
    ids = [model.actuator(i).id for i in range(model.nu - len(turning))]
    if cell.control.kind != "impedance":
        moved = [int(model.actuator_trnid[i, 0]) for i in ids]
        wanted = [joint.id for joint in joints]
        kinds = model.actuator_trntype[ids] == int(mujoco.mjtTrn.mjTRN_JOINT)
        if sorted(moved) != sorted(wanted) or not kinds.all():
            raise ValueError(
                f"arm {name!r}: position control needs one actuator for each of its joints; "
                "give Control a stiffness and a damping to have servos of its own"
            )
        ids = [ids[moved.index(joint)] for joint in wanted]
        if not (model.actuator_biasprm[ids, 1] < 0).all():
            raise ValueError(
                f"arm {name!r}: its actuators are no position servos; give Control a stiffness "
                "and a damping"
            )
    return CellModel(
        model,
        np.array([int(joint.qposadr[0]) for joint in joints], dtype=np.intp),
        np.array(ids, dtype=np.intp),
        np.array([model.actuator(each).id for each in turning], dtype=np.intp),
        tuple(int(model.geom(point).id) for point in points),
        int(model.geom(GEOM).id),
        slots,
    )


def _add_tool(cell: Cell, spec: mujoco.MjSpec, flange: Any) -> None:
    tool = cell.tool.spec()
    body = tool.body(BODY)
    if cell.spindle is not None:
        body.add_joint(
            name="spindle",
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=[0, 0, 1],
            stiffness=cell.spindle.stiffness,
            damping=cell.spindle.damping,
            range=[-cell.spindle.travel, cell.spindle.travel],
            limited=True,
        )
    spec.attach(tool, prefix=_TOOL, site=flange)


def _control(cell: Cell, spec: mujoco.MjSpec, joints: list[str], flange: Any) -> None:
    """Put the actuators of the chosen control in the place of the arm's, where it has its own."""
    control = cell.control
    own = control.kind != "impedance" and control.stiffness is None
    if own:
        return
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    servo = {
        "gaintype": mujoco.mjtGain.mjGAIN_FIXED,
        "biastype": mujoco.mjtBias.mjBIAS_AFFINE,
    }
    if control.kind != "impedance":
        assert control.stiffness is not None
        assert control.damping is not None
        for joint in joints:
            spec.add_actuator(
                name=f"servo_{joint}",
                trntype=mujoco.mjtTrn.mjTRN_JOINT,
                target=joint,
                gainprm=_ten(control.stiffness),
                biasprm=_ten(0, -control.stiffness, -control.damping),
                **servo,
            )
        return
    # Springs between the tip and a site in the world, one per direction of motion. The site is
    # turned as the tip is at home, far from half a turn, where rotation vectors jump.
    # They pull where the tip is while a compliant spindle is at rest.
    pose, local = _tip_at_home(cell, spec, joints)
    spec.worldbody.add_site(name=REFERENCE, pos=pose[0], quat=pose[1])
    flange.parent.add_site(name=LED, pos=local[0], quat=local[1])
    for body in spec.bodies[1:]:
        body.gravcomp = 1
    for axis in range(6):
        linear = axis < 3
        stiff = control.linear_stiffness if linear else control.angular_stiffness
        damped = control.linear_damping if linear else control.angular_damping
        spec.add_actuator(
            name=f"impedance{axis}",
            trntype=mujoco.mjtTrn.mjTRN_SITE,
            target=LED,
            refsite=REFERENCE,
            gear=[float(i == axis) for i in range(6)],
            gainprm=_ten(stiff),
            biasprm=_ten(0, -stiff, -damped),
            **servo,
        )


def _tip_at_home(cell: Cell, spec: mujoco.MjSpec, joints: list[str]) -> tuple[Pose, Pose]:
    """Return the pose of the tip at home, in the world and in the body that has the flange."""
    model = spec.compile()
    data = mujoco.MjData(model)
    if cell.arm.home is not None:
        data.qpos[[int(model.joint(joint).qposadr[0]) for joint in joints]] = cell.arm.home
    mujoco.mj_kinematics(model, data)
    tip, body = data.site(SITE), int(model.site(cell.arm.flange).bodyid[0])
    world, turn, inverse, local = (np.zeros(4) for _ in range(4))
    mujoco.mju_mat2Quat(world, tip.xmat)
    mujoco.mju_mat2Quat(turn, data.xmat[body])
    mujoco.mju_negQuat(inverse, turn)
    mujoco.mju_mulQuat(local, inverse, world)
    place = data.xmat[body].reshape(3, 3).T @ (tip.xpos - data.xpos[body])
    return (np.array(tip.xpos), world), (np.asarray(place), local)


def _add_imbalance(cell: Cell, spec: mujoco.MjSpec) -> list[str]:
    if cell.imbalance is None:
        return []
    names = [_TOOL + "imbalance_x", _TOOL + "imbalance_y"]
    for axis, name in enumerate(names):
        spec.add_actuator(
            name=name,
            trntype=mujoco.mjtTrn.mjTRN_SITE,
            target=SITE,
            gear=[float(i == axis) for i in range(6)],
            gaintype=mujoco.mjtGain.mjGAIN_FIXED,
            gainprm=_ten(1.0),
            biastype=mujoco.mjtBias.mjBIAS_NONE,
        )
    return names


def _add_sensors(spec: mujoco.MjSpec, points: list[str], slots: int) -> None:
    kinds = mujoco.mjtConDataField.__members__
    bits = sum(1 << int(kinds[f"mjCONDATA_{field}"]) for field in _FIELDS)
    strongest = 2
    for point in points:
        spec.add_sensor(
            name=f"contact_{point}",
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=mujoco.mjtObj.mjOBJ_GEOM,
            objname=GEOM,
            reftype=mujoco.mjtObj.mjOBJ_GEOM,
            refname=point,
            intprm=[bits, strongest, slots],
        )
    for name, kind in (
        ("tip", mujoco.mjtSensor.mjSENS_FRAMEPOS),
        ("axis", mujoco.mjtSensor.mjSENS_FRAMEZAXIS),
    ):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=SITE)
    # What a load cell under the tool reads: the normal force of all its points.
    body = spec.body(_TOOL + BODY)
    body.add_site(name=LOAD, size=[_WIDE, 0, 0], rgba=[0, 0, 0, 0], group=5)
    spec.add_sensor(
        name=LOAD,
        type=mujoco.mjtSensor.mjSENS_TOUCH,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=LOAD,
    )


def _ten(*numbers: float) -> list[float]:
    return [*map(float, numbers), *([0.0] * (10 - len(numbers)))]
