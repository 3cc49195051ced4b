"""Steps on every instruction set of the processor: the same bits; what it lacks is refused."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

VARIABLE = "DASHPOT_INSTRUCTION_SET"
STEP = f"""
import hashlib, sys
sys.path[:0] = {[str(Path(__file__).parent), *sys.path]!r}
import shared_step_scenes as scenes
for make in (scenes.bin_with_rolling_friction, scenes.arms_in_a_bin):
    engine, data = make(1)
    stats = engine.step(data, nstep=50)
    assert stats.touching > 50
    print(hashlib.sha256(scenes.stored(engine, data).tobytes()).hexdigest())
"""


def step_on(instruction_set: str | None) -> subprocess.CompletedProcess[str]:
    """Step some scenes in a process of its own, on the best instruction set if None is given."""
    environment = {name: value for name, value in os.environ.items() if name != VARIABLE}
    if instruction_set is not None:
        environment[VARIABLE] = instruction_set
    return subprocess.run(
        [sys.executable, "-c", STEP], env=environment, capture_output=True, text=True, check=False
    )


def test_all_instruction_sets_give_the_same_bits() -> None:
    best = step_on(None)
    assert best.returncode == 0, best.stderr
    assert len(set(best.stdout.split())) == 2
    compared = []
    for name in ("portable", "avx2", "avx512"):
        found = step_on(name)
        if found.returncode != 0:
            assert f"{VARIABLE} is '{name}'; it must be" in found.stderr
            continue
        assert found.stdout == best.stdout, name
        compared.append(name)
    assert "portable" in compared


@pytest.mark.parametrize("name", ["AVX2"])
def test_an_instruction_set_that_is_none_is_refused_by_name(name: str) -> None:
    found = step_on(name)
    assert found.returncode != 0
    assert f"{VARIABLE} is '{name}'; it must be 'portable', 'avx2' or 'avx512'" in found.stderr
