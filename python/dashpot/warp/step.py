"""The step: half a drift, MuJoCo Warp's stages, the law, and the other half."""

from __future__ import annotations

import warp as wp

from dashpot.warp import comfree
from dashpot.warp.data import Data
from dashpot.warp.model import Model
from dashpot.warp.solve import (
    couple,
    find_edits,
    find_rows,
    plan_and_recall,
    remember,
    remember_state,
    respond,
    run_microsteps,
)
from dashpot.warp.stages import (
    HALF,
    advance_semi_implicit,
    drift_to_end,
    drift_to_middle,
    find_geometry,
    find_smooth_motion,
    finish_stages,
    leave_mocap_bodies,
    move_mocap_bodies,
)

__all__ = ["forward", "rollout", "step"]


def step(m: Model, d: Data) -> None:
    """Advance all worlds by one time step.

    What MuJoCo Warp's stages leave in `d`, positions of bodies and geoms, contacts, sensors, is
    that of the middle of the step. ``qpos``, ``qvel`` and ``time`` are those of its end. With
    ``law="comfree"`` it is that of the start, as in MuJoCo. Nothing is read back by the host, so
    that a step can be captured as a graph.

    Examples
    --------
    >>> dw.step(m, d)  # compiles what it needs
    >>> with wp.ScopedCapture() as capture:
    ...     dw.step(m, d)
    >>> for _ in range(20):
    ...     wp.capture_launch(capture.graph)
    """
    if m.dashpot.law == "comfree":
        find_edits(m, d)
        _solve_complementarity_free(m, d)
        advance_semi_implicit(m, d)
        remember_state(m, d)
        return
    find_edits(m, d)
    drift_to_middle(m, d)
    move_mocap_bodies(m, d, HALF)
    _solve(m, d, HALF)
    drift_to_end(m, d)
    leave_mocap_bodies(m, d, d.dashpot.memory)
    remember(m, d)
    remember_state(m, d)


def forward(m: Model, d: Data) -> None:
    """Find forces, accelerations and sensors at the present state, and change nothing of it.

    Forces and accelerations are the means over the step to come.

    Examples
    --------
    >>> dw.forward(m, d)
    >>> round(float(d.qacc.numpy()[0, 2]), 2)  # the ball is in the air
    -9.81
    """
    if m.dashpot.law == "comfree":
        _solve_complementarity_free(m, d)
        return
    find_edits(m, d)
    move_mocap_bodies(m, d, 1.0)
    _solve(m, d, 0.0)
    leave_mocap_bodies(m, d, d.dashpot.aside)


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

    Examples
    --------
    >>> qpos, qvel = dw.rollout(m, d, nstep=20)
    >>> qpos.shape, qvel.shape
    ((20, 4, 14), (20, 4, 12))
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
    find_geometry(m, d, ahead)
    find_smooth_motion(m, d)
    find_rows(m, d, ahead)
    couple(m, d)
    plan_and_recall(m, d, ahead)
    run_microsteps(m, d)
    respond(m, d)
    finish_stages(m, d)


def _solve_complementarity_free(m: Model, d: Data) -> None:
    """Take the stages of `law="comfree"`, at the start of the step, with the model's margins."""
    own, law = m.dashpot, d.dashpot
    find_geometry(m, d, 0.0)
    find_smooth_motion(m, d)
    find_rows(m, d, 0.0)
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
    respond(m, d)
    finish_stages(m, d)
