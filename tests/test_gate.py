"""The gate: what exceeds its limit, or got lost, fails."""

from __future__ import annotations

import shutil
from math import nan

import pytest

import gate
from gate_figures import accuracy, instructions
from gate_figures.figure import Figure
from robots import ROBOTS

CREEP = Figure("slope, creep", "2", 0.0, margin=0.2, floor=1e-12)
SLIDE = Figure("slide, distance error", "2", 4e-8, margin=0.2)
PEER = Figure("Ant", "mj_step", 1e5, margin=0.03, limited=False)


def of(figure: Figure, value: float) -> Figure:
    """Return the figure with another value."""
    return Figure(**{**vars(figure), "value": value})


@pytest.fixture
def passed(monkeypatch, tmp_path):
    """Return a run of the gate against what CREEP, SLIDE and PEER stand for."""
    standing = tmp_path / "gate.toml"

    def run(*figures: Figure, update: bool = False) -> bool:
        monkeypatch.setattr(gate, "PARTS", {"accuracy": lambda: iter(figures)})
        options = ["--update"] if update else []
        return gate.main(["accuracy", "--standing", str(standing), *options]) == 0

    assert not run(CREEP, SLIDE, PEER)  # nothing stands yet
    assert run(CREEP, SLIDE, PEER, update=True)
    return run


def test_what_stands_passes_and_so_does_what_is_better(passed):
    assert passed(CREEP, SLIDE, PEER)
    assert passed(CREEP, of(SLIDE, 1e-8), PEER)


def test_an_error_may_grow_by_a_fifth(passed):
    assert passed(CREEP, of(SLIDE, 4.7e-8), PEER)
    assert not passed(CREEP, of(SLIDE, 4.9e-8), PEER)


def test_rounding_of_an_exact_zero_passes(passed):
    assert passed(of(CREEP, 9e-13), SLIDE, PEER)
    assert not passed(of(CREEP, 2e-12), SLIDE, PEER)


def test_what_is_not_a_number_fails(passed):
    assert not passed(CREEP, of(SLIDE, nan), PEER)


def test_what_only_stands_beside_others_has_no_limit(passed):
    assert passed(CREEP, SLIDE, of(PEER, 1e6))


def test_a_figure_that_got_lost_fails(passed, capsys):
    assert not passed(CREEP, PEER)
    assert "slide, distance error, 2: not measured" in capsys.readouterr().out


def test_the_failing_figure_is_named_with_its_limit(passed, capsys):
    passed(of(CREEP, 1e-3), of(SLIDE, 5e-8), PEER)
    printed = capsys.readouterr().out
    assert "slope, creep, 2: 0.001, limit 1e-12" in printed
    assert "slide, distance error, 2: 5e-08, limit 4.8e-08" in printed
    assert "2 of the figures miss" in printed


def test_an_update_lets_what_is_worse_stand(passed):
    assert passed(CREEP, of(SLIDE, 1e-6), PEER, update=True)
    assert passed(CREEP, of(SLIDE, 1e-6), PEER)


def test_every_situation_and_robot_has_a_limit():
    standing = gate.read(gate.STANDING)
    of_errors = standing.pop("accuracy")
    for scene in accuracy.scenes():
        for quantity in scene.targets:
            cases = of_errors[f"{scene.name}, {quantity}"]
            assert set(cases) == {f"{1e3 * timestep:g}" for timestep in scene.timesteps}
    assert standing
    for table, rows in standing.items():
        assert table.startswith("instructions, ")
        assert set(rows) == set(ROBOTS)
        for counts in rows.values():
            assert set(counts) == {"dashpot", "mj_step"}


def test_a_worse_step_exceeds_what_stands():
    """Steps of the slide of 5 ms have 2.5 times the error of those of 2 ms."""
    rows = gate.read(gate.STANDING)["accuracy"]
    slide = next(scene for scene in accuracy.scenes() if scene.name == "slide")
    error = accuracy.measure(slide, timestep=0.005)["distance error"]
    (verdict,) = gate.judge([accuracy.figure("slide", "distance error", 0.002, error)], rows)
    assert not verdict.passes


def test_without_valgrind_the_gate_says_what_to_install(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(SystemExit, match="apt-get install valgrind"):
        next(instructions.figures())
