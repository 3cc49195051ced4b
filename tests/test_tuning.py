"""Tuning of MuJoCo for the rows of the benchmarks: it finds what mechanics says is best."""

from __future__ import annotations

from math import inf

import mujoco
import numpy as np
import pytest

from scenes import ball_drop, slide, spin, stack
from simulate import AS_SHIPPED, DIRECT_IMPEDANCE, INTEGRATORS, Setting, measure
from tune import best_for_all, ranks, search, setting_of
from tuned_rows import Outcome, Row, row_of

GRID = {
    "screen": {
        "integrator": ["Euler", "RK4"],
        "cone": ["pyramidal"],
        "impratio": [1.0],
        "noslip_iterations": [0],
        "contact": ["as shipped", "direct"],
    },
    "search": {"refined": [1], "finalists": 2, "for_all": 2},
    "change": [{"tolerance": 1e-12}],
}
CHOICE = {"integrator": "Euler", "cone": "elliptic", "impratio": 1.0, "noslip_iterations": 0}


def test_a_box_that_spins_freely_is_stepped_by_runge_kutta():
    """Euler's method is of first order, and 1 ms of 10 rad/s is 0.01 rad; RK4 is of fourth."""
    row = row_of([spin(duration=2.0)], quantity="energy error")
    found = search(row, GRID)
    assert found["tuned"]["choice"]["integrator"] == "RK4"
    assert found["as shipped"]["numbers"][0] > 1e-3
    assert found["tuned"]["numbers"][0] < 1e-8
    # Four combinations, two of which a scene without a stiffness does not have, and one change.
    assert found["tries"] == 5
    assert found["first"].count(inf) == 2


def test_a_setting_that_fails_at_a_smaller_step_is_not_chosen():
    def fails_when_fine(setting: Setting, timestep: float) -> Outcome:
        rk4 = setting.option.get("integrator") == INTEGRATORS["RK4"]
        return Outcome((inf if timestep < 0.005 else 0.0) if rk4 else 1.0)

    steps = (0.001, 0.005)
    row = Row("row", "", "", steps, fails_when_fine, fails_when_fine, screen_timesteps=(0.005,))
    assert search(row, GRID)["tuned"]["numbers"] == [1.0, 1.0]


def test_the_setting_for_all_is_the_one_with_the_best_mean_rank():
    """Of a row that Euler wins by little and two that RK4 wins."""

    def prefers(integrator: str):
        def number(setting: Setting, timestep: float) -> Outcome:
            return Outcome(float(setting.option.get("integrator") != INTEGRATORS[integrator]))

        return Row(integrator, "", "", (0.001,), number, number)

    made = {"a": prefers("Euler"), "b": prefers("RK4"), "c": prefers("RK4")}
    found = {name: search(row, GRID) for name, row in made.items()}
    assert best_for_all(found, made, GRID)["integrator"] == "RK4"
    assert [found[name]["for all"]["numbers"] for name in "abc"] == [[1.0], [0.0], [0.0]]
    assert ranks([3.0, 1.0, 1.0, inf]) == pytest.approx([0.5, 0.125, 0.125, 0.75])


def test_a_choice_sets_contacts_limits_and_equalities():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep="0.004"/><worldbody><geom type="plane" size="1 1 1"/>
        <body name="a"><joint name="a" axis="0 1 0" limited="true" range="-1 1"/>
          <geom size=".1"/></body></worldbody>
        <equality><weld body1="a"/></equality></mujoco>"""
    )
    setting = setting_of({**CHOICE, "contact": "unsafe hard", "multiccd": False})
    setting.apply(model)
    for name in ("geom", "eq", "jnt"):
        assert np.all(getattr(model, f"{name}_solref") == (0.004, 1.0))
        assert np.all(getattr(model, f"{name}_solimp")[:, :2] == 0.9999)
    assert model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    flags = mujoco.mjtDisableBit.mjDSBL_REFSAFE | mujoco.mjtDisableBit.mjDSBL_MULTICCD
    assert model.opt.disableflags == int(flags)


def test_names_that_mujoco_does_not_know_are_refused():
    with pytest.raises(KeyError, match="stiffer"):
        setting_of({**CHOICE, "contact": "stiffer"})
    with pytest.raises(AttributeError, match="toleranse"):
        measure(slide(), setting_of({**CHOICE, "contact": "hard", "toleranse": 1e-9}), 0.01)


def test_direct_solref_gives_a_stack_the_springs_of_the_scene():
    """MuJoCo's best is level here, if the integrator is implicit in contacts: a fair comparison."""
    setting = Setting(
        "direct", direct=1.0 - DIRECT_IMPEDANCE, option={"integrator": INTEGRATORS["discrete"]}
    )
    assert measure(stack(), setting, 0.005)["sag error"] < 1e-7  # its solver's tolerance is 1e-8
    assert measure(stack(), AS_SHIPPED, 0.005)["sag error"] > 0.1
    # A ball that bounces is no steady state: implicit steps damp it.
    ball = ball_drop(restitution=1.0)
    assert measure(ball, setting, 0.001)["apex error"] > 0.1
