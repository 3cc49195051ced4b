"""Pages of the documentation: links lead to files, code runs, public names are in the reference."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
PAGES = [page for page in PAGES if "tutorials" not in page.parts]
# Run with assertions of their own in test_packaging.py.
ELSEWHERE = {"recordings.md", "reports.md"}


def name_of(page: Path) -> str:
    return page.relative_to(ROOT / "docs").as_posix()


def code_of(page: Path) -> str:
    text = page.read_text(encoding="utf-8")
    return "\n".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL))


def sentences_of(page: Path) -> Iterator[str]:
    """Yield the sentences of a page, of table cells too, without code, math and addresses."""
    text = page.read_text(encoding="utf-8")
    text = re.sub(r"^( *)```.*?^\1```$", "\n", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^(    |#).*$", "", text, flags=re.MULTILINE)  # code that is set in, headings
    text = re.sub(r"\$[^$\n]+\$|`[^`]*`", "X", text)
    text = re.sub(r"\]\([^)]*\)", "]", text)
    text = re.sub(r"^\s*([-*|:]|\d+\.) *", "\n\n", text, flags=re.MULTILINE)  # items, rows
    for block in re.split(r"\n\s*\n|\|", text):
        yield from re.split(r"(?<=[.!?])[)*\"]*\s+", block.strip())


WITH_CODE = [name_of(p) for p in PAGES if code_of(p) and name_of(p) not in ELSEWHERE]


@pytest.mark.parametrize("page", [name_of(page) for page in PAGES])
def test_pages_link_to_files_that_exist(page: str) -> None:
    path = ROOT / "docs" / page
    for link in re.findall(r"\]\((?!http)([^)#]+)", path.read_text(encoding="utf-8")):
        assert (path.parent / link).exists(), link


@pytest.mark.parametrize(
    "page", ["README.md", "CHANGELOG.md", *(f"docs/{name_of(p)}" for p in PAGES)]
)
def test_no_sentence_has_more_than_thirty_words(page: str) -> None:
    long = [s for s in sentences_of(ROOT / page) if len(re.findall(r"\S*\w\S*", s)) > 30]
    assert not long


@pytest.mark.parametrize("page", WITH_CODE)
def test_the_code_of_a_page_runs_as_one_script(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(compile(code_of(ROOT / "docs" / page), page, "exec"), names)
    if page == "guides/materials.md":
        # The sag that it prints beside its closed form, to what a second leaves of the landing.
        np.testing.assert_allclose(names["sag"], 0.5 * 9.81 / (4 * 2e4), rtol=1e-6)
    if page == "guides/results.md":
        np.testing.assert_allclose(names["force"][:3], names["contacts"].force[0])
    if page == "guides/calibrate.md":
        for quantity, truth in {"stiffness": 2e4, "restitution": 0.8}.items():
            estimate = names["result"][quantity]
            assert estimate.lower <= truth <= estimate.upper


@pytest.mark.parametrize("module", ["dashpot", "dashpot.calibrate", "dashpot.compare"])
def test_the_reference_has_every_public_name(module: str) -> None:
    reference = "".join(p.read_text(encoding="utf-8") for p in PAGES if "reference" in p.parts)
    submodules = {"calibrate", "compare", "data", "gymnasium", "law", "myosuite", "robosuite"}
    for name in importlib.import_module(module).__all__:
        if name.startswith("__") or name in submodules:
            continue
        assert re.search(rf"\b{name}\b", reference), name
