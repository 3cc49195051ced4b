"""Fixtures that several files of tests share."""

from __future__ import annotations

import gc
from collections.abc import Generator

import mujoco
import pytest

from query_geoms import hull_mesh, hull_points, two_of_each

# What is imported and collected stays: searches for garbage there take a quarter of the time.
gc.disable()


def pytest_collection_finish() -> None:
    """From here on look for garbage among what tests leave alone, and not too often."""
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)
    gc.enable()


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call() -> Generator[None, object, object]:
    """Skip what has height fields where MuJoCo finds them too near."""
    try:
        return (yield)
    except ValueError as error:
        if mujoco.mj_version() < 3016000 and "refuses: height fields" in str(error):
            pytest.skip("MuJoCo 3.15 has wrong distances from height fields, which are refused")
        raise


@pytest.fixture(scope="module")
def zoo():
    """Two free bodies of each convex type, and a plane."""
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset>{hull_mesh(hull_points())}</asset><worldbody>
        <geom name="plane" type="plane" size="1 1 1"/>{two_of_each()}</worldbody></mujoco>"""
    )


@pytest.fixture
def undrawn(monkeypatch):
    """Leave out what takes most of the time of a report: figures are made, but not drawn."""
    from dashpot.calibrate.report import page
    from dashpot.figures import ShownFigure

    monkeypatch.setattr(page, "embedded", lambda figure: f"data:,{len(figure.axes)} panels")
    monkeypatch.setattr(page, "animation", lambda clip, _: ShownFigure())
