"""Trees of joints in flight, where rows are possible: second order, momentum, energy."""

import mujoco
import numpy as np
import pytest

import dashpot
from ends_of_steps import finish_velocity

FLOOR = '<geom type="plane" size="5 5 1" pos="0 0 -90" contype="1"/>'
ROD = '<geom type="capsule" fromto="0 0 0 {} 0 0" size=".02"/>'
FIXED = f"""<body><joint name="a" axis="0 1 0" {{joint}}/>{ROD.format(0.4)}
  <body pos=".4 0 0" {{body}}><joint name="b" axis="0 1 0" {{joint}}/>{ROD.format(0.3)}
  </body></body>"""
SERIAL = f"""<body><joint name="a" axis="0 0 1" {{joint}}/>{ROD.format(0.3)}
  <body pos=".3 0 0" {{body}}><joint name="b" axis="0 1 0" {{joint}}/>{ROD.format(0.3)}
  <body pos=".3 0 0"><joint type="ball"/>{ROD.format(0.2)}</body></body></body>"""
FLOATING = f"""<body><freejoint/><geom type="box" size=".1 .07 .05"/>
  <body pos=".15 0 0" {{body}}><joint name="a" axis="0 1 0" {{joint}}/>{ROD.format(0.3)}</body>
  <body pos="-.15 0 0"><joint name="b" axis="0 0 1" {{joint}}/>{ROD.format(-0.3)}</body></body>"""
TREES = {"fixed": FIXED, "serial": SERIAL, "floating": FLOATING}
SERVOS = """<actuator><position joint="a" kp="20" kv=".5"/><position joint="b" kp="10" kv=".2"/>
  </actuator>"""
DRIVEN = {
    "limp": ("", "", ""),
    "springs": ('stiffness="2"', "", ""),
    "armature": ('armature=".02"', "", ""),
    "dampers": ('damping=".1"', "", ""),
    "servos": ('armature=".01"', "", SERVOS),
    "weightless": ("", 'gravcomp="1"', ""),
}


def scene(tree: str, drive: str, timestep: float, integrator: str) -> mujoco.MjModel:
    joint, body, rest = DRIVEN[drive]
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><default><geom contype="0"/></default><worldbody>
        {FLOOR}{TREES[tree].format(joint=joint, body=body)}</worldbody>{rest}</mujoco>"""
    )
    model.opt.timestep = timestep
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    return model


def throw(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    data.qvel[:] = np.random.default_rng(3).normal(size=model.nv)


def end_of_flight(tree: str, drive: str, integrator: str, timestep: float, *, exact: bool = False):
    """Return positions after 0.4 s; `exact`: of MuJoCo's RK4."""
    model = scene(tree, drive, timestep, "RK4" if exact else integrator)
    engine = None if exact else dashpot.Engine(model)
    data = mujoco.MjData(model) if exact else engine.make_data()
    throw(model, data)
    if exact:
        mujoco.mj_step(model, data, round(0.4 / timestep))
    else:
        engine.step(data, nstep=round(0.4 / timestep))
    return model, data.qpos.copy()


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit"])
@pytest.mark.parametrize("drive", DRIVEN)
@pytest.mark.parametrize("tree", TREES)
def test_flight_is_of_second_order(tree, drive, integrator):
    model, exact = end_of_flight(tree, drive, integrator, 2e-4, exact=True)
    steps, errors, change = [0.005, 0.002, 0.001], [], np.zeros(model.nv)
    for timestep in steps:
        _, found = end_of_flight(tree, drive, integrator, timestep)
        mujoco.mj_differentiatePos(model, change, 1.0, exact, found)
        errors.append(np.abs(change).max())
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(2.0, abs=0.25)
    # Joints turn by 0.01 rad in a step of 2 ms.
    assert errors[1] < 1e-3


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
def test_a_limp_robot_in_flight_keeps_its_energy_and_momentum(timestep):
    """For five seconds without weight; energy in parts of what turns it, momentum of its size."""
    model = scene("floating", "limp", timestep, "Euler")
    model.opt.gravity[:] = 0.0
    engine = dashpot.Engine(model)
    data, probe = engine.make_data(), mujoco.MjData(model)
    throw(model, data)

    def kept():
        finish_velocity(model, data, probe)
        mujoco.mj_subtreeVel(model, probe)
        mujoco.mj_energyVel(model, probe)
        linear = probe.subtree_linvel[1] * model.body_subtreemass[1]
        return probe.energy[1], np.concatenate([linear, probe.subtree_angmom[1]])

    engine.step(data)
    energy, momentum = kept()
    for _ in range(round(5.0 / timestep) // 50):
        engine.step(data, nstep=50)
        now, of_all = kept()
        assert now == pytest.approx(energy, rel=1e-6 * (timestep / 0.002) ** 2)
        drift = np.abs(of_all - momentum).max() / np.abs(momentum).max()
        assert drift < 1e-6 * (timestep / 0.002) ** 2
