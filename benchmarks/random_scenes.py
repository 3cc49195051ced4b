"""Seeded random scenes over the whole range of parameters that the engine must survive."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import mujoco
import numpy as np

import dashpot
from piles import random_quat
from scene import free_body, mjcf


@dataclass(frozen=True)
class RandomScene:
    """A scene and how to step it: `steps` steps of `timestep` (s)."""

    seed: int
    xml: str
    timestep: float
    steps: int
    velocity: np.ndarray
    materials: dict[str, dashpot.Material]

    def engine(self) -> dashpot.Engine:
        """Return an engine at the scene's time step with its materials."""
        model = mujoco.MjModel.from_xml_string(self.xml)
        model.opt.timestep = self.timestep
        engine = dashpot.Engine(model)
        engine.set_materials(self.materials)
        return engine


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform between those of `low` and `high`."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def random_scene(seed: int, *, steps: int = 400) -> RandomScene:
    """Return 1 to 8 free bodies thrown at a floor and at each other.

    Masses 1 g to 1 t, stiffness 1e3 to 1e9 N/m (one geom in five rigid, half of these with a
    restitution of 0 to 1), damping ratio 0 to 2, friction 0 to 2, time step 0.1 to 20 ms, speeds to
    3 m/s and 20 rad/s. Nothing overlaps at the start, so what the bodies hold then bounds their
    energy for ever.
    """
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 9))
    bodies, materials, velocity = [], {}, []
    height = 0.0
    for i in range(count):
        size = rng.uniform(0.03, 0.12, 3)
        mass = log_uniform(rng, 1e-3, 1e3)
        kind = rng.choice(["sphere", "box", "capsule", "cylinder", "ellipsoid"])
        friction = rng.uniform(0, 2)
        shape = " ".join(str(x) for x in size[: 3 if kind in ("box", "ellipsoid") else 2])
        if kind == "sphere":
            shape = str(size[0])
        radius = float(np.linalg.norm(size))  # no attitude of any shape reaches farther
        height += radius
        offset = rng.uniform(-0.05, 0.05, 2)
        geom = f'type="{kind}" size="{shape}" mass="{mass}" friction="{friction}"'
        quat = random_quat(rng)
        bodies.append(free_body(f"body{i}", geom, (*offset, height), quat=quat))
        height += radius
        if rng.uniform() > 0.2:
            materials[f"body{i}"] = dashpot.Material(
                log_uniform(rng, 1e3, 1e9), damping_ratio=float(rng.uniform(0, 2))
            )
        elif rng.uniform() > 0.5:
            materials[f"body{i}"] = dashpot.Material(restitution=float(rng.uniform(0, 1)))
        velocity.append([*rng.uniform(-3, 3, 3), *rng.uniform(-20, 20, 3)])
    timestep = log_uniform(rng, 1e-4, 0.02)
    floor = f'friction="{rng.uniform(0, 2)}"'
    return RandomScene(
        seed, mjcf("".join(bodies), floor=floor), timestep, steps, np.array(velocity), materials
    )


def random_chain(
    rng: np.random.Generator, name: str, position: tuple[float, float, float]
) -> tuple[str, list[str], str]:
    """Return a bent chain of 1 to 4 links, its joint names and the name of its last link."""
    links = int(rng.integers(1, 5))
    xml, joints, close, previous = "", [], "", 0.0
    for i in range(links):
        length, radius = rng.uniform(0.08, 0.2), rng.uniform(0.015, 0.03)
        joint = f"{name}_joint{i}"
        kind = rng.choice(["hinge", "slide", "ball"], p=[0.7, 0.15, 0.15])
        axis = " ".join(str(x) for x in random_quat(rng)[:3])
        attributes = f'damping="{rng.choice([0.0, 0.01, 0.3])}"'
        if kind != "ball":
            joints.append(joint)
            attributes += f' axis="{axis}" armature="{rng.choice([0.0, 0.01])}"'
            if rng.uniform() < 0.5:
                reach = rng.uniform(0.02, 0.1) if kind == "slide" else rng.uniform(0.2, 1.5)
                attributes += f' limited="true" range="{-reach} {reach}"'
            if rng.uniform() < 0.3:
                attributes += f' frictionloss="{log_uniform(rng, 1e-2, 1)}"'
        place = " ".join(str(x) for x in (position if i == 0 else (0, 0, -previous)))
        mass = log_uniform(rng, 0.05, 5)
        bend = " ".join(str(x) for x in rng.uniform(-40, 40, 3))
        xml += f"""<body name="{name}{i}" pos="{place}" euler="{bend}">
          <joint name="{joint}" type="{kind}" {attributes}/>
          <geom name="{name}{i}" type="capsule" fromto="0 0 0 0 0 {-length}" size="{radius}"
                mass="{mass}" friction="{rng.uniform(0, 2)}"/>"""
        close += "</body>"
        previous = length
    return xml + close, joints, f"{name}{links - 1}"


def random_articulated_scene(
    seed: int, *, steps: int = 400, integrator: str = "implicitfast"
) -> RandomScene:
    """Return two hanging chains with limits, dry friction and equalities, hit by free bodies.

    Time step 0.1 to 2 ms: beyond, MuJoCo's semi-implicit smooth integration of an undamped chain
    drifts by more than the bound on energy. Parameters of contact as in `random_scene`.
    """
    rng = np.random.default_rng(seed)
    chains, materials, ends, joints = "", {}, [], []
    for i, name in enumerate(("left", "right")):
        chain, names, end = random_chain(rng, name, (0.3 * i - 0.15, 0, 1.0))
        chains += chain
        ends.append(end)
        joints.append(names)
    for i in range(int(rng.integers(0, 3))):
        mass = log_uniform(rng, 0.01, 10)
        geom = f'type="sphere" size="{rng.uniform(0.03, 0.06)}" mass="{mass}"'
        chains += free_body(f"ball{i}", geom, (rng.uniform(-0.2, 0.2), -0.3 - 0.2 * i, 0.5))
    equalities = ""
    if joints[0] and joints[1] and rng.uniform() < 0.5:
        equalities += f'<joint joint1="{joints[0][0]}" joint2="{joints[1][0]}"/>'
    if rng.uniform() < 0.3:
        equalities += f'<connect body1="{ends[0]}" anchor="0 0 -0.05"/>'
    rest = f"<equality>{equalities}</equality>" if equalities else ""
    timestep = log_uniform(rng, 1e-4, 0.002)
    xml = mjcf(chains, rest=rest, option=f'integrator="{integrator}"')
    model = mujoco.MjModel.from_xml_string(xml)
    for geom in range(model.ngeom):
        if rng.uniform() > 0.5:
            name = model.geom(geom).name
            ratio = float(rng.uniform(0, 2))
            materials[name] = dashpot.Material(log_uniform(rng, 1e3, 1e9), damping_ratio=ratio)
    velocity = rng.uniform(-2, 2, model.nv)
    for i in range(model.njnt):
        if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_SLIDE:
            velocity[model.jnt_dofadr[i]] *= 0.2
        if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_FREE:
            velocity[model.jnt_dofadr[i] + 1] = rng.uniform(1, 3)  # towards the chains
    return RandomScene(seed, xml, timestep, steps, velocity, materials)


def mechanical_energy(engine: dashpot.Engine, data: mujoco.MjData) -> float:
    """Kinetic plus potential energy (J), zero at rest on the floor."""
    energy = engine.energy(data)
    return energy.kinetic + energy.potential


def turns_too_fast(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Whether an articulated joint turns more than 0.2 rad in a step.

    There MuJoCo's own smooth integration gains energy.
    """
    for i in range(model.njnt):
        dof = model.jnt_dofadr[i]
        if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_HINGE:
            speed = abs(data.qvel[dof])
        elif model.jnt_type[i] == mujoco.mjtJoint.mjJNT_BALL:
            speed = np.linalg.norm(data.qvel[dof : dof + 3])
        else:
            continue
        if speed * model.opt.timestep > 0.2:
            return True
    return False


def has_dampers_beyond_rk4(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Whether a damper takes more than 1 - exp(-2) of a velocity in a step of RK4.

    From 2.8 instead of 2 on, at any configuration on the way, RK4 diverges by itself.
    """
    if model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4:
        return False
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    rates = np.linalg.eigvals(np.linalg.solve(inertia, np.diag(model.dof_damping)))
    return bool(rates.real.max() * model.opt.timestep > 2.0)


def smooth_gain(scene: RandomScene, steps: int) -> float:
    """Energy (J) that single steps of `mj_step` add from each of the first `steps` states.

    What a step adds beyond the work of its forces, the constraints' among them: a step changes
    velocity in the geometry of its start, where M (v1 - v0) is the impulse of all forces and its
    product with the mean velocity their work, weight and Coriolis forces included.
    """
    engine = scene.engine()
    data = engine.make_data()
    data.qvel[:] = scene.velocity.ravel()
    model = mujoco.MjModel.from_xml_string(scene.xml)
    model.opt.timestep = scene.timestep
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    step = mujoco.MjData(model)
    momentum = np.empty(model.nv)
    gain = 0.0
    for _ in range(steps):
        mujoco.mj_resetData(model, step)
        step.qpos[:], step.qvel[:] = data.qpos, data.qvel
        mujoco.mj_forward(model, step)
        before, bias, velocity = step.energy.sum(), step.qfrc_bias.copy(), step.qvel.copy()
        end = mujoco.MjData(model)
        end.qpos[:], end.qvel[:] = data.qpos, data.qvel
        mujoco.mj_step(model, end)
        mean = 0.5 * (velocity + end.qvel)
        mujoco.mj_mulM(model, step, momentum, end.qvel - velocity)
        work = mean @ (momentum + scene.timestep * bias)
        mujoco.mj_forward(model, end)
        gain += end.energy.sum() - before - work
        engine.step(data)
    return float(gain)


def energy_failure(scene: RandomScene, steps: int, gain: float, start: float) -> str:
    """Return what to say of a scene that has gained `gain` (J) over `start` after `steps`."""
    return (
        f"seed {scene.seed}: energy {1 + gain / start:.4f} of start after {steps} steps: "
        f"{gain:+.3g} J; mj_step beyond the work of its forces, from the same states: "
        f"{smooth_gain(scene, steps):+.3g} J"
    )


def check(scene: RandomScene) -> list[str]:
    """Step a scene and return what is wrong: no entry means it passed."""
    engine = scene.engine()
    data = engine.make_data()
    data.qvel[:] = scene.velocity.ravel()
    mujoco.mj_forward(engine.model, data)
    if (data.contact.dist < 0).any():  # links of bent chains may cross
        return []
    if has_dampers_beyond_rk4(engine.model, data):
        return []
    start = mechanical_energy(engine, data)
    chunk = max(1, scene.steps // 20)
    for done in range(chunk, scene.steps + 1, chunk):
        engine.step(data, nstep=chunk)
        if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
            return [f"seed {scene.seed}: not finite after {done} steps"]
        if turns_too_fast(engine.model, data):
            return []
        energy = mechanical_energy(engine, data)
        if energy > 1.01 * start:
            return [energy_failure(scene, done, energy - start, start)]
        contacts = engine.contacts(data)
        # A pair slides with the larger of its two frictions (the default rule).
        friction = engine.model.geom_friction[contacts.geom, 0].max(axis=1)
        sliding = np.linalg.norm(contacts.force[:, 1:], axis=1)
        limit = friction * contacts.force[:, 0]
        # Rounding of a mean over micro-steps.
        if (sliding > limit * (1 + 1e-9) + 1e-12).any() or (contacts.force[:, 0] < 0).any():
            return [f"seed {scene.seed}: force outside its cone after {done} steps"]
    return []


def main() -> None:
    """Check the scenes of some seeds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("first", type=int, help="first seed")
    parser.add_argument("last", type=int, help="seed to end before")
    parser.add_argument("kind", nargs="?", choices=("free", "articulated"), default="free")
    parser.add_argument("integrator", nargs="?", default="implicitfast", help="of articulated ones")
    arguments = parser.parse_args()
    if arguments.first >= arguments.last:
        parser.error(f"no seed from {arguments.first} to before {arguments.last}")
    first, last = arguments.first, arguments.last
    failures = []
    for seed in range(first, last):
        scene = (
            random_articulated_scene(seed, integrator=arguments.integrator)
            if arguments.kind == "articulated"
            else random_scene(seed)
        )
        failures += check(scene)
    print("\n".join(failures) or "no failure")
    print(f"{last - first} scenes, {len(failures)} failures")


if __name__ == "__main__":
    main()
