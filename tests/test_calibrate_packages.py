"""Calibration is in packages through which data flow one way; presenters come last."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import dashpot

ROOT = Path(dashpot.__file__).parent / "calibrate"
ORDER = ("data", "problem", "residuals", "search", "inference", "report")


def imported_packages(path: Path) -> set[str]:
    """Return the packages of calibration that a module imports when it is imported itself."""
    found = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and node.module is not None:
            parts = node.module.split(".")
            if parts[:2] == ["dashpot", "calibrate"] and len(parts) > 2:
                found.add(parts[2])
    return found


def test_each_package_has_its_place() -> None:
    packages = {path.parent.name for path in ROOT.glob("*/__init__.py")}
    assert packages == {*ORDER, "tosses"}


@pytest.mark.parametrize("package", ORDER)
def test_a_package_imports_those_before_it(package: str) -> None:
    known = set(ORDER[: ORDER.index(package) + 1])
    modules = sorted((ROOT / package).glob("*.py"))
    assert len(modules) > 1
    for path in modules:
        late = imported_packages(path) - known
        assert late <= ({"result"} if package == "report" else set()), path


def test_the_result_does_not_know_its_presenters() -> None:
    for module in ("result", "prediction"):
        assert "report" not in imported_packages(ROOT / f"{module}.py"), module
