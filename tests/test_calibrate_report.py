"""Reports of fits and comparisons: complete, true to the numbers, and nothing from outside."""

from __future__ import annotations

import base64
import io
import math
import re
import sys
from dataclasses import replace
from html.parser import HTMLParser
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from PIL import Image

from ball_throws import BALL, SIDEWAYS, ball_engine, ball_parameters, observe
from dashpot import compare
from dashpot.calibrate import Fit, Parameter, Problem, Trajectory, fit
from dashpot.calibrate.report import page
from dashpot.calibrate.report.drawings import autocorrelation, curve_figure
from dashpot.calibrate.report.making import median_and_worst
from dashpot.engine import Engine
from dashpot.materials import Material


class Page(HTMLParser):
    """What a page refers to, its text, and whether its tags close."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.words: list[str] = []
        self.open: list[str] = []
        self.descriptions: list[str] = []
        self.feed(text)
        self.text = " ".join(" ".join(self.words).split())

    def handle_starttag(self, tag, attrs):
        self.addresses += [value for name, value in attrs if name in ("src", "href", "data")]
        if tag == "img":
            self.descriptions.append(dict(attrs).get("alt") or "")
        if tag not in ("meta", "img", "br", "link"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] != "style":
            self.words.append(data)

    def figures(self, kind: str) -> list[bytes]:
        start = f"data:image/{kind};base64,"
        return [
            base64.b64decode(a.removeprefix(start)) for a in self.addresses if a.startswith(start)
        ]


@pytest.fixture(scope="module")
def problem():
    engine = ball_engine()
    rng = np.random.default_rng(8)
    throws = [
        observe(engine, velocity, noise=rng, name=f"throw {i}")
        for i, velocity in enumerate((SIDEWAYS, [0.5, 0, 0, 0, 0, 0], [0.2, 0.7, 0, 0, 0, 1]))
    ]
    return Problem(engine, ball_parameters(), throws, 1e-4, 1e-3, initial_state="pose_and_velocity")


@pytest.fixture(scope="module")
def fitted(problem):
    return fit(problem, starts=0, seed=5)


@pytest.fixture(scope="module")
def beside(problem):
    model = mujoco.MjModel.from_xml_string(BALL.replace("<geom ", '<geom solref="-5e3 -50" '))
    friction = Parameter.model(
        "geom_friction", ["ball", "floor"], index=0, start=0.4, bounds=(0.01, 2.0)
    )
    return fit(replace(problem, system=model, parameters=[friction]), starts=0, max_evaluations=100)


@pytest.fixture(scope="module")
def written(fitted, beside, tmp_path_factory):
    rng = np.random.default_rng(1)
    unseen = [observe(ball_engine(), [-0.6, 0.1, 0, 0, 0, 0], noise=rng, name="unseen throw")]
    file = tmp_path_factory.mktemp("report") / "ball.html"
    fitted.report(file, held_out=unseen, head=0.05, beside={"MuJoCo": beside}, title="A <ball>")
    return Page(file.read_text(encoding="utf-8"))


def test_a_report_refers_to_nothing_outside(written):
    assert written.addresses
    for address in written.addresses:
        assert address.startswith("data:image/")
    for drawing in written.figures("svg+xml"):
        root = ElementTree.fromstring(drawing)
        for element in root.iter():
            for name, value in element.attrib.items():
                if name.endswith("href"):
                    assert value.startswith(("#", "data:"))
                assert "url(" not in value or "url(#" in value
                assert not value.startswith(("http:", "https:", "//"))


def test_a_report_is_well_formed(written):
    assert written.open == []
    assert "A <ball>" in written.text


def test_each_picture_of_a_report_is_told_in_words_of_its_own(written):
    assert len(written.descriptions) > 5
    assert all(len(text.split()) > 1 for text in written.descriptions)
    assert len(set(written.descriptions)) == len(written.descriptions)


def test_a_report_says_what_the_fit_says(fitted, written):
    for estimate in fitted.estimates:
        assert estimate.statement in written.text
        assert estimate.name.replace("_", " ") in written.text
    for text in ("N/m", "N s/m", "95% interval", "throw 0", "throw 1", "throw 2", "unseen throw"):
        assert text in written.text
    made = fitted.made
    for text in (made.dashpot, made.mujoco, made.model, made.date, f"seed {made.seed}"):
        assert str(text) in written.text
    assert made.seed == 5
    assert re.fullmatch(r"[0-9a-f]{64}", made.model)
    assert "MuJoCo" in written.text


def test_a_report_has_a_figure_for_each_trajectory(written):
    # Three throws and one unseen; profiles, the fit's plot, residuals and their correlation.
    assert len(written.figures("svg+xml")) == 4 + 4


def test_the_median_and_the_worst_trajectory_move(fitted, written):
    clips = [Image.open(io.BytesIO(gif)) for gif in written.figures("gif")]
    assert [clip.n_frames for clip in clips] == [40, 40]
    shown = fitted.record().trajectories
    sizes = [s.size for s in shown]
    median, worst = median_and_worst(shown)
    assert sizes[worst] == max(sizes)
    assert sizes[median] == np.median(sizes)
    assert [clip.trajectory for clip in fitted.record().clips] == [
        shown[median].name,
        shown[worst].name,
    ]


def test_outlines_are_where_the_ball_is(fitted):
    """Of a sphere every outline is a circle about its centre, whichever side it is seen from."""
    (clip, *_) = fitted.record().clips
    for outlines in (*clip.simulated, *clip.measured):
        centre = outlines.mean(axis=1, keepdims=True)
        radius = np.linalg.norm(outlines - centre, axis=-1)
        np.testing.assert_allclose(radius, 0.1, atol=0.006)
    # Noise of 0.1 mm is between both; outlines of points that turn are not quite round.
    np.testing.assert_allclose(
        clip.simulated[0].mean(axis=1), clip.measured[0].mean(axis=1), atol=2e-3
    )


def test_residuals_are_those_of_the_fit(fitted):
    for shown, weighted in zip(fitted.record().trajectories, fitted.residuals, strict=True):
        rows = np.stack([residual.weighted for residual in shown.residuals], axis=1)
        np.testing.assert_allclose(rows, weighted[:, 0], atol=1e-9)


def test_bands_are_as_wide_as_what_the_fit_leaves_open(fitted):
    """Of n numbers p unknowns are fitted to, simulations vary by sigma sqrt(p / n) on average."""
    for shown in fitted.record().trajectories:
        variance = []
        for curve in shown.curves:
            assert np.abs(curve.simulated - curve.measured).max() < 6 * curve.sigma
            if curve.unit == "m":
                variance.append(np.mean(curve.spread**2) / curve.sigma**2)
        # Half of the twelve numbers of a start, and some of the three parameters of all.
        assert 6 / 120 / 2 < np.mean(variance) < 2 * 9 / 120


def test_what_a_window_leaves_out_is_marked(problem):
    """Curves go on beyond it, residuals do not."""
    shorter = replace(problem.with_window(0.2), rotation_sigma=math.inf)
    shorter = fit(shorter, starts=0, max_evaluations=60)
    for shown in shorter.record().trajectories:
        assert shown.window == 0.2
        for curve, residual in zip(shown.curves, shown.residuals, strict=True):
            assert np.isfinite(curve.simulated).sum() == 40
            assert np.isfinite(residual.weighted).sum() == 21
    axes = curve_figure(shown, {}, "dashpot", {"dashpot": "#0072b2"}).axes[0]
    assert "beyond the window" in axes.get_legend_handles_labels()[1]


def test_profiles_are_parabolas_at_the_estimate(fitted):
    """Of a linear model the cost rises by t^2 at t standard errors, the others refitted."""
    profiles = {profile.name: profile for profile in fitted.record().profiles}
    assert set(profiles) == set(fitted.values)
    for name, profile in profiles.items():
        assert np.median(profile.value) == pytest.approx(fitted.values[name])
        expected = np.array([9.0, 4.0, 1.0, 0.25, 0.0, 0.25, 1.0, 4.0, 9.0])
        np.testing.assert_allclose(profile.rise, expected, rtol=0.35, atol=0.05)


def test_profiles_without_noise_are_told_in_standard_errors():
    """Their rise over a variance of nothing would be beyond all axes."""
    throw = observe(ball_engine(), SIDEWAYS)
    problem = Problem(ball_engine(), ball_parameters()[:1], [throw], 1e-4, 1e-3)
    found = fit(replace(problem, system=ball_engine(damping=20.0)), starts=0)
    assert found.residual_variance < 1e-6
    (profile,) = found.record().profiles
    inner = [2, 3, 4, 5, 6]
    np.testing.assert_allclose(profile.rise[inner], [1.0, 0.25, 0.0, 0.25, 1.0], atol=0.1)


def test_bands_have_the_noise_that_was_estimated(problem, tmp_path):
    """Stated ten times too large, of a tenth of a millimetre."""
    loud = replace(
        problem,
        trajectories=problem.trajectories[:2],
        position_sigma=1e-3,
        rotation_sigma=math.inf,
        noise="estimate",
    )
    found = fit(loud, starts=0)
    loaded = Fit.load(found.save(tmp_path / "f.json"))
    for each in (found, loaded):
        assert each.record().noise == "estimated"
        assert repr(each.channels) == repr(found.channels)
        assert [c.channel for c in each.channels if c.count] == ["position"]
        for shown in each.record().trajectories:
            for curve in shown.curves:
                assert curve.sigma == pytest.approx(1e-4, rel=0.15)


def test_a_loaded_fit_writes_the_same_report(fitted, undrawn, tmp_path):
    loaded = Fit.load(fitted.save(tmp_path / "ball.json"))
    fitted.report(tmp_path / "own.html")
    loaded.report(tmp_path / "loaded.html")
    assert (tmp_path / "own.html").read_bytes() == (tmp_path / "loaded.html").read_bytes()


def test_many_trajectories_are_shown_from_the_worst_to_the_best(fitted, monkeypatch):
    monkeypatch.setattr(page, "_MOST_SHOWN", 2)
    order = sorted(fitted.record().trajectories, key=lambda shown: shown.size)
    assert "2 of 3 trajectories are shown" in page._note(order)
    assert [item.name for item in page._chosen(order)] == [order[-1].name, order[0].name]


@pytest.mark.parametrize("correlation", [-0.6, 0.0, 0.8])
def test_autocorrelation_is_that_of_the_process(correlation):
    """Of e_k = a e_(k-1) + noise it is a^lag, frames that were lost left out."""
    rng = np.random.default_rng(3)
    series = []
    for _ in range(4):
        values = np.zeros(4000)
        for k in range(1, len(values)):
            values[k] = correlation * values[k - 1] + rng.normal()
        frame = np.flatnonzero(rng.random(len(values)) < 0.7)
        values = np.where(rng.random(len(values)) < 0.1, np.nan, values)
        series.append(((frame - frame[0]).astype(float), values[frame]))
    found, deviation = autocorrelation(series)
    lags = np.arange(1, len(found) + 1)
    np.testing.assert_allclose(found, correlation**lags, atol=0.06)
    pairs = 4 * 4000 * (0.7 * 0.9) ** 2
    np.testing.assert_allclose(deviation, 1 / np.sqrt(pairs), rtol=0.1)


def test_sensors_have_their_units_and_their_bands(undrawn, tmp_path):
    """A carriage on a rail against a pad: force in newtons, nothing of poses."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody>
        <geom name="pad" type="box" size=".05 .2 .2" pos=".2 0 0"/>
        <body name="cart"><joint name="rail" type="slide" axis="1 0 0"/>
        <geom name="cart" type="box" size=".1 .1 .1" mass=".5"/><site name="load" pos=".1 0 0"
          type="box" size=".02 .11 .11"/></body>
        </worldbody><sensor><touch name="load" site="load"/><jointpos name="place" joint="rail"/>
        </sensor></mujoco>"""
    )
    engine = Engine(model)
    engine.set_pair_material("cart", "pad", Material(80.0, damping=1.0))
    rng, data = np.random.default_rng(2), engine.make_data()
    data.qvel[0] = 0.4
    rows = []
    for _ in range(60):
        rows.append(data.sensordata.copy())
        engine.step(data, 5)
    readings = np.array(rows) + rng.normal(size=(60, 2)) * [0.02, 1e-4]
    time = 0.01 * np.arange(60)
    run = Trajectory.of_sensors(
        "run", time, {"load": readings[:, 0], "place": readings[:, 1]}, initial_qvel=[0.4]
    )
    stiffness = Parameter.pair("cart", "pad", "stiffness", start=60.0, bounds=(10.0, 1e3))
    problem = Problem(
        engine, [stiffness], [run], np.inf, np.inf, sensor_sigma={"load": 0.02, "place": 1e-4}
    )
    found = fit(problem, starts=0, max_evaluations=40)
    (shown,) = found.record().trajectories
    assert [(c.name, c.unit) for c in shown.curves] == [("load", "N"), ("place", "m")]
    (clip,) = found.record().clips
    assert clip.label == "x"
    assert not clip.measured
    found.report(tmp_path / "cart.html")
    text = Page((tmp_path / "cart.html").read_text()).text
    assert "0.02 N" in text


@pytest.fixture(scope="module")
def bounced():
    """Two balls dropped beside a late microphone, each of a restitution of its own."""
    model = mujoco.MjModel.from_xml_string(BALL)
    engine = Engine(model)
    engine.set_pair_material("ball", "floor", Material(1e6, restitution=0.7))
    throws = []
    for name, restitution in (("dull", 0.6), ("lively", 0.8)):
        speed = math.sqrt(2 * 9.81 * 0.1)
        times = np.cumsum([speed / 9.81, *(2 * speed / 9.81 * restitution**k for k in (1, 2, 3))])
        throws.append(
            Trajectory.of_events(
                name,
                {"impact": times},
                bodies="body",
                scalars={"apex_height": 0.1 + 0.1 * restitution ** (2 * np.arange(1, 4))},
                initial_qpos=[0, 0, 0.2, 1, 0, 0, 0],
                initial_qvel=np.zeros(6),
            )
        )
    parameters = [
        Parameter.pair(
            "ball", "floor", "restitution", start=0.7, bounds=(0.05, 0.99), per="trajectory"
        ),
        Parameter.delay("impact", bounds=(-0.01, 0.01)),
    ]
    problem = Problem(
        engine,
        parameters,
        throws,
        event_sigma={"impact": 1e-3},
        scalar_sigma={"apex_height": 1e-3},
    )
    return fit(problem, starts=0, max_evaluations=100)


def test_events_and_scalars_are_shown_by_their_numbers(bounced, undrawn, tmp_path):
    for shown in bounced.record().trajectories:
        curves = {curve.name: curve for curve in shown.curves}
        assert set(curves) == {"impact", "apex_height"}
        assert (curves["impact"].unit, curves["apex_height"].unit) == ("s", "m")
        for curve in curves.values():
            assert curve.axis == "number"
            np.testing.assert_array_equal(curve.place, 1 + np.arange(len(curve.place)))
            np.testing.assert_allclose(curve.simulated, curve.measured, atol=5e-3)
    assert bounced.record().units["delay of impact"] == "s"
    assert len(bounced.record().clips[0].time) == 40  # of two frames, between them
    bounced.report(tmp_path / "bounces.html")
    text = Page((tmp_path / "bounces.html").read_text()).text
    assert "restitution[lively]" in text


def test_the_trajectory_whose_values_count_is_named(bounced, tmp_path):
    loaded = Fit.load(bounced.save(tmp_path / "fit.json"))
    for each in (bounced, loaded):
        with pytest.raises(ValueError, match=r"'restitution' has a value for each .*'dull'"):
            each.write_mjcf(tmp_path / "x.xml", scene=BALL)
        with pytest.raises(ValueError, match="no trajectory is named 'none'; there are dull, live"):
            each.write_mjcf(tmp_path / "x.xml", scene=BALL, trajectory="none")
        written = each.write_mjcf(tmp_path / "x.xml", scene=BALL, trajectory="lively")
        engine = Engine(mujoco.MjModel.from_xml_path(str(written.path)))
        restitution = engine.pair_material("ball", "floor").restitution
        assert restitution == each.values["restitution[lively]"]
        assert "as recorders have them: delay of impact" in str(written)
        assert "restitution[lively] fitted" in str(written)


def test_other_things_than_fits_are_refused_beside(fitted, tmp_path):
    with pytest.raises(TypeError, match="beside must map names to fits"):
        fitted.report(tmp_path / "x.html", beside=[fitted])
    with pytest.raises(ValueError, match="give held_out too"):
        fitted.report(tmp_path / "x.html", head=0.1)
    assert not (tmp_path / "x.html").exists()


def test_without_jinja_the_extra_is_named(fitted, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(ImportError, match=r"dashpot\[report\]"):
        fitted.report(tmp_path / "x.html")
    comparison = compare.run("ball", duration=0.01, settings="dashpot")
    with pytest.raises(ImportError, match=r"dashpot\[report\]"):
        comparison.report(tmp_path / "x.html")


def test_a_comparison_writes_a_report(tmp_path):
    comparison = compare.run("ball", duration=0.3, settings=["dashpot", "elliptic"])
    found = Page(comparison.report(tmp_path / "c.html").read_text())
    assert found.open == []
    assert len(found.figures("svg+xml")) == 4
    assert all(address.startswith("data:") for address in found.addresses)
    for text in ("dashpot", "MuJoCo, elliptic cones", comparison.model, "settled mean [mm]"):
        assert text in found.text
