"""Random scenes over stiffness, damping, mass, friction and time step stay bounded."""

import pytest

from random_scenes import check, random_scene


@pytest.mark.parametrize("seed", range(40))
def test_random_scene(seed):
    """Finite, energy at most 1 % above the start's, forces inside their cones."""
    assert check(random_scene(seed, steps=300)) == []
