"""The cube tosses: reading, checking, downloading; and the reader of PyTorch files."""

from __future__ import annotations

import functools
import http.server
import io
import json
import pickle
import struct
import threading
import zipfile
from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dashpot.data import (
    CubeTosses,
    download_cube_tosses,
    find_cube_tosses,
    load_cube_tosses,
    save_cube_tosses,
)
from dashpot.data import download as download_module
from dashpot.data.cube_tosses import HALF_WIDTH, make_toss
from dashpot.data.download import convert_toss, pinned_sha256
from dashpot.data.torch_file import read_tensor


class Persistent:
    """Stands for a storage while a test file is pickled."""

    def __init__(self, *identifier: object) -> None:
        self.identifier = identifier


class TensorPickler(pickle._Pickler):  # type: ignore[name-defined]
    """Writes the same opcodes as torch.save, without torch: names are written, not looked up."""

    dispatch = pickle._Pickler.dispatch.copy()  # type: ignore[attr-defined]

    def persistent_id(self, value: object) -> object:
        return value.identifier if isinstance(value, Persistent) else None

    def save_name(self, name: Global) -> None:
        self.write(pickle.GLOBAL + name.module.encode() + b"\n" + name.name.encode() + b"\n")

    def save_tensor(self, tensor: FakeTensor) -> None:
        self.save(Global("torch._utils", "_rebuild_tensor_v2"))
        self.save(tensor.arguments)
        self.write(pickle.REDUCE)


class Global:
    def __init__(self, module: str, name: str) -> None:
        self.module, self.name = module, name


class FakeTensor:
    def __init__(self, *arguments: object) -> None:
        self.arguments = arguments


TensorPickler.dispatch[Global] = TensorPickler.save_name
TensorPickler.dispatch[FakeTensor] = TensorPickler.save_tensor

STORAGES = {"f8": "DoubleStorage", "f4": "FloatStorage", "i8": "LongStorage"}


def tensor_pickle(
    array: np.ndarray, key: str, *, legacy: bool, strides: tuple[int, ...] | None = None
) -> bytes:
    storage = Global("torch", STORAGES[array.dtype.str[1:]])
    identifier = ("storage", storage, key, "cpu", array.size) + ((None,) if legacy else ())
    steps = strides or tuple(s // array.itemsize for s in array.strides)
    tensor = FakeTensor(Persistent(*identifier), 0, array.shape, steps, False, OrderedDict())
    stream = io.BytesIO()
    TensorPickler(stream, protocol=2).dump(tensor)
    return stream.getvalue()


def write_archive(path: Path, array: np.ndarray, pickled: bytes | None = None) -> Path:
    """Write what torch.save writes since 1.6."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr("archive/data.pkl", pickled or tensor_pickle(array, "0", legacy=False))
        archive.writestr("archive/byteorder", "little")
        archive.writestr("archive/data/0", array.tobytes())
        archive.writestr("archive/version", "3\n")
    return path


def write_first_archive(path: Path, array: np.ndarray) -> Path:
    """Write what torch.save wrote in 1.6: addresses as keys, no byte order."""
    key = "94340341289312"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr("archive/data.pkl", tensor_pickle(array, key, legacy=False))
        archive.writestr(f"archive/data/{key}", array.tobytes())
        archive.writestr("archive/version", "3\n")
    return path


def write_legacy(path: Path, array: np.ndarray) -> Path:
    """Write what torch.save wrote before 1.6."""
    system = {
        "protocol_version": 1001,
        "little_endian": True,
        "type_sizes": {"short": 2, "int": 4, "long": 4},
    }
    head = [0x1950A86A20F9469CFC6C, 1001, system]
    content = b"".join(pickle.dumps(item, protocol=2) for item in head)
    content += tensor_pickle(array, "94218342", legacy=True)
    content += pickle.dumps(["94218342"], protocol=2)
    path.write_bytes(content + struct.pack("<q", array.size) + array.tobytes())
    return path


@pytest.mark.parametrize("write", [write_archive, write_first_archive, write_legacy])
@pytest.mark.parametrize("dtype", ["<f8", "<f4", "<i8"])
def test_reader_returns_the_stored_numbers(tmp_path, write, dtype):
    array = (np.arange(2 * 5 * 3).reshape(2, 5, 3) * 0.7 - 3).astype(dtype)
    read = read_tensor(write(tmp_path / "t.pt", array))
    assert read.dtype == array.dtype
    np.testing.assert_array_equal(read, array)


def test_reader_takes_the_strings_of_python_2(tmp_path):
    array = np.arange(6.0)
    pickled = tensor_pickle(array, "0", legacy=False)
    for text in ("storage", "cpu"):
        new = pickle.BINUNICODE + struct.pack("<I", len(text)) + text.encode()
        assert new in pickled
        pickled = pickled.replace(new, pickle.SHORT_BINSTRING + bytes([len(text)]) + text.encode())
    read = read_tensor(write_archive(tmp_path / "t.pt", array, pickled))
    np.testing.assert_array_equal(read, array)


def test_reader_follows_strides(tmp_path):
    stored = np.arange(12.0).reshape(3, 4)
    pickled = tensor_pickle(stored, "0", legacy=False, strides=(1, 3))
    read = read_tensor(write_archive(tmp_path / "t.pt", stored, pickled))
    np.testing.assert_array_equal(read, np.arange(12.0).reshape(4, 3).T)


class Exploit:
    """A pickle that would create a file, were it ever executed."""

    def __init__(self, target: Path) -> None:
        self.target = target

    def __reduce__(self) -> tuple[object, tuple[str, str]]:
        return open, (str(self.target), "w")


@pytest.mark.parametrize("protocol", [0, 1, 2, 3, 4, 5])
@pytest.mark.parametrize("container", ["archive", "legacy"])
def test_reader_refuses_a_malicious_pickle_without_running_it(tmp_path, protocol, container):
    victim = tmp_path / "created_by_the_pickle"
    pickled = pickle.dumps(Exploit(victim), protocol=protocol)
    pickle.loads(pickled).close()
    assert victim.exists(), "the exploit of this test has to work where it is executed"
    victim.unlink()
    file = tmp_path / "evil.pt"
    if container == "archive":
        write_archive(file, np.zeros(3), pickled)
    else:
        file.write_bytes(pickled)
    with pytest.raises(ValueError, match=r"evil\.pt.*(refused|magic)"):
        read_tensor(file)
    assert not victim.exists()


def test_reader_refuses_names_that_no_tensor_needs(tmp_path):
    pickled = pickle.PROTO + b"\x02" + b"cbuiltins\neval\n" + b"X\x01\x00\x00\x001\x85R."
    with pytest.raises(ValueError, match=r"refused.*builtins eval"):
        read_tensor(write_archive(tmp_path / "t.pt", np.zeros(3), pickled))


@pytest.mark.parametrize(
    ("shape", "strides"), [((2, 4), (4, 1)), ((7,), (1,)), ((2, 3), (3,)), ((2, 3), (-3, 1))]
)
def test_reader_refuses_a_tensor_that_reaches_outside_its_storage(tmp_path, shape, strides):
    array = np.zeros(6)
    storage = ("storage", Global("torch", "DoubleStorage"), "0", "cpu", 6)
    stream = io.BytesIO()
    tensor = FakeTensor(Persistent(*storage), 0, shape, strides, False, OrderedDict())
    TensorPickler(stream, protocol=2).dump(tensor)
    with pytest.raises(ValueError, match="not a PyTorch file with one tensor"):
        read_tensor(write_archive(tmp_path / "t.pt", array, stream.getvalue()))


@pytest.mark.parametrize("write", [write_archive, write_legacy])
def test_reader_refuses_truncated_files(tmp_path, write):
    content = write(tmp_path / "t.pt", np.arange(30.0)).read_bytes()
    for length in (0, 1, 10, 60, len(content) // 2, len(content) - 1):
        (tmp_path / "cut.pt").write_bytes(content[:length])
        with pytest.raises(ValueError, match=r"cut\.pt"):
            read_tensor(tmp_path / "cut.pt")


def synthetic_states(frames: int = 40, seed: int = 0) -> np.ndarray:
    """States of a falling, spinning cube in the published units and layout, (1, F, 19)."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames) / 148.0
    position = rng.uniform(-2, 2, 3) + np.outer(t, rng.uniform(-1, 1, 3)) + [0, 0, 4]
    angle = 5.0 * t
    axis = np.array([0.6, 0.0, 0.8])
    quaternion = np.column_stack([np.cos(angle / 2), np.outer(np.sin(angle / 2), axis)])
    velocity = np.gradient(position, 1 / 148.0, axis=0)
    omega = np.tile(5.0 * axis, (frames, 1))
    return np.hstack([position, quaternion, velocity, omega, np.zeros((frames, 6))])[None]


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


def small_data_set() -> CubeTosses:
    made = []
    for toss_id in (3, 5):
        s = synthetic_states(seed=toss_id)[0]
        made.append(make_toss(toss_id, s[:, :3] / 20, s[:, 3:7], s[:, 7:10] / 20, s[:, 10:13]))
    return CubeTosses(tuple(made))


def test_missing_data_say_how_to_get_them(tmp_path, monkeypatch):
    monkeypatch.setenv("DASHPOT_DATA", str(tmp_path))
    with pytest.raises(FileNotFoundError, match=r"dashpot data cube-tosses.*DASHPOT_DATA"):
        load_cube_tosses()
    with pytest.raises(FileNotFoundError, match="nowhere"):
        load_cube_tosses(tmp_path / "nowhere")


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
