"""Calibration: what parameters of a model set, and what no two of them may."""

import pytest

from ball_throws import ball_engine, make_trajectory
from dashpot.calibrate import Parameter, Problem


def problem(*parameters):
    return Problem(ball_engine(), parameters, [make_trajectory()], 1e-3, 1e-2)


def of_model(attribute, name=None, start=2e-3, bounds=(1e-3, 1e-2), **options):
    return Parameter.model(attribute, "body", name=name, start=start, bounds=bounds, **options)


@pytest.mark.parametrize(
    ("attribute", "index", "message"),
    [
        ("body_mass", 5, "index 5 of body_mass is out of range: its rows have 1 column$"),
        ("body_mass", -1, "index -1 of body_mass is out of range: its rows have 1 column$"),
        (
            "body_inertia",
            (0, 3),
            "index 3 of body_inertia is out of range: its rows have 3 columns",
        ),
    ],
)
def test_an_index_that_rows_do_not_have_is_refused(attribute, index, message):
    with pytest.raises(ValueError, match=f"parameter 'm' = 0.002: {message}"):
        problem(of_model(attribute, "m", index=index))


def test_the_one_number_of_a_row_has_index_0():
    built = problem(of_model("body_mass", index=0)).build({"body_mass": 3e-3})
    assert built.model.body_mass.tolist() == [0.0, 3e-3]


@pytest.mark.parametrize(
    ("first", "second", "what"),
    [
        (("body_mass", None), ("body_mass", 0), "body_mass of 'body'"),
        (("body_inertia", None), ("body_inertia", 0), r"body_inertia of 'body'\[0\]"),
        (("body_inertia", (1, 2)), ("body_inertia", None), r"body_inertia of 'body'\[1\]"),
    ],
)
def test_parameters_whose_columns_overlap_are_refused(first, second, what):
    a, b = (of_model(attribute, name, index=index)
            for name, (attribute, index) in (("a", first), ("b", second)))  # fmt: skip
    with pytest.raises(ValueError, match=f"parameters 'a' and 'b' both set the {what}"):
        problem(a, b)


def test_parameters_of_different_columns_are_taken():
    parameters = [of_model("body_inertia", f"I{i}", index=i) for i in range(3)]
    built = problem(*parameters).build({"I0": 2e-3, "I1": 3e-3, "I2": 4e-3})
    assert built.model.body_inertia[1].tolist() == [2e-3, 3e-3, 4e-3]
