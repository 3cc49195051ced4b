"""Energy that first-order integration adds: smooth motion, and mechanisms that equalities hold.

    python benchmarks/smooth_drift.py

First, random articulated scenes stripped of every constraint row, from a state on their way: what
`mj_step` adds at whole, half and a quarter of the time step and with RK4, and what dashpot does.
Then undamped pendulums that equalities hold, in parts of the kinetic energy with which they pass
their lowest place at the start.
"""

from __future__ import annotations

import mujoco

import dashpot
from no_arguments import takes_no_arguments
from random_scenes import random_articulated_scene
from scene import Run, Scene
from simulate import AS_SHIPPED, DASHPOT, measure

CASES = ((7780, 180, 80),)  # seed, steps before, steps

LINK = 'type="capsule" size=".02" mass="1"'
WORLD = """<mujoco><option integrator="implicitfast"><flag contact="disable"/></option><worldbody>
  {}</worldbody><equality>{}</equality></mujoco>"""
ARM = f"""<body pos="0 {{}} 1"><joint name="{{}}" axis="0 1 0"/>
  <geom {LINK} fromto="0 0 0 0 0 -.2"/></body>"""

MECHANISMS = {
    "geared pendulums, 2:1": (
        WORLD.format(
            ARM.format(0, "fast") + ARM.format(1, "slow"),
            '<joint joint1="fast" joint2="slow" polycoef="0 2 0 0 0"/>',
        ),
        (4.0, 2.0),
    ),
    "four-bar": (
        WORLD.format(
            f"""<body pos="0 0 1"><joint axis="0 1 0"/><geom {LINK} fromto="0 0 0 0 0 -.2"/>
            <body pos="0 0 -.2"><joint axis="0 1 0"/><geom {LINK} fromto="0 0 0 .3 0 0"/>
            <body pos=".3 0 0"><joint axis="0 1 0"/><geom {LINK} fromto="0 0 0 0 0 .2"/>
            <body name="end" pos="0 0 .2"><geom size=".01" mass="1e-3"/>
            </body></body></body></body>""",
            '<connect body1="end" anchor="0 0 0"/>',
        ),
        (3.0, -3.0, 3.0),
    ),
    "slider-crank, 20 rad/s": (
        WORLD.format(
            f"""<body><joint axis="0 1 0"/><geom {LINK} fromto="0 0 0 0 0 .2"/>
            <body name="rod" pos="0 0 .2"><joint axis="0 1 0"/>
              <geom {LINK} fromto="0 0 0 .346410161513775 0 -.2"/></body></body>
            <body name="block" pos=".346410161513775 0 0"><joint type="slide" axis="1 0 0"/>
              <geom type="box" size=".05 .05 .05" mass="2"/></body>""",
            '<connect body1="block" body2="rod" anchor="0 0 0"/>',
        ),
        (20.0, -20.0, 4.0),
    ),
    "free rod on a connect": (
        WORLD.format(
            """<body name="rod" pos="0 0 1"><freejoint/>
            <geom type="capsule" size=".02 .15" mass="1"/></body>""",
            '<connect body1="rod" anchor="0 0 .15"/>',
        ),
        (-0.45, 0.0, 0.0, 0.0, 3.0, 0.0),
    ),
}


def energy(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Kinetic plus potential energy (J) of the state of `data`."""
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    probe = mujoco.MjData(model)
    probe.qpos[:], probe.qvel[:] = data.qpos, data.qvel
    mujoco.mj_forward(model, probe)
    return float(probe.energy.sum())


def without_rows(xml: str) -> mujoco.MjModel:
    """Return the scene without contacts, limits, equalities and dry friction."""
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.eq_active0[:] = 0
    model.jnt_limited[:] = 0
    model.dof_frictionloss[:] = 0.0
    return model


def drift_without_rows(seed: int, before: int, steps: int) -> None:
    """Print what smooth steps add to the energy of a random scene, in parts of its start's."""
    scene = random_articulated_scene(seed)
    engine = scene.engine()
    data = engine.make_data()
    data.qvel[:] = scene.velocity
    mujoco.mj_forward(engine.model, data)
    model = without_rows(scene.xml)
    scale = energy(model, data)
    engine.step(data, nstep=before)
    print(f"seed {seed}, {steps} steps from the state after {before}, without rows:")
    for name in ("IMPLICITFAST", "RK4"):
        for refine in (1, 2, 4):
            model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{name}")
            model.opt.timestep = scene.timestep / refine
            end = mujoco.MjData(model)
            end.qpos[:], end.qvel[:] = data.qpos, data.qvel
            mujoco.mj_step(model, end, refine * steps)
            gain = (energy(model, end) - energy(model, data)) / scale
            text = f"  mj_step {name.lower()} at 1/{refine} of the time step: {gain:+.2%}"
            if name != "RK4":
                smooth = dashpot.Engine(model)
                twin = smooth.make_data()
                twin.qpos[:], twin.qvel[:] = data.qpos, data.qvel
                smooth.step(twin, nstep=refine * steps)
                own = (energy(model, twin) - energy(model, data)) / scale
                text += f", dashpot {own:+.2%}"
            print(text)


def mechanism(name: str, *, duration: float = 12.0) -> Scene:
    """Let a mechanism swing; change of its energy in parts of the kinetic one at the start."""
    xml, velocity = MECHANISMS[name]

    def pass_lowest(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qvel[:] = velocity

    def measure(run: Run) -> dict[str, float]:
        data = mujoco.MjData(run.model)
        energies = []
        for row, speed in ((0, 0.0), (0, 1.0), (-1, 1.0)):
            data.qpos[:], data.qvel[:] = run.qpos[row], speed * run.qvel[row]
            energies.append(energy(run.model, data))
        rest, start, end = energies
        return {"energy change": abs((end - start) / (start - rest))}

    return Scene(
        name=name.split(",")[0].replace(" ", "-"),
        title=f"{name}, change of energy in {duration:g} s",
        xml=xml,
        duration=duration,
        start=pass_lowest,
        measure=measure,
        targets={"energy change": 1e-3},
        units={"energy change": ""},
        sample_interval=duration,
        timesteps=(0.001, 0.002, 0.005),
    )


def mechanisms(*, duration: float = 12.0) -> list[Scene]:
    """Return the mechanisms that equalities hold."""
    return [mechanism(name, duration=duration) for name in MECHANISMS]


def main() -> None:
    """Print both tables."""
    takes_no_arguments(__doc__)
    for case in CASES:
        drift_without_rows(*case)
    for scene in mechanisms():
        for timestep in scene.timesteps:
            errors = [measure(scene, s, timestep)["energy change"] for s in (DASHPOT, AS_SHIPPED)]
            print(
                f"{scene.title} at {1e3 * timestep:g} ms: "
                f"dashpot {errors[0]:.3%}, mj_step {errors[1]:.3%}"
            )


if __name__ == "__main__":
    main()
