"""Messages of calibration that name arguments of Python, in the words of the command line."""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from dashpot.calibrate import Fit

# What is said by an argument of Python, and what stands for it beside a table and in a problem
# file. What neither has is said to be Python's.
_WORDS = (
    (r"max_evaluations = (\d+)", r"--max-evaluations \1", r"max_evaluations = \1 in [fit]"),
    (r"\(max_evaluations\)", "(--max-evaluations)", "(max_evaluations in [fit])"),
    (r"starts=(\d+)", r"--starts \1", r"starts = \1 in [fit]"),
    (r"windows=\.\.\.", "--windows SECONDS,...", "windows = [SECONDS, ...] in [fit]"),
    (
        r'Parameter\.(delay|gain|offset)\("([^"]*)"\)',
        r"--fit \1:\2=LOWER..UPPER",
        r'parameters of kind = "\1", channel = "\2"',
    ),
    (
        r"Parameter\.scale\(\)",
        "--fit scale:poses=LOWER..UPPER",
        'parameters of kind = "scale"',
    ),
    (r"\bsampling=\{", "in Python: sampling={", "in Python: sampling={"),
    (r"frames='even'", "--frames even", 'frames = "even"'),
    (r"^(.*)rate is of even frames", r"\1--rate is of even frames", r"\1rate is of even frames"),
    (
        r"Trajectory\.from_csv\(unit=\{'time': 'ms', 'z': 'cm'\}\) converts such files",
        "--unit time=ms,z=cm converts them",
        'unit = {time = "ms", z = "cm"} converts them',
    ),
    (
        r"give time=spacing \* numpy\.arange\(n\)",
        "write even times into the file",
        "write even times into the file",
    ),
    (
        r"where a file has several runs, run names the column that tells them apart",
        "where a file has several runs, --columns run=COLUMN tells them apart",
        "a file of a problem has one run",
    ),
    (
        r"one of the model or an ImagePlane",
        "--camera of the model, or --image",
        "camera = one of the model, or a table of a picture",
    ),
    (
        r"let one parameter set both geoms \(Parameter\.material\(\(geom1, geom2\), \.\.\.\)\) or "
        r"the pair \(Parameter\.pair\)",
        "let one parameter set the pair (--fit pair:GEOM,GEOM:QUANTITY)",
        'let one parameter set the pair (kind = "pair")',
    ),
    (
        r"give the geom a material first \(Engine\.set_material\([^)]*\)\)",
        "give the geom a material first (--material GEOM:stiffness=...)",
        "give the geom a material first ([materials.GEOM])",
    ),
    (
        r"give initial_qpos_sigma=inf and initial_qvel_sigma=inf",
        "give the trajectory, in Python, initial_qpos_sigma=inf and initial_qvel_sigma=inf",
        "give the .npz file initial_qpos_sigma = inf and initial_qvel_sigma = inf",
    ),
    (
        r"initial_state='(\w+)'",
        r"in Python initial_state='\1'",
        r'initial_state = "\1"',
    ),
    (r"Engine\(impact='cut'\)", "in Python Engine(impact='cut')", "in Python Engine(impact='cut')"),
)


def in_words_of(problem: str, text: str) -> str:
    """Return a message as it is said to who gave `problem`, a table (.csv) or a problem file."""
    of_table = problem.endswith(".csv")
    for python, table, file in _WORDS:
        text = re.sub(python, table if of_table else file, text, flags=re.DOTALL)
    return text


def fit_in_words_of(problem: str, fit: Fit) -> Fit:
    """Return a fit whose messages are said so."""
    return replace(
        fit,
        message=in_words_of(problem, fit.message),
        estimates=tuple(
            replace(e, statement=in_words_of(problem, e.statement)) for e in fit.estimates
        ),
        explanations=tuple(
            replace(e, remedy=in_words_of(problem, e.remedy)) for e in fit.explanations
        ),
    )


@contextmanager
def said_in_words_of(problem: str) -> Iterator[None]:
    """Say warnings in a line of standard error, and errors, in the words of the command line."""

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        print(f"dashpot: warning: {in_words_of(problem, str(message))}", file=sys.stderr)

    shown = warnings.showwarning
    warnings.showwarning = show
    try:
        yield
    except (ValueError, TypeError) as error:
        told: Sequence[object] = error.args
        if told and isinstance(told[0], str):
            error.args = (in_words_of(problem, told[0]), *told[1:])
        raise
    finally:
        warnings.showwarning = shown
