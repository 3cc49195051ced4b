"""Pages of the documentation: links lead to files, code runs, public names are in the reference."""

from __future__ import annotations

import contextlib
import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
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


WITH_CODE = [name_of(p) for p in PAGES if code_of(p) and name_of(p) not in ELSEWHERE]


@pytest.mark.parametrize("page", [name_of(page) for page in PAGES])
def test_pages_link_to_files_that_exist(page: str) -> None:
    path = ROOT / "docs" / page
    for link in re.findall(r"\]\((?!http)([^)#]+)", path.read_text(encoding="utf-8")):
        assert (path.parent / link).exists(), link


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


@pytest.mark.parametrize("module", ["dashpot", "dashpot.calibrate", "dashpot.compare"])
def test_the_reference_has_every_public_name(module: str) -> None:
    reference = "".join(p.read_text(encoding="utf-8") for p in PAGES if "reference" in p.parts)
    submodules = {"calibrate", "compare", "data", "gymnasium", "law", "myosuite", "robosuite"}
    for name in importlib.import_module(module).__all__:
        if name.startswith("__") or name in submodules:
            continue
        assert re.search(rf"\b{name}\b", reference), name
