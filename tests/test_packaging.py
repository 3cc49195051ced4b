"""What is said in several files of the repository is the same in all, and README's code runs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import dashpot
from dashpot._mujoco_versions import SUPPORTED
from dashpot.calibrate import saved
from dashpot.calibrate.data import csv_file
from dashpot.cli import cell_file, problem_file
from dashpot.data import archive, torch_file

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
    released = only(rf"^## \[{re.escape(version)}\] - (.+)", read("CHANGELOG.md"))
    assert only(r'^date-released: "(.+)"', read("CITATION.cff")) == released


def test_bounds_of_what_is_parsed_are_those_of_the_readers() -> None:
    """SECURITY.md says them in bytes of its own units."""
    told = read("SECURITY.md")
    bounds = {
        "256 MiB of arrays": archive.MAX_BYTES == 256 << 20,
        "1,000 arrays": archive._MAX_ARRAYS == 1000,
        "10 MB; unknown keys": problem_file._MAX_BYTES == 10_000_000,
        "10 MB; 256 MiB": (cell_file._MAX_BYTES, cell_file._MAX_HEIGHT_BYTES)
        == (10_000_000, 256 << 20),
        "400 MB": saved._MOST_BYTES == 400_000_000,
        "100 MB, 200 opcodes": (torch_file._MAX_BYTES, torch_file._MAX_OPCODES)
        == (100_000_000, 200),
        "first 50 lines": csv_file._MOST_BEFORE == 50,
        "10,000 runs": csv_file._MOST_RUNS == 10_000,
    }
    for text, holds in bounds.items():
        assert holds, text
        assert text in told


def test_no_file_is_executed() -> None:
    """Neither pickles of files nor expressions: only workers unpickle, what their owner sent."""
    for path in (ROOT / "python/dashpot").rglob("*.py"):
        source = path.read_text(encoding="utf-8")
        if path.name == "video.py":  # asks a Python of its own whether there is a GL
            source = source.replace("import subprocess", "")
        assert not re.search(r"\b(?:eval|exec)\(|\bimport subprocess|\byaml\.|os\.system", source)
        for call in re.findall(r"np\.load\(.*\)", source):
            assert "allow_pickle=False" in call, path
        assert "pickle.load" not in source or path.name == "workers.py", path
    for template in (ROOT / "python/dashpot").rglob("*.j2"):
        assert "<script" not in template.read_text(encoding="utf-8")


def test_contributing_is_one_page() -> None:
    assert len(read("CONTRIBUTING.md").splitlines()) <= 80
    packages = only(r"^sudo apt-get install -y (.+)$", read("CONTRIBUTING.md"))
    assert packages == only(r"apt-get install -y (.+?) &&", read("README.md"))


def test_supported_versions_of_mujoco_are_the_same_everywhere() -> None:
    said = ", ".join(SUPPORTED[:-1]) + " and " + SUPPORTED[-1]
    for name in ("README.md", "docs/start.md", "docs/guides/versions.md"):
        assert said in " ".join(read(name).split()), name
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
    "CONTRIBUTING.md",
    "SECURITY.md",
    "benchmarks/README.md",
)
LINKS = [
    (page, link) for page in PAGES for link in re.findall(r"\]\((?!http)([^)]+)\)", read(page))
]


@pytest.mark.parametrize(("page", "link"), LINKS)
def test_pages_link_to_files_that_exist(page: str, link: str) -> None:
    assert ((ROOT / page).parent / link).exists()


def test_method_has_the_constants_of_the_source() -> None:
    method = " ".join(read("docs/method.md").split())
    islands = read("cpp/include/dashpot/islands/islands.hpp")
    stiffness = read("cpp/include/dashpot/islands/row_stiffness.hpp")
    motion = read("cpp/include/dashpot/solve/contact_lanes.hpp")

    def constant(name: str, source: str) -> float:
        return float(only(rf"{name} = ([0-9.e-]+);", source))

    assert float(only(r"\\theta = ([0-9.]+)", method)) == constant("kResolution", islands)
    assert int(only(r"n \\ge ([0-9]+)\$", method)) == constant("kMinimumMicrosteps", islands)
    longest = float(only(r"h\$ at most ([0-9.]+) ms", method))
    assert longest == pytest.approx(1e3 * constant("kRigidMicrostep", stiffness))
    recovery = float(only(r"within ([0-9]+) ms", method))
    assert recovery == pytest.approx(1e3 * constant("kLeastRecoveryTime", motion))


def test_readme_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    # The others run in test_cli_tables.py and test_grinding_outputs.py.
    example, *_ = re.findall(r"```python\n(.*?)```", read("README.md"), re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(example, "README.md", "exec"), names)
    printed = capsys.readouterr().out
    assert "dissipated_normal" in printed
    assert "[[9.81 0.   0.  ]]" in printed  # the ball has come to rest: its weight


@pytest.mark.usefixtures("undrawn")
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
