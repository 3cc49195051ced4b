"""The cube tosses: finding, reading and checking them; the real ones."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dashpot.data import CubeTosses, find_cube_tosses, load_cube_tosses, save_cube_tosses
from dashpot.data.cube_tosses import HALF_WIDTH, make_toss
from dashpot.data.download import convert_toss, pinned_sha256
from published_tosses import synthetic_states, write_archive


def small_data_set() -> CubeTosses:
    made = []
    for toss_id in (3, 5):
        s = synthetic_states(seed=toss_id)[0]
        made.append(make_toss(toss_id, s[:, :3] / 20, s[:, 3:7], s[:, 7:10] / 20, s[:, 10:13]))
    return CubeTosses(tuple(made))


def test_only_tosses_are_saved(tmp_path):
    with pytest.raises(TypeError, match=r"^tosses is str; it must be a CubeTosses"):
        save_cube_tosses("tosses", tmp_path / "tosses.npz")
    assert not list(tmp_path.iterdir())


def test_missing_data_say_how_to_get_them(tmp_path, monkeypatch):
    monkeypatch.setenv("DASHPOT_DATA", str(tmp_path))
    with pytest.raises(FileNotFoundError, match=r"dashpot data cube-tosses.*DASHPOT_DATA"):
        load_cube_tosses()
    for name in ("nowhere", 300 * "nowhere", "nowhere\0"):
        with pytest.raises(FileNotFoundError, match="nowhere"):
            load_cube_tosses(tmp_path / name)


@pytest.mark.parametrize("below", ["", "cube_tosses"])
def test_data_are_found_through_the_environment(tmp_path, monkeypatch, below):
    file = tmp_path / below / "cube_tosses_public.npz"
    save_cube_tosses(small_data_set(), file)
    monkeypatch.setenv("DASHPOT_DATA", str(tmp_path))
    assert find_cube_tosses() == file
    assert list(load_cube_tosses().ids) == [3, 5]
    assert list(load_cube_tosses().select([5]).ids) == [5]
    with pytest.raises(ValueError, match="toss 4"):
        load_cube_tosses().select([4])


def test_arrays_are_read_only():
    toss = small_data_set()[0]
    with pytest.raises(ValueError, match="read-only"):
        toss.position[0, 0] = 1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pos": None}, "pos"),
        ({"offsets": np.array([0, 50, 40])}, "offsets"),
        ({"offsets": np.array([0, 40, 81])}, "offsets"),
        ({"ids": np.array([5, 3])}, "ids"),
        ({"mass": -1.0}, "constant"),
        ({"vel": np.full((80, 3), np.nan)}, r"toss 3: velocity\[0, 0\] = nan"),
        ({"quat_wxyz": np.full((80, 4), 0.4)}, "toss 3: quaternion of frame 0 is not unit"),
        ({"pos": np.array(["x"], object)}, "not a file of cube tosses"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path, change, message):
    file = tmp_path / "cube_tosses_public.npz"
    save_cube_tosses(small_data_set(), file)
    with np.load(file) as archive:
        content = {**{key: archive[key] for key in archive.files}, **change}
    np.savez(file, **{key: value for key, value in content.items() if value is not None})
    with pytest.raises(ValueError, match=message):
        load_cube_tosses(file)


def test_pins_are_distinct_sha256_of_published_tosses():
    pins = pinned_sha256()
    assert len(pins) == 400
    assert set(pins) <= set(range(570))
    assert len(set(pins.values())) == 400
    assert all(len(bytes.fromhex(digest)) == 32 for digest in pins.values())
    assert json.dumps(pins)


@pytest.fixture(scope="module")
def real_tosses() -> CubeTosses:
    try:
        return load_cube_tosses()
    except FileNotFoundError:
        shared = Path(__file__).parents[2] / "shared" / "data"
        if not shared.is_dir():
            pytest.skip("no cube tosses: set DASHPOT_DATA")
        return load_cube_tosses(shared)


def test_tosses_are_shown_without_their_arrays():
    toss = make_toss(
        7, np.zeros((3, 3)), np.tile([1.0, 0, 0, 0], (3, 1)), np.zeros((3, 3)), np.zeros((3, 3))
    )
    assert repr(toss) == "CubeToss(7, 3 frames to 0.01351 s)"
    assert repr(CubeTosses((toss, toss))) == "CubeTosses(2 tosses, 6 frames 0.006757 s apart)"


def test_real_tosses_have_the_pinned_content(real_tosses):
    assert {toss.id: toss.content_sha256() for toss in real_tosses} == pinned_sha256()


def test_real_tosses_fall_freely_before_contact(real_tosses):
    """Mean vertical acceleration where the centre is too high for a corner to touch."""
    accelerations = []
    for toss in real_tosses:
        flight = np.argmax(toss.position[:, 2] < real_tosses.half_width * np.sqrt(3))
        if flight >= 8:
            fit = np.polyfit(toss.time[:flight], toss.position[:flight, 2], 2)
            accelerations.append(2 * fit[0])
    # The data's own free fall, 9.604 ± 0.004 m/s², is what length_correction puts right; short
    # flights scatter by 0.1 m/s² each.
    assert len(accelerations) > 100
    measured = -np.median(accelerations) * real_tosses.length_correction
    assert abs(measured - real_tosses.gravity) < 0.03


def test_real_tosses_survive_conversion_and_storage(real_tosses, tmp_path):
    """Back to the published units and layout, through a .pt file, and converted again."""
    for toss in real_tosses.select(real_tosses.ids[::50]):
        states = np.hstack(
            [
                toss.position / HALF_WIDTH,
                toss.quaternion,
                toss.velocity / HALF_WIDTH,
                toss.angular_velocity,
                np.zeros((len(toss), 6)),
            ]
        )[None]
        converted = convert_toss(toss.id, write_archive(tmp_path / "t.pt", states))
        np.testing.assert_allclose(converted.position, toss.position, rtol=0, atol=1e-15)
