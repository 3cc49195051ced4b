"""The step: half a drift, MuJoCo Warp's stages, the law, and the other half."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import mujoco_warp as mjw
import warp as wp
from mujoco_warp._src import derivative, sensor, smooth
from mujoco_warp._src.forward import _advance, _energy_pos, _energy_vel
from mujoco_warp._src.types import DisableBit, IntegratorType

from dashpot.warp import comfree, drift, inertia, memory, plan, reach, recall, rows
from dashpot.warp.data import Data
from dashpot.warp.microsteps import microstep_kernel
from dashpot.warp.model import Model
from dashpot.warp.report import report_forces

__all__ = ["forward", "rollout", "step"]

HALF = 0.5
ROUNDS = 4  # of the coupling bound


def step(m: Model, d: Data) -> None:
    """Advance all worlds by one time step.

    What MuJoCo Warp's stages leave in `d`, positions of bodies and geoms, contacts, sensors, is
    that of the middle of the step; ``qpos``, ``qvel`` and ``time`` are those of its end. With
    ``law="comfree"`` it is that of the start, as in MuJoCo. Nothing is read back by the host, so
    that a step can be captured as a graph.

    Examples
    --------
    >>> with wp.ScopedCapture() as capture:
    ...     dw.step(m, d)
    >>> for _ in range(1000):
    ...     wp.capture_launch(capture.graph)
    """
    if m.dashpot.law == "comfree":
        _find_edits(m, d)
        _solve_complementarity_free(m, d)
        _advance_semi_implicit(m, d)
        _remember_state(m, d)
        return
    _find_edits(m, d)
    _drift_to_middle(m, d)
    _solve(m, d, HALF)
    _drift_to_end(m, d)
    _remember(m, d)
    _remember_state(m, d)


def forward(m: Model, d: Data) -> None:
    """Find forces, accelerations and sensors at the present state, and change nothing of it.

    Forces and accelerations are the means over the step to come.
    """
    if m.dashpot.law == "comfree":
        _solve_complementarity_free(m, d)
        return
    _find_edits(m, d)
    _solve(m, d, 0.0)


def rollout(
    m: Model, d: Data, nstep: int, *, ctrl: wp.array | None = None
) -> tuple[wp.array, wp.array]:
    """Take `nstep` steps of all worlds, as one graph that is launched again and again.

    Parameters
    ----------
    m, d
        Model and data; `d` has the last state afterwards.
    nstep
        Number of steps, >= 1.
    ctrl
        (nstep, nworld, nu) float controls, held over a step each; without them those in `d` stay.

    Returns
    -------
    qpos, qvel
        (nstep, nworld, nq) and (nstep, nworld, nv) states at the ends of the steps, on the device.
    """
    if nstep < 1:
        raise ValueError(f"nstep must be >= 1, got {nstep}")
    if ctrl is not None and tuple(ctrl.shape) != (nstep, d.nworld, m.nu):
        raise ValueError(
            f"ctrl must have shape (nstep, nworld, nu) = {(nstep, d.nworld, m.nu)}, "
            f"got {tuple(ctrl.shape)}"
        )
    qpos = wp.empty((nstep, d.nworld, m.nq), dtype=wp.float32, device=d.qpos.device)
    qvel = wp.empty((nstep, d.nworld, m.nv), dtype=wp.float32, device=d.qpos.device)
    with wp.ScopedCapture(device=d.qpos.device) as capture:
        step(m, d)
    for i in range(nstep):
        if ctrl is not None:
            wp.copy(d.ctrl, ctrl[i])
        wp.capture_launch(capture.graph)
        wp.copy(qpos[i], d.qpos)
        wp.copy(qvel[i], d.qvel)
    return qpos, qvel


def _solve(m: Model, d: Data, ahead: float) -> None:
    """All stages at the positions in `d`, which are those after `ahead` of a step."""
    wp.copy(d.dashpot.middle, d.qpos)
    _find_geometry(m, d, ahead)
    _find_smooth_motion(m, d)
    _find_rows(m, d, ahead)
    _couple(m, d)
    _plan_and_recall(m, d, ahead)
    _run_microsteps(m, d)
    _respond(m, d)
    _finish_stages(m, d)


def _solve_complementarity_free(m: Model, d: Data) -> None:
    """Take the stages of `law="comfree"`, at the start of the step, with the model's margins."""
    own, law = m.dashpot, d.dashpot
    _find_geometry(m, d, 0.0)
    _find_smooth_motion(m, d)
    _find_rows(m, d, 0.0)
    if own.constraint_rows:
        trees = [m.tree_dofadr, m.tree_dofnum, own.tree_factor]
        inputs = [own.dims, *trees, law.rows, law.work]
        wp.launch(comfree.add_magnitudes, dim=(d.nworld, m.ntree), inputs=inputs)
    inputs = [
        own.dims,
        m.nv,
        m.opt.timestep,
        own.comfree_stiffness,
        own.comfree_damping,
        d.contact.efc_address,
        d.efc.D,
        law.rows,
        law.work,
    ]
    wp.launch(comfree.push_apart, dim=(d.nworld, law.groups), inputs=inputs)
    _respond(m, d)
    _finish_stages(m, d)


@contextmanager
def _blocks() -> Iterator[None]:
    """Launch with real blocks on the CPU device too."""
    before = wp.config.enable_cpu_blocks
    wp.config.enable_cpu_blocks = True
    try:
        yield
    finally:
        wp.config.enable_cpu_blocks = before


def _find_edits(m: Model, d: Data) -> None:
    law = d.dashpot
    law.work.edited.zero_()
    wp.launch(
        memory.find_edits,
        dim=(d.nworld, m.njnt),
        inputs=[
            m.nq,
            m.jnt_type,
            m.jnt_qposadr,
            m.jnt_dofadr,
            m.dashpot.dof_tree,
            d.qpos,
            d.qvel,
            law.memory,
            law.work,
        ],
    )


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


def _drift_to_middle(m: Model, d: Data) -> None:
    inputs = [*_bodies(m), HALF, d.qpos, d.qvel, d.dashpot.memory.rest]
    wp.launch(drift.drift_to_middle, dim=(d.nworld, m.njnt), inputs=inputs)


def _find_geometry(m: Model, d: Data, ahead: float) -> None:
    """Kinematics, inertia, contacts within reach and their rows."""
    law, own = d.dashpot, m.dashpot
    mjw.fwd_kinematics(m, d)
    mjw.com_vel(m, d)
    twists = [m.body_rootid, d.xpos, d.subtree_com, d.cvel, law.work]
    wp.launch(reach.find_twists, dim=(d.nworld, m.nbody), inputs=twists)
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


def _find_smooth_motion(m: Model, d: Data) -> None:
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
            m.opt.timestep,
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


def _find_rows(m: Model, d: Data, ahead: float) -> None:
    law, own = d.dashpot, m.dashpot
    state, work = law.rows, law.work
    state.count.zero_()
    efc, contact = d.efc, d.contact
    wp.launch(
        rows.collect_constraints,
        dim=(d.nworld, own.constraint_rows),
        inputs=[d.ne, d.nf, d.nl, state, work],
    )
    wp.launch(
        rows.collect_contacts,
        dim=d.naconmax,
        inputs=[d.nacon, contact.worldid, contact.efc_address, state, work],
    )
    wp.launch(
        rows.sort_groups,
        dim=(d.nworld, law.groups),
        inputs=[contact.geom, contact.geomcollisionid, efc.type, efc.id, state],
    )
    wp.launch(rows.clip_counts, dim=d.nworld, inputs=[state])
    wp.launch(
        rows.prepare_rows,
        dim=(d.nworld, law.groups),
        inputs=[
            own.dims,
            m.nv,
            m.ntree,
            ahead,
            m.is_sparse,
            m.opt.timestep,
            m.tree_dofadr,
            m.tree_dofnum,
            own.tree_factor,
            contact.dist,
            law.contact_margin,
            contact.dim,
            contact.friction,
            contact.efc_address,
            efc.type,
            efc.pos,
            efc.margin,
            efc.frictionloss,
            efc.J,
            efc.J_rownnz,
            efc.J_rowadr,
            efc.J_colind,
            state,
            work,
        ],
    )


def _advance_semi_implicit(m: Model, d: Data) -> None:
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


def _couple(m: Model, d: Data) -> None:
    law, own = d.dashpot, m.dashpot
    wp.launch(
        rows.couple, dim=(d.nworld, law.groups, law.groups), inputs=[own.dims, m.nv, law.rows]
    )


def _plan_and_recall(m: Model, d: Data, ahead: float) -> None:
    law, own = d.dashpot, m.dashpot
    state, remembered, work = law.rows, law.memory, law.work
    groups = (d.nworld, law.groups)
    near = [own.geom_tree, d.geom_xpos, d.geom_xmat, d.contact.pos, state, remembered, work]
    wp.launch(memory.find_nearest, dim=groups, inputs=near)
    wp.launch(memory.settle_contests, dim=groups, inputs=[state])
    wp.launch(memory.choose_again, dim=d.nworld, inputs=[state, remembered])
    wp.launch(plan.find_touching, dim=groups, inputs=[m.opt.timestep, m.geom_bodyid, state])
    wp.launch(plan.admit_reached, dim=d.nworld, inputs=[m.opt.timestep, state])
    before = -1
    for _ in range(ROUNDS):
        wp.launch(plan.bound_round, dim=groups, inputs=[own.dims, before, state, work])
        before = 1 if before == 0 else 0
    wp.launch(plan.bound_end, dim=(d.nworld, 3), inputs=[own.dims, 1 - before, state, work])
    pair = law.pair(m, d)
    wp.launch(
        plan.fill_rows,
        dim=groups,
        inputs=[
            own.dims,
            own.microsteps,
            m.opt.timestep,
            own.recovery_speed,
            m.geom_rbound,
            pair,
            d.contact.pos,
            state,
            work,
        ],
    )
    wp.launch(
        recall.recall,
        dim=groups,
        inputs=[
            own.dims,
            ahead,
            m.opt.timestep,
            own.recovery_speed,
            own.geom_tree,
            m.geom_rbound,
            m.geom_bodyid,
            d.geom_xpos,
            d.geom_xmat,
            work.twist,
            d.xpos,
            d.contact.pos,
            d.contact.frame,
            state,
            remembered,
            work,
        ],
    )


def _run_microsteps(m: Model, d: Data) -> None:
    law, own = d.dashpot, m.dashpot
    with _blocks():
        wp.launch_tiled(
            microstep_kernel(own.dims),
            dim=[d.nworld],
            inputs=[own.microsteps, m.opt.timestep, own.recovery_speed, law.rows],
            block_dim=law.block,
        )


def _respond(m: Model, d: Data) -> None:
    law, own = d.dashpot, m.dashpot
    wp.launch(
        inertia.respond,
        dim=(d.nworld, m.ntree),
        inputs=[
            own.dims,
            m.opt.timestep,
            m.tree_dofadr,
            m.tree_dofnum,
            own.tree_factor,
            law.rows,
            law.work,
        ],
        outputs=[d.qacc, d.qfrc_constraint],
    )
    d.efc.force.zero_()
    wp.launch(
        report_forces,
        dim=(d.nworld, law.groups),
        inputs=[m.opt.timestep, d.contact.efc_address, law.rows],
        outputs=[d.efc.force],
    )


def _finish_stages(m: Model, d: Data) -> None:
    sensors = not m.opt.disableflags & DisableBit.SENSOR
    if m.opt.run_rne_postconstraint or (sensors and m.sensor_rne_postconstraint):
        mjw.rne_postconstraint(m, d)
    sensor.sensor_acc(m, d, skip_rne_postconstraint=True)


def _drift_to_end(m: Model, d: Data) -> None:
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


def _remember(m: Model, d: Data) -> None:
    law, own = d.dashpot, m.dashpot
    wp.launch(
        memory.remember,
        dim=(d.nworld, law.groups),
        inputs=[
            own.dims,
            m.nv,
            m.nq,
            d.geom_xmat,
            d.contact.pos,
            d.contact.frame,
            law.rows,
            law.memory,
            law.work,
        ],
    )


def _remember_state(m: Model, d: Data) -> None:
    law = d.dashpot
    wp.launch(
        memory.remember_state,
        dim=(d.nworld, max(m.nq, m.nv)),
        inputs=[m.nq, m.nv, d.qpos, d.qvel, d.overflow, law.memory, law.work],
    )
