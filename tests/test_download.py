"""Conversion and download of the published cube tosses."""

from __future__ import annotations

import functools
import http.server
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dashpot.data import download as download_module
from dashpot.data import download_cube_tosses, load_cube_tosses
from dashpot.data.cube_tosses import HALF_WIDTH, make_toss
from dashpot.data.download import convert_toss, pinned_sha256
from published_tosses import synthetic_states, write_archive, write_legacy


def test_conversion_gives_si_units(tmp_path):
    states = synthetic_states()
    toss = convert_toss(7, write_archive(tmp_path / "7.pt", states))
    assert 7 not in pinned_sha256()
    assert toss.id == 7
    np.testing.assert_array_equal(toss.position, states[0, :, :3] * 0.0524)
    np.testing.assert_array_equal(toss.quaternion, states[0, :, 3:7])
    np.testing.assert_array_equal(toss.velocity, states[0, :, 7:10] * 0.0524)
    np.testing.assert_array_equal(toss.angular_velocity, states[0, :, 10:13])
    np.testing.assert_allclose(toss.time, np.arange(40) / 148, rtol=1e-15)


def test_conversion_refuses_a_pinned_toss_with_other_content(tmp_path):
    assert 0 in pinned_sha256()
    with pytest.raises(ValueError, match="toss 0: the content has SHA-256"):
        convert_toss(0, write_archive(tmp_path / "0.pt", synthetic_states()))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda s: s[:, :, :18], "shape"),
        (lambda s: s[0], "shape"),
        (lambda s: np.concatenate([s[:, :, :13], s[:, :, 13:] + 1], axis=2), "control"),
        (lambda s: s * np.where(np.arange(19) == 3, 1.001, 1), "unit"),
        (lambda s: s * np.where(np.arange(19) == 8, -20, 1), "velocity"),
        (lambda s: np.where(np.arange(19) == 0, np.nan, s), "position"),
    ],
)
def test_conversion_names_what_is_wrong(tmp_path, damage, message):
    file = write_archive(tmp_path / "7.pt", np.ascontiguousarray(damage(synthetic_states())))
    with pytest.raises(ValueError, match=f"toss 7: .*{message}"):
        convert_toss(7, file)


class QuietHandler(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *arguments: object) -> None:
        pass


@pytest.fixture
def server(tmp_path: Path) -> Iterator[tuple[str, Path]]:
    folder = tmp_path / "published"
    folder.mkdir()
    handler = functools.partial(QuietHandler, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as httpd:
        thread = threading.Thread(target=httpd.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{httpd.server_port}/", folder
        httpd.shutdown()
        thread.join()


def test_download_converts_and_stores(tmp_path, server):
    url, folder = server
    write_archive(folder / "7.pt", synthetic_states(seed=1))
    write_legacy(folder / "12.pt", synthetic_states(frames=30, seed=2))
    calls = []
    file = download_cube_tosses(
        tmp_path / "store",
        base_url=url,
        tosses=[12, 7],
        progress=lambda done, total: calls.append((done, total)),
    )
    tosses = load_cube_tosses(file)
    assert list(tosses.ids) == [7, 12]
    assert calls == [(1, 2), (2, 2)]
    expected = synthetic_states(frames=30, seed=2)[0]
    np.testing.assert_array_equal(tosses[1].position, expected[:, :3] * HALF_WIDTH)
    assert tosses.mass == 0.37
    assert sorted(p.name for p in (tmp_path / "store").iterdir()) == [file.name]


def test_download_checks_the_pin_of_a_toss(tmp_path, server, monkeypatch):
    url, folder = server
    states = synthetic_states()
    write_archive(folder / "0.pt", states)
    toss = make_toss(
        0,
        states[0, :, :3] * HALF_WIDTH,
        states[0, :, 3:7],
        states[0, :, 7:10] * HALF_WIDTH,
        states[0, :, 10:13],
    )
    pins = {0: toss.content_sha256()}
    monkeypatch.setattr(download_module, "pinned_sha256", lambda: pins)
    assert len(load_cube_tosses(download_cube_tosses(tmp_path / "ok", base_url=url))) == 1
    states[0, 5, 0] += 1e-4
    write_archive(folder / "0.pt", states)
    with pytest.raises(ValueError, match=r"toss 0.*pinned"):
        download_cube_tosses(tmp_path / "changed", base_url=url)
    assert not (tmp_path / "changed").exists(), "nothing is stored when a check fails"


def test_download_asks_the_second_revision_where_the_first_is_gone(tmp_path, server, monkeypatch):
    url, folder = server
    (folder / "second").mkdir()
    write_archive(folder / "second" / "7.pt", synthetic_states())
    monkeypatch.setattr(download_module, "BASE_URLS", (url + "first/", url + "second/"))
    file = download_cube_tosses(tmp_path / "store", tosses=[7])
    assert list(load_cube_tosses(file).ids) == [7]


def test_download_says_what_it_could_not_fetch(tmp_path, server):
    url, _ = server
    with pytest.raises(ConnectionError, match=r"7\.pt"):
        download_cube_tosses(tmp_path, base_url=url, tosses=[7])


@pytest.mark.parametrize("tosses", ["some", [570], [-1], []])
def test_download_refuses_tosses_that_were_not_published(tmp_path, tosses):
    with pytest.raises(ValueError, match="tosses"):
        download_cube_tosses(tmp_path, base_url="http://127.0.0.1:9/", tosses=tosses)
