"""Random scenes over stiffness, damping, mass, friction and time step stay bounded."""

import pytest

from random_scenes import check, random_articulated_scene, random_scene


# In the last one a capsule of 58 g is squeezed that turns 1.5 rad in a step.
@pytest.mark.parametrize("seed", [*range(40), 4528])
def test_random_free_bodies(seed):
    """Finite, energy at most 1 % above the start's, forces inside their cones."""
    assert check(random_scene(seed, steps=300)) == []


@pytest.mark.parametrize(
    ("integrator", "seed"),
    [("implicitfast", seed) for seed in range(30)]
    + [(integrator, seed) for integrator in ("implicit", "RK4") for seed in range(12)],
)
def test_random_trees_with_limits_dry_friction_and_equalities(integrator, seed):
    assert check(random_articulated_scene(seed, steps=300, integrator=integrator)) == []
