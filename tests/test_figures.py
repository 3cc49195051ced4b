"""Figures show in any notebook, in colours that stay with what they show."""

from __future__ import annotations

import io

import numpy as np
import pytest
from IPython.core.formatters import DisplayFormatter
from matplotlib.colors import to_hex
from PIL import Image

from ball_throws import SIDEWAYS, ball_engine, ball_parameters, observe
from dashpot import compare
from dashpot.calibrate import Problem, fit
from dashpot.colours import colours_of
from dashpot.figures import ShownFigure, picture


@pytest.fixture(scope="module")
def comparison():
    return compare.run("ball", duration=0.5, settings=["dashpot", "elliptic", "mujoco-default"])


@pytest.fixture(scope="module")
def ball_fit():
    engine = ball_engine()
    throw = observe(engine, SIDEWAYS, noise=np.random.default_rng(8))
    return fit(Problem(engine, ball_parameters(), [throw], 1e-4, 1e-3), starts=0)


@pytest.mark.parametrize("which", ["comparison", "ball_fit"])
def test_a_plot_is_a_picture_where_nothing_was_set_up(which, request):
    """IPython asks a figure for a picture itself; pyplot, which would teach it, is not used."""
    figure = request.getfixturevalue(which).plot()
    shown, metadata = DisplayFormatter().format(figure)
    image = Image.open(io.BytesIO(shown["image/png"]))
    width, height = figure.get_size_inches()
    assert metadata["image/png"] == {"width": round(100 * width), "height": round(100 * height)}
    assert image.width > 100 * width  # sharp on dense screens


@pytest.mark.parametrize("form", ["svg", "png", "pdf"])
def test_a_file_is_the_same_for_the_same_figure(form):
    def drawn():
        figure = ShownFigure(figsize=(2, 2))
        figure.add_subplot().fill_between([0, 1], [1, 2])
        return picture(figure, form)

    assert drawn() == drawn()


def test_a_setting_keeps_its_colour(comparison):
    """Whatever else is compared, and in whatever order."""
    assert colours_of(["elliptic", "dashpot"])["dashpot"] == colours_of(["dashpot"])["dashpot"]
    chosen = colours_of(compare.DEFAULT_SETTINGS)
    assert len(set(chosen.values())) == len(compare.DEFAULT_SETTINGS)
    mine = colours_of(["dashpot", "my own", "MuJoCo"])
    assert len(set(mine.values())) == 3
    for axes in comparison.plot().axes:
        for line in axes.lines:
            if not line.get_label().startswith("_"):
                assert to_hex(line.get_color()) == chosen[line.get_label()]


def test_energy_does_not_dive(comparison):
    """On a linear axis all of every run is between the limits, and its bottom is no pole."""
    energy = comparison.plot().axes[1]
    assert energy.get_yscale() == "linear"
    low, high = energy.get_ylim()
    for line in energy.lines:
        assert ((low < line.get_ydata()) & (line.get_ydata() < high)).all()


def test_legends_cover_no_curve(comparison, ball_fit):
    for figure in (comparison.plot(), ball_fit.plot()):
        picture(figure, "png")  # lays it out
        (legend,) = figure.legends
        for axes in figure.axes:
            assert axes.get_legend() is None
            assert not axes.get_window_extent().overlaps(legend.get_window_extent())


def test_predictions_are_a_table_of_errors(ball_fit):
    found = ball_fit.predict()
    html = found._repr_html_()
    assert html.startswith("<table")
    assert ">position, m</th>" in html
    # 40 frames, three axes of 0.1 mm: root mean square of the length, within four deviations.
    error = float(str(found).splitlines()[-3].split("│")[3])
    assert error == pytest.approx(np.sqrt(3) * 1e-4, rel=0.3)
    assert isinstance(found, tuple)
    assert found[0]._repr_html_() == html


def test_a_figure_is_a_matplotlib_figure(ball_fit, tmp_path):
    figure = ball_fit.plot(tmp_path / "fit.pdf")
    assert isinstance(figure, ShownFigure)
    assert (tmp_path / "fit.pdf").read_bytes().startswith(b"%PDF")
