"""What is said in several files of the repository is the same in all, and README's code runs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import dashpot
from dashpot import _core

ROOT = Path(__file__).parent.parent


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def only(pattern: str, text: str) -> str:
    """Return what the pattern's group finds, which must be one and the same everywhere."""
    found = set(re.findall(pattern, text, re.MULTILINE))
    assert len(found) == 1, (pattern, found)
    return found.pop()


def test_version_is_the_same_everywhere() -> None:
    version = only(r'^version = "(.+)"', read("pyproject.toml"))
    assert only(r"^version: (.+)", read("CITATION.cff")) == version
    assert dashpot.__version__ == version


def test_mujoco_is_pinned_to_one_version() -> None:
    pins = read("pyproject.toml") + read("README.md")
    assert only(r"mujoco==([0-9.]+)", pins) == _core.__mujoco_version__


def test_system_packages_of_readme_are_those_ci_installs() -> None:
    readme = only(r"apt-get install -y (.+?) &&", read("README.md"))
    ci = only(r"^for package in (.+); do", read(".ci/run"))
    assert readme.split() == ci.split()


def test_formatters_are_the_same_in_ci_and_before_commits() -> None:
    hooks = read(".pre-commit-config.yaml")
    tools = read("pyproject.toml")
    for hook, tool in [("ruff-pre-commit", "ruff"), ("mirrors-clang-format", "clang-format")]:
        assert only(rf"/{hook}\n +rev: v(.+)", hooks) == only(rf'"{tool}==(.+)"', tools)


@pytest.mark.parametrize("link", re.findall(r"\]\((?!http)([^)]+)\)", read("README.md")))
def test_readme_links_to_files_that_exist(link: str) -> None:
    assert (ROOT / link).exists()


def test_readme_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (example,) = re.findall(r"```python\n(.*?)```", read("README.md"), re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(example, "README.md", "exec"), names)
    printed = capsys.readouterr().out
    assert "Energy(" in printed
    assert "[[9.81 0.   0.  ]]" in printed  # the ball has come to rest: its weight
