"""Velocities at the time of positions.

`qvel` at the end of a step has the forces of its start over all of it. The next step adds half of
what they change by meanwhile. Tests of energies in flight add it, too.
"""

import mujoco


def finish_velocity(model: mujoco.MjModel, data: mujoco.MjData, probe: mujoco.MjData) -> None:
    """Give `probe` the positions of `data`, and the velocities that go with them.

    Of trees in flight without dampers and joint springs, and of those alone.
    """
    probe.qpos[:], probe.qvel[:] = data.qpos, data.qvel
    mujoco.mj_forward(model, probe)
    change = probe.qacc_smooth - data.qacc_smooth
    probe.qvel[:] = data.qvel + 0.5 * model.opt.timestep * change
    mujoco.mj_forward(model, probe)
