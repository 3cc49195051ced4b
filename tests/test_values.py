"""What calls return are values: copied, pickled, compared, and shown whole or in brief."""

import copy
import pickle

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot import compare
from dashpot.tables import table_html, table_text

XML = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="5 5 .1"/>
  <body pos="0 0 .105"><freejoint/><geom name="ball" size=".1" mass="1"/></body>
  <body pos=".3 0 .105"><freejoint/><geom name="other" size=".1" mass="1"/></body>
</worldbody></mujoco>"""


@pytest.fixture(scope="module")
def results():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(XML))
    engine.set_material("ball", dashpot.Material(1e4, restitution=0.5))
    data = engine.make_data()
    stats = engine.step(data, 100)
    return {
        "StepStats": stats,
        "Contacts": engine.contacts(data),
        "Energy": engine.energy(data),
        "Report": engine.report(),
        "Material": engine.material("ball"),
        "ContactMaterial": engine.contact_material("ball", "floor"),
        "Distance": dashpot.distance(engine, data, "ball", "other"),
        "TimeOfImpact": dashpot.time_of_impact(engine, data, "ball", "other", horizon=0.1),
        "Closest": dashpot.closest(engine, data, radius=0.5),
    }


NAMES = (
    "StepStats", "Contacts", "Energy", "Report", "Material", "ContactMaterial", "Distance",
    "TimeOfImpact", "Closest",
)  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "again",
    [copy.copy, copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))],
    ids=["copy", "deepcopy", "pickle"],
)
def test_results_can_be_copied_and_pickled(results, name, again):
    """As worker processes and caches do."""
    value = results[name]
    copied = again(value)
    assert type(copied) is type(value)
    assert repr(copied) == repr(value)


@pytest.mark.parametrize("name", NAMES)
def test_results_can_be_compared_and_be_keys(results, name):
    """Those with arrays are equal to themselves alone, as arrays have no one truth."""
    value = results[name]
    assert value == value
    assert value != 3
    assert {value: name}[value] == name
    scalars = name in ("StepStats", "Energy", "Report", "Material", "ContactMaterial")
    assert (copy.deepcopy(value) == value) is scalars
    if scalars:
        assert hash(copy.deepcopy(value)) == hash(value)


def test_step_statistics_differ_where_steps_did(results):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(XML))
    assert engine.step(engine.make_data()) != results["StepStats"]


def test_every_statistic_of_a_step_is_explained():
    for name in dir(dashpot.StepStats):
        if not name.startswith("_"):
            assert getattr(dashpot.StepStats, name).__doc__.endswith("."), name


def test_a_report_shows_its_lines_in_a_session(results):
    assert repr(results["Report"]) == str(results["Report"])
    assert "option cone" in repr(results["Report"])


def test_tables_are_shown_in_notebooks():
    comparison = compare.run("ball", duration=0.05, settings=["dashpot", "mujoco-default"])
    shown = comparison._repr_html_()
    assert shown.startswith("<table")
    assert shown.count("<tr>") == 3  # of the headings and two settings
    assert ">mujoco-default</td>" in shown
    assert ">settled mean [mm]</th>" in shown


def test_tables_are_text_where_rich_sees_a_notebook(monkeypatch, capsys):
    """There rich's consoles display what they print, whatever their file."""
    from rich.table import Table

    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    table = Table("a column")
    assert "a column" in table_text(table)
    assert "a column" in table_html(table)
    assert capsys.readouterr().out == ""


def test_tables_in_notebooks_are_escaped():
    from rich.table import Table

    table = Table()
    table.add_column("a <b> & c")
    assert "a &lt;b&gt; &amp; c" in table_html(table)


def test_numbers_of_a_table_are_short():
    """Three digits, or two where that takes more than seven characters."""
    from dashpot.compare.result import _number

    for value, text in (
        (0.0, "0"), (1.5314e-4, "0.00015"), (1.5e-5, "1.5e-05"), (12345.0, "1.2e+04"),
        (0.00962, "0.00962"), (28.12, "28.1"), (np.nan, "-"),
    ):  # fmt: skip
        assert _number(value) == text
