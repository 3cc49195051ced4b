"""The law's own launches: rows, their plan, micro-steps, response and memory."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import warp as wp

from dashpot.warp import coupling, group, inertia, memory, microsteps, mocap, plan, recall, rows
from dashpot.warp.data import Data
from dashpot.warp.model import Model
from dashpot.warp.report import report_forces
from dashpot.warp.sweeps import sweep_kernel

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


def trees_of(m: Model) -> list[Any]:
    """Return which dofs trees have."""
    return [m.tree_dofadr, m.tree_dofnum]


def find_rows(m: Model, d: Data, ahead: float) -> None:
    """Collect and sort groups, with Jacobians, rates, gaps and the trees that they join."""
    law, own = d.dashpot, m.dashpot
    state, work = law.rows, law.work
    groups, trees = (d.nworld, law.groups), (d.nworld, m.ntree)
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
        dim=groups,
        inputs=[contact.geom, contact.geomcollisionid, efc.type, efc.id, state],
    )
    wp.launch(rows.clip_counts, dim=d.nworld, inputs=[state])
    of_contacts = [contact.dist, law.contact_margin, contact.dim, contact.friction]
    of_rows = [efc.type, efc.pos, efc.margin, efc.frictionloss]
    jacobian = [efc.J, efc.J_rownnz, efc.J_rowadr, efc.J_colind]
    wp.launch(
        rows.prepare_rows,
        dim=groups,
        inputs=[
            m.nv,
            ahead,
            m.is_sparse,
            m.opt.timestep,
            own.dof_tree,
            *trees_of(m),
            own.tree_factor,
            *of_contacts,
            contact.efc_address,
            *of_rows,
            *jacobian,
            state,
            work,
        ],
    )
    wp.launch(coupling.count_members, dim=trees, inputs=[state, work])
    wp.launch(coupling.add_counts, dim=d.nworld, inputs=[m.ntree, work])
    wp.launch(coupling.list_members, dim=trees, inputs=[state, work])
    if own.nmocap:
        drive_rows(m, d, ahead)


def drive_rows(m: Model, d: Data, ahead: float) -> None:
    """Let contacts, connects and welds see the velocities of mocap bodies."""
    law, own = d.dashpot, m.dashpot
    groups, time = (d.nworld, law.groups), [ahead, m.opt.timestep]
    bodies = [own.body_mocap, own.mocap_body, d.xpos]
    contacts = [law.mocap_motion, d.contact.pos, d.contact.frame, law.rows]
    wp.launch(mocap.drive_contacts, dim=groups, inputs=[*time, m.geom_bodyid, *bodies, *contacts])
    if m.neq:
        sites = [m.site_bodyid, d.site_xpos, m.site_quat]
        equalities = [m.eq_type, m.eq_objtype, m.eq_obj1id, m.eq_obj2id, m.eq_data]
        wp.launch(
            mocap.drive_equalities,
            dim=groups,
            inputs=[
                *time,
                *bodies,
                d.xquat,
                law.mocap_motion,
                *sites,
                *equalities,
                law.rows,
            ],
        )


def bound_coupling(m: Model, d: Data) -> None:
    """Find A where it is needed, which groups act, and the bound of their coupling."""
    law = d.dashpot
    state, work = law.rows, law.work
    groups = (d.nworld, law.groups)
    if not law.by_trees:
        wp.launch(coupling.couple, dim=(*groups, law.groups), inputs=[state])
    inputs = [m.opt.timestep, m.geom_bodyid, state, work]
    wp.launch(plan.find_touching, dim=groups, inputs=inputs)
    wp.launch(plan.admit_reached, dim=d.nworld, inputs=[m.opt.timestep, state])
    before = -1
    for _ in range(ROUNDS):
        wp.launch(
            coupling.bound_round,
            dim=(d.nworld, state.dims, law.groups),
            inputs=[law.by_trees, before, state, work],
        )
        before = 1 if before == 0 else 0
    every = (d.nworld, 3, law.groups)
    wp.launch(coupling.bound_groups, dim=every, inputs=[1 - before, state, work])
    wp.launch(coupling.share_bounds, dim=every, inputs=[m.geom_bodyid, state, work])


def plan_and_recall(m: Model, d: Data, ahead: float) -> None:
    """Match groups with memory, fill rows, recall springs."""
    law, own = d.dashpot, m.dashpot
    state, remembered, work = law.rows, law.memory, law.work
    groups = (d.nworld, law.groups)
    near = [own.geom_tree, d.geom_xpos, d.geom_xmat, d.contact.pos, state, remembered, work]
    wp.launch(memory.find_nearest, dim=groups, inputs=near)
    wp.launch(memory.settle_contests, dim=groups, inputs=[state])
    wp.launch(memory.choose_again, dim=d.nworld, inputs=[state, remembered])
    wp.launch(
        plan.fill_rows,
        dim=groups,
        inputs=[own.microsteps, m.opt.timestep, m.geom_rbound, law.pair(m, d), state, work],
    )
    geoms = [own.geom_tree, m.geom_rbound, m.geom_bodyid, d.geom_xpos, d.geom_xmat]
    wp.launch(
        recall.recall,
        dim=groups,
        inputs=[
            ahead,
            m.opt.timestep,
            own.recovery_speed,
            *geoms,
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
    options = [m.opt.timestep, own.recovery_speed, law.rows]
    wp.launch(group.begin, dim=(d.nworld, law.groups), inputs=[own.microsteps, *options])
    kernel, inputs = microsteps.run_microsteps, [own.microsteps, *options]
    if law.by_trees:
        kernel = sweep_kernel(law.rows.dims)
        inputs = [own.microsteps, m.ntree, *options, law.work]
    with _blocks():
        wp.launch_tiled(kernel, dim=[d.nworld], inputs=inputs, block_dim=law.block)


def respond(m: Model, d: Data) -> None:
    """Find velocities, displacements and mean forces from impulses."""
    law, own = d.dashpot, m.dashpot
    wp.launch(
        inertia.respond,
        dim=(d.nworld, m.ntree),
        inputs=[m.opt.timestep, *trees_of(m), own.tree_factor, law.rows, law.work],
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
    law = d.dashpot
    contacts = [d.geom_xmat, d.contact.pos, d.contact.frame]
    wp.launch(
        memory.remember,
        dim=(d.nworld, law.groups),
        inputs=[m.opt.timestep, *trees_of(m), *contacts, law.rows, law.memory, law.work],
    )


def remember_state(m: Model, d: Data) -> None:
    """Keep positions and velocities, raise flags."""
    law = d.dashpot
    wp.launch(
        memory.remember_state,
        dim=(d.nworld, max(m.nq, m.nv)),
        inputs=[m.nq, m.nv, d.qpos, d.qvel, d.overflow, law.memory, law.work],
    )
