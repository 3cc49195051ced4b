"""Archives of numbers: whole ones are read, all others refused by name before they take memory."""

from __future__ import annotations

import io
import tracemalloc
import zipfile

import mujoco
import numpy as np
import pytest

from dashpot.calibrate.data.csv_file import Table, read_runs
from dashpot.cli.recordings import read_npz
from dashpot.data.archive import MAX_BYTES, ArrayArchive
from mutated_files import MODEL, failures, whole_files

FRAMES = 20


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_string(MODEL)


def header_of(shape, dtype="<f8"):
    """Return the bytes with which an array of a shape begins."""
    stream = io.BytesIO()
    description = {"descr": dtype, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, description)
    return stream.getvalue()


def throw():
    return {
        "time": np.arange(FRAMES) / 100,
        "position": np.zeros((FRAMES, 3)),
        "quaternion": np.tile([1.0, 0, 0, 0], (FRAMES, 1)),
    }


@pytest.mark.parametrize("write", [np.savez, np.savez_compressed])
def test_whole_arrays_are_read_as_numpy_wrote_them(tmp_path, write):
    arrays = {
        "number": np.array(2.5),
        "none": np.empty((0, 3)),
        "columns": np.asfortranarray(np.arange(12.0).reshape(3, 4)),
        "single": np.arange(6, dtype=np.float32),
        "flags": np.array([True, False]),
        "large": np.arange(400_000),
    }
    write(tmp_path / "whole.npz", **arrays)
    with ArrayArchive(tmp_path / "whole.npz") as archive:
        assert list(archive) == list(arrays)
        for name, array in arrays.items():
            read = archive.read(name)
            assert read.dtype == array.dtype
            np.testing.assert_array_equal(read, array)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            header_of((3,)) + bytes(16),
            r"array 'a' declares shape \(3,\), which 16 bytes do not hold",
        ),
        (header_of((2**60, 2**60)) + bytes(8), "declares shape"),
        (header_of((-1,)), "declares shape"),
        (header_of((1,), "|O") + bytes(8), "of type object, not of numbers"),
        (header_of((1,), "<U4") + bytes(16), "of type <U4, not of numbers"),
        (b"\x93NUMPY\x01\x00\xff\xff" + b"(" * 65535, "array 'a' is damaged"),
        (b"\x93NUMPY\x09\x00\x10\x00" + bytes(16), "array 'a' is damaged: .*version"),
        (b"", "array 'a' is damaged"),
    ],
)
def test_arrays_that_are_not_what_they_declare_are_refused(tmp_path, content, message):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.npy", content)
    with pytest.raises(ValueError, match=message):
        ArrayArchive(tmp_path / "a.npz")


@pytest.mark.parametrize("compression", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_compressions_that_numpy_does_not_write_are_refused(tmp_path, compression):
    with zipfile.ZipFile(tmp_path / "a.npz", "w", compression) as archive:
        archive.writestr("a.npy", header_of((1,)) + bytes(8))
    with pytest.raises(ValueError, match="compressed in a way that numpy does not write"):
        ArrayArchive(tmp_path / "a.npz")


def test_damaged_numbers_are_refused_by_their_checksum(tmp_path):
    file = tmp_path / "a.npz"
    np.savez(file, a=np.arange(50.0))
    content = bytearray(file.read_bytes())
    content[content.index(np.float64(7.0).tobytes())] ^= 1
    file.write_bytes(content)
    with pytest.raises(ValueError, match=r"array 'a' is damaged: .*CRC"):
        ArrayArchive(file).read("a")


def peak_of(call):
    """Return the largest number of bytes that a call has at a time, and what it raised."""
    tracemalloc.start()
    try:
        with pytest.raises(ValueError) as raised:  # noqa: PT011, the caller matches the message
            call()
        return tracemalloc.get_traced_memory()[1], str(raised.value)
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("name", "shape", "message"),
    [
        ("extra", (20_000_000,), "unknown key 'extra'"),
        ("position", (20_000_000, 1), r"'position' has shape \(20000000, 1\)"),
        ("control", (FRAMES, 1_000_000), "'control' has shape"),
        ("initial_qpos", (20_000_000,), "'initial_qpos' has shape"),
        ("sensors.imu", (FRAMES, 1_000_000), r"'sensors\.imu' has shape"),
        ("sensors.none", (FRAMES, 1_000_000), "no sensor 'none'"),
        ("time", (MAX_BYTES // 8,), f"at most {MAX_BYTES} are read"),
    ],
)
def test_what_a_problem_does_not_need_is_refused_unread(tmp_path, model, name, shape, message):
    """Zeros pack a thousand times; the file of 160 MB of them has 160 kB."""
    file = tmp_path / "packed.npz"
    np.savez_compressed(file, **{**throw(), name: np.zeros(shape, np.uint8)})
    if name == "time":  # declared in numbers of eight bytes
        np.savez_compressed(file, **{**throw(), name: np.zeros(shape)})
    peak, said = peak_of(lambda: read_npz(file, ["ball"], model))
    assert pytest.approx(0, abs=2e6) == peak
    with pytest.raises(ValueError, match=message):
        raise ValueError(said)


def test_reading_takes_little_more_than_the_numbers(tmp_path, model):
    frames = 200_000
    arrays = {"time": np.arange(frames) / 100, "position": np.zeros((frames, 3))}
    np.savez_compressed(tmp_path / "a.npz", **arrays, quaternion=np.ones((frames, 4)))
    tracemalloc.start()
    fields = read_npz(tmp_path / "a.npz", ["ball"], model)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert fields["position"].shape == (frames, 3)
    assert peak < 1.5 * 8 * 8 * frames  # the numbers once, and a piece of a megabyte on its way


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,x\n0,1\n" + "1" * 200_000 + ",2\n", "line 3: field larger than field limit"),
        ('time,x\n0,"1\n' + "1" * 200_000, "field larger than field limit"),
        ("time,x\n0,1\n1,2,3\n", "line 3 has 3 values, the header 2"),
        ("time,x\n0,1\n1,one\n", "line 3, column 'time'|line 3, column"),
        ("", "a header and at least two rows are needed"),
    ],
)
def test_tables_that_are_no_recordings_are_refused(tmp_path, text, message):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_runs(tmp_path / "a.csv", Table({"time": "time", "sensor:x": "x"}, (), None, None))


@pytest.mark.parametrize("kind", ["stored.npz", "packed.npz", "tosses.npz", "throw.csv",
                                  "tensor.pt", "problem.json", "problem.toml"])  # fmt: skip
def test_readers_of_mutated_files_return_or_raise_what_they_promise(tmp_path, kind):
    """A hundred thousand of each: benchmarks/mutated_files.py."""
    assert not failures(kind, *whole_files(tmp_path)[kind], 80)
