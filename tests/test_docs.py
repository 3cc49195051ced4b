"""Pages of the documentation: links lead to files, public names are in the reference.

`docs/check_code.py` runs the code of the pages; here examples of docstrings run.
"""

from __future__ import annotations

import ast
import doctest
import importlib
import inspect
import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import warp

import dashpot.data

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
PAGES = [page for page in PAGES if "tutorials" not in page.parts]
SCENES_PAGE = ROOT / "docs/reference/examples.md"


def name_of(page: Path) -> str:
    return page.relative_to(ROOT / "docs").as_posix()


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
