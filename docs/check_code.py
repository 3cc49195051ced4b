"""Run the code of each page of the documentation as one script, in a folder of its own.

python docs/check_code.py [PAGE ...]        (all pages: `guides/viewer.md` and so on)
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import mujoco
import numpy as np

DOCS = Path(__file__).resolve().parent
# Run by tests/test_packaging.py and tests/test_docs.py.
ELSEWHERE = {"recordings.md", "reports.md", "reference/examples.md"}
BALL = """<mujoco><worldbody><body pos="0 0 1"><freejoint/><geom size=".1"/></body></worldbody>
</mujoco>"""


class ShownFrames:
    """Stands for ``mujoco.viewer``: a window that is closed after some frames."""

    def __init__(self, frames: int) -> None:
        self.frames = frames
        self.heights: list[float] = []

    @contextlib.contextmanager
    def launch_passive(self, model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[ShownFrames]:
        """Show the data of a model."""
        self.data = data
        yield self

    def is_running(self) -> bool:
        """Return whether frames are left."""
        return len(self.heights) < self.frames

    @contextlib.contextmanager
    def lock(self) -> Iterator[None]:
        """Do nothing."""
        yield

    def sync(self) -> None:
        """Take note of the height."""
        self.heights.append(float(self.data.qpos[2]))


def pages() -> dict[str, str]:
    """Return the code of all pages that have some, by the name of the page."""
    found = {}
    for page in sorted(DOCS.rglob("*.md")):
        name = page.relative_to(DOCS).as_posix()
        text = page.read_text(encoding="utf-8")
        code = "\n".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL))
        if code and name not in ELSEWHERE and "tutorials" not in page.parts:
            found[name] = code
    return found


def run(page: str, code: str) -> None:
    """Run the code of a page, and hold what it says to what it has to be."""
    names: dict[str, Any] = {}
    shown = ShownFrames(frames=25)
    with contextlib.ExitStack() as stack:
        if page == "guides/viewer.md":
            Path("scene.xml").write_text(BALL, encoding="utf-8")
            stack.enter_context(mock.patch.dict(sys.modules, {"mujoco.viewer": shown}))
            stack.enter_context(mock.patch.object(mujoco, "viewer", shown, create=True))
        exec(compile(code, page, "exec"), names)
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
            assert estimate.lower <= truth <= estimate.upper, quantity


def main() -> None:
    """Run the pages that are named, or all."""
    code = pages()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pages", nargs="*", help="all of them if none is named")
    wanted = parser.parse_args().pages or list(code)
    here = Path.cwd()
    for page in wanted:
        began = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            try:
                run(page, code[page])
            finally:
                os.chdir(here)
        print(f"{page}: {time.perf_counter() - began:.1f} s", flush=True)


if __name__ == "__main__":
    main()
