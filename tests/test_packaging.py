"""What is said in several files of the repository is the same in all, and README's code runs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import dashpot
from dashpot._mujoco_versions import SUPPORTED

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


def test_supported_versions_of_mujoco_are_the_same_everywhere() -> None:
    said = ", ".join(SUPPORTED[:-1]) + " and " + SUPPORTED[-1]
    for page in ("README.md", "docs/start.md", "docs/guides/versions.md"):
        assert said in " ".join(read(page).split()), page
    built_alone = only(r"mujoco==([0-9.]+)\.\*", read("pyproject.toml"))
    assert built_alone in SUPPORTED
    folders = re.findall(
        r"/([0-9.]+)/mujoco\b", only(r"DASHPOT_MUJOCO = (.+)", read("pyproject.toml"))
    )
    assert tuple(folders) == SUPPORTED


def test_system_packages_of_readme_are_those_ci_installs() -> None:
    readme = only(r"apt-get install -y (.+?) &&", read("README.md"))
    ci = only(r"^for package in (.+); do", read(".ci/run"))
    assert readme.split() == ci.split()


def test_formatters_are_the_same_in_ci_and_before_commits() -> None:
    hooks = read(".pre-commit-config.yaml")
    tools = read("pyproject.toml")
    for hook, tool in [("ruff-pre-commit", "ruff"), ("mirrors-clang-format", "clang-format")]:
        assert only(rf"/{hook}\n +rev: v(.+)", hooks) == only(rf'"{tool}==(.+)"', tools)


PAGES = (
    "README.md",
    "CHANGELOG.md",
    "benchmarks/README.md",
)
LINKS = [
    (page, link) for page in PAGES for link in re.findall(r"\]\((?!http)([^)]+)\)", read(page))
]


@pytest.mark.parametrize(("page", "link"), LINKS)
def test_pages_link_to_files_that_exist(page: str, link: str) -> None:
    assert ((ROOT / page).parent / link).exists()


def test_method_has_the_constants_of_the_source() -> None:
    method = read("docs/method.md")
    islands = read("cpp/include/dashpot/islands/islands.hpp")
    stiffness = read("cpp/include/dashpot/islands/row_stiffness.hpp")
    motion = read("cpp/include/dashpot/microsteps/lane_motion.hpp")

    def constant(name: str, source: str) -> float:
        return float(only(rf"{name} = ([0-9.e-]+);", source))

    assert float(only(r"\\theta = ([0-9.]+)", method)) == constant("kResolution", islands)
    assert int(only(r"n \\ge ([0-9]+)\$", method)) == constant("kMinimumMicrosteps", islands)
    longest = float(only(r"h\$ at most\n([0-9.]+) ms", method))
    assert longest == pytest.approx(1e3 * constant("kRigidMicrostep", stiffness))
    recovery = float(only(r"within ([0-9]+) ms", method.replace("\n", " ")))
    assert recovery == pytest.approx(1e3 * constant("kLeastRecoveryTime", motion))


def test_readme_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    # The others run in test_cli_tables.py and test_grinding_outputs.py.
    example, *_ = re.findall(r"```python\n(.*?)```", read("README.md"), re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(example, "README.md", "exec"), names)
    printed = capsys.readouterr().out
    assert "Energy(" in printed
    assert "[[9.81 0.   0.  ]]" in printed  # the ball has come to rest: its weight


def test_the_script_about_reports_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    script = "\n".join(re.findall(r"```python\n(.*?)```", read("docs/reports.md"), re.DOTALL))
    names: dict[str, Any] = {}
    exec(compile(script, "docs/reports.md", "exec"), names)
    for name, truth in {"stiffness": 1e4, "restitution": 0.8}.items():
        estimate = names["result"][name]
        assert estimate.lower <= truth <= estimate.upper
    assert str(names["same"]) == str(names["result"])
    assert (
        names["fitted"].pair_materials
        == names["result"].problem.build(names["result"].values).pair_materials
    )
    assert "As custom numerics" in capsys.readouterr().out
    written = {file.name for file in tmp_path.iterdir()}
    assert written == {"ball.html", "again.html", "ball.json", "ball.xml"}


def test_the_script_about_films_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    films, clusters = read("docs/recordings.md").split("## On a cluster")
    names: dict[str, Any] = {}
    exec(compile(only(r"```python\n([^`]*)```", films), "docs/recordings.md", "exec"), names)
    for name, truth in {"scale of image": 900.0, "tilt of image": 0.0}.items():
        estimate = names["result"][name]
        assert estimate.lower <= truth <= estimate.upper
    for script in re.findall(r"```python\n(.*?)```", clusters, re.DOTALL):
        compile(script, "docs/recordings.md", "exec")
