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
    inputs = [m.opt.timestep, ahead, own.mocap_timeconst, own.eq_mocap, d.eq_active]
    inputs += [d.mocap_pos, d.mocap_quat, law.memory]
    outputs = [law.mocap_told, law.mocap_behind, law.mocap_motion]
    wp.launch(mocap.move_to_middle, dim=(d.nworld, own.nmocap), inputs=inputs, outputs=outputs)


def leave_mocap_bodies(m: Model, d: Data, memory: object) -> None:
    """Put mocap bodies back to where users have them; `memory` keeps that."""
    law = d.dashpot
    inputs = [law.mocap_told, law.mocap_behind, d.mocap_pos, d.mocap_quat, memory]
    wp.launch(mocap.put_where_told, dim=(d.nworld, m.dashpot.nmocap), inputs=inputs)


def find_geometry(m: Model, d: Data, ahead: float) -> None:
    """Kinematics, inertia and contacts within reach."""
    law, own = d.dashpot, m.dashpot
    mjw.fwd_kinematics(m, d)
    mjw.com_vel(m, d)
    twists = [m.body_rootid, d.xpos, d.subtree_com, d.cvel, law.work]
    wp.launch(reach.find_twists, dim=(d.nworld, m.nbody), inputs=twists)
    mjw.crb(m, d)
    smooth.tendon_armature(m, d)
    mjw.factor_m(m, d)
    if own.nmocap and own.law != "comfree":
        inputs = [own.body_mocap, own.mocap_body, d.xpos, law.mocap_motion, law.work]
        wp.launch(mocap.give_twists, dim=(d.nworld, m.nbody), inputs=inputs)
    if m.opt.run_collision_detection:
        _find_contacts(m, d)
    mjw.transmission(m, d)


def _find_contacts(m: Model, d: Data) -> None:
    """Ask collision with margins of what comes near in the step, and keep the model's own."""
    law, own = d.dashpot, m.dashpot
    npair = own.explicit_pairs.shape[0]
    if own.law != "comfree":
        geoms, every = [m.geom_bodyid, m.geom_rbound, d.geom_xpos], (d.nworld, m.ngeom)
        speeds = [law.geom_speed, law.work]
        wp.launch(reach.find_speeds, dim=every, inputs=[*geoms, d.xpos, law.work, law.geom_speed])
        wp.launch(reach.find_blows, dim=every, inputs=[m.opt.timestep, *geoms, *speeds])
        wp.launch(
            reach.widen_geoms,
            dim=every,
            inputs=[m.opt.timestep, m.opt.gravity, m.geom_bodyid, own.geom_margin, *speeds],
            outputs=[law.geom_margin],
        )
        wp.launch(
            reach.widen_pairs,
            dim=(d.nworld, npair),
            inputs=[own.explicit_pairs, own.pair_margin, own.geom_margin, law.geom_margin],
            outputs=[law.pair_margin],
        )
        m.geom_margin = law.geom_margin
        if npair:
            m.pair_margin = law.pair_margin
    mjw.collision(m, d)
    m.geom_margin, m.pair_margin = own.geom_margin, own.pair_margin
    margins = [own.explicit_pairs, own.pair_margin, own.geom_margin]
    wp.launch(
        reach.own_margins,
        dim=d.naconmax,
        inputs=[d.nacon, *margins, d.contact.worldid, d.contact.geom],
        outputs=[law.contact_margin],
    )


def find_constraints(m: Model, d: Data) -> None:
    """MuJoCo Warp's rows, of limits that come near too; sensors of positions and velocities."""
    law, own = d.dashpot, m.dashpot
    widened = bool(own.limits) and own.law != "comfree"
    if widened:
        wp.launch(
            reach.widen_joints,
            dim=(d.nworld, m.njnt),
            inputs=[
                m.opt.timestep,
                m.jnt_type,
                m.jnt_dofadr,
                own.jnt_margin,
                d.qvel,
                law.work,
            ],
            outputs=[law.jnt_margin],
        )
        wp.launch(
            reach.widen_tendons,
            dim=(d.nworld, m.ntendon),
            inputs=[
                m.opt.timestep,
                m.ten_J_rownnz,
                m.ten_J_rowadr,
                m.ten_J_colind,
                d.ten_J,
                own.tendon_margin,
                d.qvel,
                law.work,
            ],
            outputs=[law.tendon_margin],
        )
        m.jnt_margin, m.tendon_margin = law.jnt_margin, law.tendon_margin
    mjw.make_constraint(m, d)
    m.jnt_margin, m.tendon_margin = own.jnt_margin, own.tendon_margin
    if widened:
        wp.launch(
            reach.own_limit_margins,
            dim=(d.nworld, own.limits),
            inputs=[
                d.ne,
                d.nf,
                d.nl,
                d.efc.type,
                d.efc.id,
                own.jnt_margin,
                own.tendon_margin,
                d.efc.margin,
            ],
        )
    _sense(m, d)


def _sense(m: Model, d: Data) -> None:
    """Sensors and energies of positions and velocities."""
    d.sensordata.zero_()
    mjw.sensor_pos(m, d)
    _energy_pos(m, d)
    mjw.sensor_vel(m, d)
    _energy_vel(m, d)


def find_smooth_motion(m: Model, d: Data) -> None:
    """Smooth forces and accelerations, with H = M + T D."""
    work, own = d.dashpot.work, m.dashpot
    mjw.fwd_velocity(m, d)
    if not m.opt.disableflags & DisableBit.ACTUATION and m.callback.control:
        _sense(m, d)
        m.callback.control(m, d)
    mjw.fwd_actuation(m, d)
    mjw.fwd_acceleration(m, d)
    wp.copy(work.start, d.qvel)
    wp.copy(work.force, d.qfrc_smooth)
    is_fitted = own.law != "comfree"
    if m.opt.integrator == IntegratorType.IMPLICITFAST:
        derivative.deriv_smooth_vel(m, d, work.H)
    else:
        dampers = not m.opt.disableflags & (DisableBit.DAMPER | DisableBit.EULERDAMP)
        wp.launch(
            inertia.add_dampers,
            dim=(d.nworld, m.nv),
            inputs=[
                m.opt.timestep,
                m.M_rownnz,
                m.M_rowadr,
                m.dof_damping,
                m.dof_dampingpoly,
                int(dampers),
                d.M,
                d.qvel,
            ],
            outputs=[work.H],
        )
    if is_fitted:
        has_gravity = int(not m.opt.disableflags & DisableBit.GRAVITY)
        wp.launch(
            inertia.free_forces,
            dim=(d.nworld, m.body_freeadr.size),
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
    trees = [m.tree_dofadr, m.tree_dofnum, own.tree_factor]
    inertias = [m.M_rownnz, m.M_rowadr, m.M_colind, d.M, m.dof_invweight0, work]
    wp.launch(inertia.factor, dim=(d.nworld, m.ntree), inputs=[is_fitted, *trees, *inertias])
    wp.launch(inertia.solve_smooth, dim=(d.nworld, m.ntree), inputs=[*trees, work])
    if own.has_joints and is_fitted:
        _take_bias_of_middle(m, d)
        wp.launch(inertia.solve_smooth, dim=(d.nworld, m.ntree), inputs=[*trees, work])


def _take_bias_of_middle(m: Model, d: Data) -> None:
    """Of trees of joints, Coriolis forces at the velocity that smooth forces lead to half way."""
    law, work = d.dashpot, d.dashpot.work
    wp.copy(law.bias, d.qfrc_bias)
    wp.launch(
        inertia.advance_velocity,
        dim=(d.nworld, m.nv),
        inputs=[m.opt.timestep, HALF, work.start, work.a],
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
