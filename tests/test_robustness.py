"""Random scenes over stiffness, damping, mass, friction and time step stay bounded."""

import mujoco
import numpy as np
import pytest

from dashpot import Engine, Material
from random_scenes import RandomScene, check, random_articulated_scene, random_scene
from scene import free_body, mjcf


@pytest.mark.parametrize("seed", range(20))
def test_random_free_bodies(seed):
    """Finite, energy at most 1 % above the start's, forces inside their cones."""
    assert check(random_scene(seed, steps=300)) == []


def test_a_light_capsule_that_is_squeezed_as_it_spins_stays_bounded():
    """58 g between 49 and 10 kg, which it turns against by 0.4 rad in each step of 15 ms."""
    xml = mjcf(
        free_body(
            "drum",
            'type="cylinder" size=".10932 .09608" mass="10.22" friction="1.668"',
            (-0.03379, -0.04892, 0.17093),
            quat=(-0.5828, 0.17964, -0.74908, -0.25874),
        )
        + free_body(
            "capsule",
            'type="capsule" size=".03685 .11756" mass=".0585" friction="1.826"',
            (0.00779, 0.04404, 0.50903),
            quat=(0.91793, -0.32837, 0.06133, -0.21403),
        )
        + free_body(
            "box",
            'type="box" size=".04453 .11758 .10037" mass="49.167" friction="1.911"',
            (-0.03757, -0.02223, 0.83707),
            quat=(-0.29185, -0.152, -0.59683, -0.73179),
        ),
        floor='friction=".4793"',
    )
    velocity = np.array(
        [
            [2.02865, -2.49985, -2.87629, -11.42072, 11.84483, 5.66318],
            [2.98935, 2.95538, 2.11729, -18.7099, -5.94293, 18.61933],
            [2.78878, 2.86607, -0.83867, 16.35571, 5.96775, -3.4606],
        ]
    )
    materials = {
        "drum": Material(1.129e8, damping_ratio=1.2253),
        "capsule": Material(46741.0, damping_ratio=0.1382),
    }
    scene = RandomScene(4528, xml, 0.01505, 300, velocity, materials)
    engine = scene.engine()
    data = engine.make_data()
    data.qvel[:] = velocity.ravel()
    engine.step(data, nstep=scene.steps)
    assert engine.energy(data).dissipated > 100.0  # J: they have hit
    assert check(scene) == []


@pytest.mark.parametrize(
    ("integrator", "seed"),
    [("implicitfast", seed) for seed in range(16)] + [("implicit", seed) for seed in range(6)],
)
def test_random_trees_with_limits_dry_friction_and_equalities(integrator, seed):
    assert check(random_articulated_scene(seed, steps=300, integrator=integrator)) == []


def test_a_corner_that_turns_far_while_it_is_pressed_gives_no_energy():
    """A box of 445 kg at 30 rad/s lands on a corner in steps of 14 ms, 0.43 rad each.

    The turn of the corner stretched its spring for nothing: 4 % of all energy.
    """
    box = free_body(
        "box",
        'type="box" size=".04713 .07754 .05678" mass="445.27" friction="1.819"',
        (0.0, 0.0, 0.107),
        quat=(-0.1952, -0.31946, 0.73196, -0.56928),
    )
    model = mujoco.MjModel.from_xml_string(mjcf(box))
    model.opt.timestep = 0.01428
    engine = Engine(model)
    engine.set_material("box", Material(3.708e7, damping_ratio=0.00082))
    data = engine.make_data()
    data.qvel[:] = -2.499, 1.59771, 1.14835, 8.98174, 9.81292, 9.39159
    start = engine.energy(data)
    all_of_it = before = start.kinetic + start.potential
    for _ in range(40):
        engine.step(data)
        energy = engine.energy(data)
        stored = energy.kinetic + energy.potential + energy.elastic
        # In no step, not only from its start on: friction takes a tenth on the way.
        assert stored <= before * (1.0 + 1e-12)
        assert stored + energy.dissipated == pytest.approx(all_of_it, rel=1e-12)
        before = stored
    assert energy.dissipated_friction > 0.03 * all_of_it
    assert energy.dissipated_normal > 0.01 * all_of_it
