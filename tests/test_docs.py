"""Pages of the documentation: links lead to files, code runs, public names are in the reference."""

from __future__ import annotations

import ast
import contextlib
import doctest
import importlib
import inspect
import json
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import warp

import dashpot.data

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
PAGES = [page for page in PAGES if "tutorials" not in page.parts]
SCENES_PAGE = ROOT / "docs/reference/examples.md"
# Run with assertions of their own in test_packaging.py.
ELSEWHERE = {"recordings.md", "reports.md", "reference/examples.md"}


def name_of(page: Path) -> str:
    return page.relative_to(ROOT / "docs").as_posix()


def code_of(page: Path) -> str:
    text = page.read_text(encoding="utf-8")
    return "\n".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL))


BALL = """<mujoco><worldbody><body pos="0 0 1"><freejoint/><geom size=".1"/></body></worldbody>
</mujoco>"""


class ShownFrames:
    """Stands for ``mujoco.viewer``: a window that is closed after some frames."""

    def __init__(self, frames: int) -> None:
        self.frames = frames
        self.heights: list[float] = []

    @contextlib.contextmanager
    def launch_passive(self, model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[ShownFrames]:
        self.data = data
        yield self

    def is_running(self) -> bool:
        return len(self.heights) < self.frames

    @contextlib.contextmanager
    def lock(self) -> Iterator[None]:
        yield

    def sync(self) -> None:
        self.heights.append(float(self.data.qpos[2]))


def sentences_of(text: str) -> Iterator[str]:
    """Yield the sentences of a text, of table cells too, without code, math and addresses."""
    text = re.sub(r"^( *)```.*?^\1```$", "\n", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^(    |#).*$", "", text, flags=re.MULTILINE)  # code that is set in, headings
    text = re.sub(r"\$[^$\n]+\$|`[^`]*`", "X", text)
    text = re.sub(r"\]\([^)]*\)", "]", text)
    text = re.sub(r"^\s*([-*|:]|\d+\.) *", "\n\n", text, flags=re.MULTILINE)  # items, rows
    for block in re.split(r"\n\s*\n|\|", text):
        yield from re.split(r"(?<=[.!?])[)*\"]*\s+", block.strip())


NOTEBOOKS = [f"notebooks/{page.name}" for page in sorted((ROOT / "notebooks").glob("*.ipynb"))]
WITH_SENTENCES = [
    "README.md",
    "CHANGELOG.md",
    "benchmarks/README.md",
    *(f"docs/{name_of(page)}" for page in PAGES),
]
WITH_CODE = [name_of(p) for p in PAGES if code_of(p) and name_of(p) not in ELSEWHERE]


def anchors_of(page: Path) -> set[str]:
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", WITH_SENTENCES)
def test_pages_link_to_files_and_headings_that_exist(page: str) -> None:
    path = ROOT / page
    for link in re.findall(r"\]\(([^)\s]+)\)", path.read_text(encoding="utf-8")):
        if link.startswith("http"):
            assert re.fullmatch(r"https?://[\w-]+(\.[\w-]+)+(/\S*)?", link), link
            continue
        file, _, anchor = link.partition("#")
        target = path.parent / file if file else path
        assert target.exists(), link
        assert not anchor or anchor in anchors_of(target), link


@pytest.mark.parametrize("page", [*WITH_SENTENCES, *NOTEBOOKS])
def test_no_sentence_has_more_than_thirty_words(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    if page.endswith(".ipynb"):
        cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "markdown"]
        text = "\n\n".join("".join(cell["source"]) for cell in cells)
    long = [s for s in sentences_of(text) if len(re.findall(r"\S*\w\S*", s)) > 30]
    assert not long


@pytest.mark.parametrize("page", WITH_CODE)
def test_the_code_of_a_page_runs_as_one_script(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    if page == "guides/viewer.md":
        (tmp_path / "scene.xml").write_text(BALL, encoding="utf-8")
        shown = ShownFrames(frames=25)
        monkeypatch.setitem(sys.modules, "mujoco.viewer", shown)
        monkeypatch.setattr(mujoco, "viewer", shown, raising=False)
    exec(compile(code_of(ROOT / "docs" / page), page, "exec"), names)
    if page == "guides/viewer.md":
        # A step a frame: a ball that falls freely from 1 m.
        times = 0.002 * np.arange(1, 26)
        np.testing.assert_allclose(shown.heights, 1.0 - 9.81 * times**2 / 2, rtol=1e-12)
    if page == "guides/materials.md":
        # The sag that it prints beside its closed form, to what a second leaves of the landing.
        np.testing.assert_allclose(names["sag"], 0.5 * 9.81 / (4 * 2e4), rtol=1e-6)
    if page == "guides/results.md":
        np.testing.assert_allclose(names["force"][:3], names["contacts"].force[0])
    if page == "guides/calibrate.md":
        for quantity, truth in {"stiffness": 2e4, "restitution": 0.8}.items():
            estimate = names["result"][quantity]
            assert estimate.lower <= truth <= estimate.upper


# Modules, pages of their names, what they need, and the scenes that their examples go on from.
MODULES = {
    "dashpot": ("engine", "", "scene"),
    "dashpot.calibrate": ("calibrate", "", "scene calibration"),
    "dashpot.calibrate.tosses": ("calibrate", "", "scene calibration tosses"),
    "dashpot.compare": ("compare", "", "scene"),
    "dashpot.data": ("calibrate", "", "scene tosses"),
    "dashpot.dm_control": ("environments", "dm_control", "scene"),
    "dashpot.grinding": ("grinding", "mink", "scene grinding"),
    "dashpot.gymnasium": ("environments", "gymnasium", "scene"),
    "dashpot.materials": ("materials", "", "scene"),
    "dashpot.law": ("law", "", "scene"),
    "dashpot.myosuite": ("environments", "myosuite", "scene"),
    "dashpot.robosuite": ("environments", "robosuite", "scene"),
    "dashpot.warp": ("warp", "mujoco_warp", "scene warp"),
}
SCENES = re.findall(r"```python\n(.*?)```", SCENES_PAGE.read_text(encoding="utf-8"), re.DOTALL)
SCENES = dict(zip(("scene", "calibration", "grinding", "warp", "tosses"), SCENES, strict=True))


def public_objects(module: str) -> dict[str, Any]:
    """Return the public classes and functions of a module by name."""
    named = importlib.import_module(module)
    found = {}
    for name in getattr(named, "__all__", ["with_dashpot"]):
        value = getattr(named, name)
        if inspect.isclass(value) or inspect.isfunction(value):
            found[name] = value
    return found


@cache
def scene(names: str) -> dict[str, Any]:
    """Return the names that the examples of a module begin with."""
    made: dict[str, Any] = {}
    for name in names.split():
        exec(SCENES[name], made)
    return made


@pytest.mark.parametrize("module", MODULES)
def test_the_reference_has_every_public_name(module: str) -> None:
    page, package, _ = MODULES[module]
    pytest.importorskip(package or "dashpot")
    text = (ROOT / f"docs/reference/{page}.md").read_text(encoding="utf-8")
    if module == "dashpot":  # on several pages
        text = "".join(p.read_text(encoding="utf-8") for p in PAGES if "reference" in p.parts)
    for name, value in public_objects(module).items():
        whole = value.__module__ if module == "dashpot.materials" else module
        assert f"automodule:: {whole}\n" in text or re.search(rf":: {name}\n", text), name


def docstrings(module: str) -> dict[str, str]:
    """Return the docstrings of a module's public names, and those of members of its classes."""
    found = {}
    for name, value in public_objects(module).items():
        found[name] = inspect.getdoc(value) or ""
        for member in dir(value) if inspect.isclass(value) else ():
            known = inspect.getattr_static(value, member)
            told = isinstance(known, property) or inspect.isroutine(getattr(value, member, None))
            if told and not member.startswith("_"):
                found[f"{name}.{member}"] = inspect.getdoc(getattr(value, member)) or ""
                if isinstance(known, property):
                    found[f"{name}.{member}"] = inspect.getdoc(known) or ""
    return found


def messages_of(file: Path) -> Iterator[str]:
    """Yield what exceptions and warnings of a file say, and the help of options; X for values."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Raise) or (
            isinstance(node, ast.Call)
            and ast.unparse(node.func).endswith(("warn", "add_argument", "add_parser"))
        ):
            for part in ast.walk(node):
                if isinstance(part, ast.JoinedStr):
                    pieces = [p.value if isinstance(p, ast.Constant) else "X" for p in part.values]
                    yield "".join(pieces)
                elif isinstance(part, ast.Constant) and isinstance(part.value, str):
                    yield part.value


def test_no_sentence_of_a_message_has_more_than_thirty_words() -> None:
    for file in (ROOT / "python/dashpot").rglob("*.py"):
        for message in messages_of(file):
            for sentence in sentences_of(message):
                assert len(re.findall(r"\S*\w\S*", sentence)) <= 30, f"{file.name}: {sentence}"


CPP_TOKEN = re.compile(
    r"""//[^\n]*|/\*.*?\*/|R"(\w*)\(.*?\)\1"|"(?:[^"\\\n]|\\.)*"|'(?:[^'\\\n]|\\.)*[']""", re.DOTALL
)


def strings_of_cpp(code: str) -> Iterator[str]:
    """Yield the strings of C++, adjacent ones as one, and sums of them with X for other terms."""
    code = re.sub(r"^\s*#include.*$", "", code, flags=re.MULTILINE)
    code = CPP_TOKEN.sub(lambda t: "" if t[0].startswith("/") else t[0], code)
    said, end = "", 0
    for token in CPP_TOKEN.finditer(code):
        if token[0].startswith("'"):
            continue
        literal = token[0][1:-1] if token[1] is None else token[0].split("(", 1)[1][:-2]
        literal = literal.replace(r"\n", "\n").replace(r"\"", '"')
        between = code[end : token.start()]
        if not between.strip():
            said += literal
        elif re.fullmatch(r"\s*\+[^;]*\+\s*", between):
            said += "X" + literal
        else:
            yield said
            said = literal
        end = token.end()
    yield said


def test_strings_of_cpp_are_put_together() -> None:
    code = """#include "a.hpp"
      // "no string"
      throw Error("one " /* "nor this" */ "two" + std::to_string(n) + " three \\"x\\"");
      f('"', R"(raw)", "last");"""
    assert list(strings_of_cpp(code)) == ["", 'one twoX three "x"', "raw", "last"]


def test_no_sentence_of_a_string_in_cpp_has_more_than_thirty_words() -> None:
    found = 0
    for file in sorted((ROOT / "cpp").rglob("*.[ch]pp")):
        if "tests" in file.relative_to(ROOT).parts:
            continue
        for message in strings_of_cpp(file.read_text(encoding="utf-8")):
            found += 1
            for sentence in sentences_of(message):
                assert len(re.findall(r"\S*\w\S*", sentence)) <= 30, f"{file.name}: {sentence}"
    assert found > 500


@pytest.mark.parametrize("module", MODULES)
def test_no_sentence_of_a_docstring_has_more_than_thirty_words(module: str) -> None:
    pytest.importorskip(MODULES[module][1] or "dashpot")
    for name, text in docstrings(module).items():
        text = re.sub(r"^ *(>>>|\.\.\.).*$|:math:`[^`]*`", "", text, flags=re.MULTILINE)
        # Names of parameters, titles of sections and items of lists end what stands before.
        text = re.sub(r"^( *)\S.*\n(?=\1    |\1---)|^ *\* ", "\n\n", text, flags=re.MULTILINE)
        text = re.sub(r"^ +", "", text.replace("``", "`"), flags=re.MULTILINE)
        long = [s for s in sentences_of(text) if len(re.findall(r"\S*\w\S*", s)) > 30]
        assert not long, name


@pytest.mark.parametrize("module", MODULES)
def test_every_public_class_and_function_has_an_example_that_runs(
    module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, package, scenes = MODULES[module]
    pytest.importorskip(package or "dashpot")
    monkeypatch.chdir(tmp_path)
    if "tosses" in scenes:
        try:
            dashpot.data.find_cube_tosses()
        except FileNotFoundError:
            pytest.skip("no cube tosses: set DASHPOT_DATA")
    monkeypatch.setattr(warp.config, "log_level", warp.LOG_WARNING)  # no word on kernels
    runner = doctest.DocTestRunner(verbose=False, optionflags=doctest.ELLIPSIS)
    for name, text in docstrings(module).items():
        assert ">>>" in text or "." in name, name
        names = dict(scene(scenes))
        test = doctest.DocTestParser().get_doctest(text, names, name, module, None)
        report: list[str] = []
        assert not runner.run(test, out=report.append).failed, "".join(report)
