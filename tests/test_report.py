"""Reports: one file that needs no other, with everything in it that was put in."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser

import pytest
from matplotlib.figure import Figure

from dashpot.report import Picture, Section, Table, Text, write_report


class Reader(HTMLParser):
    """Collects addresses, text and table cells, and checks that tags nest."""

    VOID = frozenset({"meta", "img", "br"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.text = ""
        self.cells: list[str] = []

    def handle_starttag(self, tag, attributes):
        self.addresses += [v for k, v in attributes if k in ("src", "href") and v]
        if tag not in self.VOID:
            self.open.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data
        if self.open and self.open[-1] in ("td", "th"):
            self.cells[-1] += data


def picture(name: str = "line", caption: str = "a line") -> Picture:
    figure = Figure(figsize=(2, 1))
    figure.subplots().plot([0, 1], [0, 1])
    return Picture(name, figure, caption)


@pytest.fixture
def written(tmp_path):
    table = Table(["parameter", "estimate"], [["stiffness <k>", "1.0e4"], ["μ & ν", "0.3"]], "Fit")
    report = write_report(
        tmp_path / "new" / "folder",
        title="A <title>",
        summary="What it says & more",
        sections=[Section("One", [Text('5 < 6 "quoted"'), table]), Section("Two", [picture()])],
        footer="foot",
    )
    reader = Reader()
    reader.feed(report.read_text(encoding="utf-8"))
    return report, reader


def test_report_is_well_formed_and_complete(written):
    _, reader = written
    assert reader.open == []
    for expected in ("A <title>", "What it says & more", '5 < 6 "quoted"', "a line", "foot"):
        assert expected in reader.text
    assert reader.cells == ["parameter", "estimate", "stiffness <k>", "1.0e4", "μ & ν", "0.3"]


def test_report_needs_nothing_from_outside(written):
    report, reader = written
    assert reader.addresses
    assert all(address.startswith("data:image/png;base64,") for address in reader.addresses)
    content = report.read_text(encoding="utf-8")
    assert not re.search(r"https?:|@import|url\(|<script|<link", content)


def test_pictures_are_embedded_and_stored(written):
    report, reader = written
    stored = (report.parent / "line.png").read_bytes()
    assert stored.startswith(b"\x89PNG")
    assert base64.b64decode(reader.addresses[0].split(",", 1)[1]) == stored


@pytest.mark.parametrize(
    ("blocks", "message"),
    [
        ([picture("a"), picture("a")], "two pictures are named 'a'"),
        ([picture("../a")], "unfit"),
        ([Table(["x", "y"], [["1", "2"], ["3"]])], "row 1 of a table in 'S' has 1 cells"),
    ],
)
def test_what_cannot_be_shown_is_refused_before_writing(tmp_path, blocks, message):
    with pytest.raises(ValueError, match=message):
        write_report(tmp_path / "r", title="t", summary="s", sections=[Section("S", blocks)])
    assert not (tmp_path / "r").exists()
