"""MuJoCo Warp's stages about the law: drifts, geometry, smooth motion, sensors."""

from __future__ import annotations

from typing import Any

import mujoco_warp as mjw
import warp as wp
from mujoco_warp._src import derivative, sensor, smooth
from mujoco_warp._src.forward import _advance, _energy_pos, _energy_vel
from mujoco_warp._src.types import DisableBit, IntegratorType

from dashpot.warp import comfree, drift, inertia, mocap, reach
from dashpot.warp.data import Data
from dashpot.warp.model import Model

HALF = 0.5


def _bodies(m: Model) -> list[Any]:
    """Joints and what turns free bodies, as the drift takes them."""
    return [
        m.opt.timestep,
        m.jnt_type,
        m.jnt_qposadr,
        m.jnt_dofadr,
        m.dashpot.jnt_bodyid,
        m.dashpot.body_is_free,
        m.body_ipos,
        m.body_iquat,
        m.body_inertia,
    ]


def drift_to_middle(m: Model, d: Data) -> None:
    """Move joints on by half a step."""
    inputs = [*_bodies(m), HALF, d.qpos, d.qvel, d.dashpot.memory.rest]
    wp.launch(drift.drift_to_middle, dim=(d.nworld, m.njnt), inputs=inputs)


def move_mocap_bodies(m: Model, d: Data, ahead: float) -> None:
    """Take mocap bodies to where they are after `ahead` of the step."""
    own, law = m.dashpot, d.dashpot
    inputs = [m.opt.timestep, ahead, d.mocap_pos, d.mocap_quat, law.memory]
    outputs = [law.mocap_told, law.mocap_motion]
    wp.launch(mocap.move_to_middle, dim=(d.nworld, own.nmocap), inputs=inputs, outputs=outputs)


def leave_mocap_bodies(m: Model, d: Data, memory: object) -> None:
    """Put mocap bodies back to where users have them; `memory` keeps that."""
    inputs = [d.dashpot.mocap_told, d.mocap_pos, d.mocap_quat, memory]
    wp.launch(mocap.put_where_told, dim=(d.nworld, m.dashpot.nmocap), inputs=inputs)


def find_geometry(m: Model, d: Data, ahead: float) -> None:
    """Kinematics, inertia, contacts within reach and their rows."""
    law, own = d.dashpot, m.dashpot
    mjw.fwd_kinematics(m, d)
    mjw.com_vel(m, d)
    twists = [m.body_rootid, d.xpos, d.subtree_com, d.cvel, law.work]
    wp.launch(reach.find_twists, dim=(d.nworld, m.nbody), inputs=twists)
    if own.nmocap and own.law != "comfree":
        inputs = [own.body_mocap, own.mocap_body, d.xpos, law.mocap_motion, law.work]
        wp.launch(mocap.give_twists, dim=(d.nworld, m.nbody), inputs=inputs)
    inputs = [
        m.opt.timestep,
        m.opt.gravity,
        m.geom_bodyid,
        m.geom_rbound,
        d.geom_xpos,
        d.xpos,
        own.geom_margin,
        law.work,
    ]
    wp.launch(reach.widen_geoms, dim=(d.nworld, m.ngeom), inputs=inputs, outputs=[law.geom_margin])
    npair = own.explicit_pairs.shape[0]
    wp.launch(
        reach.widen_pairs,
        dim=(d.nworld, npair),
        inputs=[own.explicit_pairs, own.pair_margin, own.geom_margin, law.geom_margin],
        outputs=[law.pair_margin],
    )
    mjw.crb(m, d)
    smooth.tendon_armature(m, d)
    mjw.factor_m(m, d)
    if own.law != "comfree":
        m.geom_margin = law.geom_margin
        if npair:
            m.pair_margin = law.pair_margin
    if m.opt.run_collision_detection:
        mjw.collision(m, d)
    mjw.make_constraint(m, d)
    m.geom_margin, m.pair_margin = own.geom_margin, own.pair_margin
    mjw.transmission(m, d)
    wp.launch(
        reach.own_margins,
        dim=d.naconmax,
        inputs=[
            d.nacon,
            own.explicit_pairs,
            own.pair_margin,
            own.geom_margin,
            d.contact.worldid,
            d.contact.geom,
        ],
        outputs=[law.contact_margin],
    )
    d.sensordata.zero_()
    mjw.sensor_pos(m, d)
    _energy_pos(m, d)


def find_smooth_motion(m: Model, d: Data) -> None:
    """Smooth forces and accelerations, with H = M + T D."""
    work, own = d.dashpot.work, m.dashpot
    mjw.fwd_velocity(m, d)
    mjw.sensor_vel(m, d)
    _energy_vel(m, d)
    if not m.opt.disableflags & DisableBit.ACTUATION and m.callback.control:
        m.callback.control(m, d)
    mjw.fwd_actuation(m, d)
    mjw.fwd_acceleration(m, d)
    wp.copy(work.start, d.qvel)
    wp.copy(work.force, d.qfrc_smooth)
    if own.has_joints and own.law != "comfree":
        _take_bias_of_middle(m, d)
    dampers = not m.opt.disableflags & DisableBit.DAMPER
    if m.opt.integrator == IntegratorType.IMPLICITFAST:
        derivative.deriv_smooth_vel(m, d, work.H)
    else:
        implicit = int(dampers and not m.opt.disableflags & DisableBit.EULERDAMP)
        wp.launch(
            inertia.add_dampers,
            dim=(d.nworld, m.nv),
            inputs=[
                m.opt.timestep,
                m.M_rownnz,
                m.M_rowadr,
                m.dof_damping,
                m.dof_dampingpoly,
                implicit,
                d.M,
                d.qvel,
            ],
            outputs=[work.H],
        )
    has_gravity = int(not m.opt.disableflags & DisableBit.GRAVITY)
    flown = m.body_freeadr.size if own.law != "comfree" else 0
    wp.launch(
        inertia.free_forces,
        dim=(d.nworld, flown),
        inputs=[
            m.opt.gravity,
            has_gravity,
            m.body_freeadr,
            m.body_dofadr,
            m.body_mass,
            d.xpos,
            d.xmat,
            d.xipos,
            d.qfrc_bias,
        ],
        outputs=[work.force],
    )
    wp.launch(
        inertia.factor_and_solve,
        dim=(d.nworld, m.ntree),
        inputs=[
            m.tree_dofadr,
            m.tree_dofnum,
            own.tree_factor,
            m.M_rownnz,
            m.M_rowadr,
            m.M_colind,
            work,
        ],
    )


def _take_bias_of_middle(m: Model, d: Data) -> None:
    """Of trees of joints, Coriolis forces at the velocity that smooth forces lead to half way."""
    law, work = d.dashpot, d.dashpot.work
    wp.copy(law.bias, d.qfrc_bias)
    wp.launch(
        inertia.advance_velocity,
        dim=(d.nworld, m.nv),
        inputs=[m.opt.timestep, HALF, work.start, d.qacc_smooth],
        outputs=[d.qvel],
    )
    mjw.com_vel(m, d)
    mjw.rne(m, d)
    smooth.tendon_bias(m, d, d.qfrc_bias)
    wp.launch(
        inertia.exchange_bias,
        dim=(d.nworld, m.nv),
        inputs=[law.bias, d.qfrc_bias],
        outputs=[work.force],
    )
    wp.copy(d.qvel, work.start)
    mjw.com_vel(m, d)


def finish_stages(m: Model, d: Data) -> None:
    """Find what needs accelerations: sensors, internal forces."""
    sensors = not m.opt.disableflags & DisableBit.SENSOR
    if m.opt.run_rne_postconstraint or (sensors and m.sensor_rne_postconstraint):
        mjw.rne_postconstraint(m, d)
    sensor.sensor_acc(m, d, skip_rne_postconstraint=True)


def drift_to_end(m: Model, d: Data) -> None:
    """Activations, history and time are MuJoCo Warp's to advance; positions are ours."""
    law, work = d.dashpot, d.dashpot.work
    _advance(m, d, d.qacc)
    inputs = [
        *_bodies(m),
        work.start,
        work.displacement,
        work.end,
        law.middle,
        law.memory.rest,
        d.qpos,
        d.qvel,
    ]
    wp.launch(drift.drift_to_end, dim=(d.nworld, m.njnt), inputs=inputs)


def advance_semi_implicit(m: Model, d: Data) -> None:
    """Positions go on by the new velocity, but keep the rest that they lose to rounding."""
    law, work = d.dashpot, d.dashpot.work
    wp.copy(law.middle, d.qpos)
    _advance(m, d, d.qacc)
    wp.launch(
        comfree.way_of_step,
        dim=(d.nworld, m.nv),
        inputs=[m.opt.timestep, work],
    )
    wp.launch(
        drift.drift_to_end,
        dim=(d.nworld, m.njnt),
        inputs=[
            *_bodies(m)[:5],
            law.no_body,
            *_bodies(m)[6:],
            work.start,
            work.displacement,
            work.end,
            law.middle,
            law.memory.rest,
            d.qpos,
            d.qvel,
        ],
    )
