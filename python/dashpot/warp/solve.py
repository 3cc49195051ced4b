"""The law's own launches: rows, their plan, micro-steps, response and memory."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import warp as wp

from dashpot.warp import inertia, memory, mocap, plan, recall, rows
from dashpot.warp.data import Data
from dashpot.warp.microsteps import microstep_kernel
from dashpot.warp.model import Model
from dashpot.warp.report import report_forces

ROUNDS = 4  # of the coupling bound


@contextmanager
def _blocks() -> Iterator[None]:
    """Launch with real blocks on the CPU device too."""
    before = wp.config.enable_cpu_blocks
    wp.config.enable_cpu_blocks = True
    try:
        yield
    finally:
        wp.config.enable_cpu_blocks = before


def find_edits(m: Model, d: Data) -> None:
    """Find which trees were moved by hand."""
    law = d.dashpot
    law.work.edited.zero_()
    wp.launch(
        memory.find_edits,
        dim=(d.nworld, m.njnt),
        inputs=[
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


def find_rows(m: Model, d: Data, ahead: float) -> None:
    """Collect and sort groups, with Jacobians, rates and gaps."""
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
    if own.nmocap:
        wp.launch(
            mocap.drive_rows,
            dim=(d.nworld, law.groups),
            inputs=[
                ahead,
                m.opt.timestep,
                m.geom_bodyid,
                own.body_mocap,
                d.xpos,
                contact.pos,
                contact.frame,
                state,
                work,
            ],
        )


def couple(m: Model, d: Data) -> None:
    """Find A of contact-space blocks."""
    law, own = d.dashpot, m.dashpot
    wp.launch(
        rows.couple, dim=(d.nworld, law.groups, law.groups), inputs=[own.dims, m.nv, law.rows]
    )


def plan_and_recall(m: Model, d: Data, ahead: float) -> None:
    """Match groups with memory, bound their coupling, fill rows, recall springs."""
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
            m.geom_rbound,
            pair,
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


def run_microsteps(m: Model, d: Data) -> None:
    """Run all micro-steps of all worlds in one launch."""
    law, own = d.dashpot, m.dashpot
    with _blocks():
        wp.launch_tiled(
            microstep_kernel(own.dims),
            dim=[d.nworld],
            inputs=[own.microsteps, m.opt.timestep, own.recovery_speed, law.rows],
            block_dim=law.block,
        )


def respond(m: Model, d: Data) -> None:
    """Find velocities, displacements and mean forces from impulses."""
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


def remember(m: Model, d: Data) -> None:
    """Let springs follow the bodies, and keep them."""
    law, own = d.dashpot, m.dashpot
    wp.launch(
        memory.remember,
        dim=(d.nworld, law.groups),
        inputs=[
            own.dims,
            m.nv,
            m.opt.timestep,
            d.geom_xmat,
            d.contact.pos,
            d.contact.frame,
            law.rows,
            law.memory,
            law.work,
        ],
    )


def remember_state(m: Model, d: Data) -> None:
    """Keep positions and velocities, raise flags."""
    law = d.dashpot
    wp.launch(
        memory.remember_state,
        dim=(d.nworld, max(m.nq, m.nv)),
        inputs=[m.nq, m.nv, d.qpos, d.qvel, d.overflow, law.memory, law.work],
    )
