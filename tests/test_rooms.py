"""Data flows one way through the rooms of the core: docs/method.md names them in order."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
CORE = ("cpp/include/dashpot", "cpp/src")


def rooms() -> dict[str, str]:
    """Return what library each room knows, in the order of the table."""
    page = (ROOT / "docs/method.md").read_text(encoding="utf-8")
    section = re.split(r"^## ", page, flags=re.MULTILINE)[1]
    assert section.startswith("Rooms")
    return dict(re.findall(r"^\| `(\w+)` \|.*\| (\w*) ?\|$", section, re.MULTILINE))


ROOMS = rooms()
FILES = sorted(
    path.relative_to(ROOT)
    for folder in CORE
    for path in (ROOT / folder).rglob("*")
    if path.is_file()
)


def test_every_file_is_in_a_room() -> None:
    assert {path.parent.name for path in FILES} == set(ROOMS)
    assert {str(path.parent.parent) for path in FILES} == set(CORE)


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_knows_those_above_it(room: str) -> None:
    known = list(ROOMS)[: list(ROOMS).index(room) + 1]
    libraries = {"mujoco": "MuJoCo", "fcl": "FCL"}
    for path in FILES:
        if path.parent.name != room:
            continue
        text = (ROOT / path).read_text(encoding="utf-8")
        for other in re.findall(r'#include "dashpot/(\w+)/', text):
            assert other in known, (path, other)
        for library in re.findall(r"#include <(mujoco|fcl)/", text):
            assert libraries[library] == ROOMS[room], (path, library)
