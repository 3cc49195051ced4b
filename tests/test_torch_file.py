"""The reader of PyTorch files: what was stored, and nothing else."""

from __future__ import annotations

import io
import pickle
import struct
import zipfile
from collections import OrderedDict
from pathlib import Path

import numpy as np
import pytest

from dashpot.data.torch_file import read_tensor
from published_tosses import (
    FakeTensor,
    Global,
    Persistent,
    TensorPickler,
    tensor_pickle,
    write_archive,
    write_first_archive,
    write_legacy,
)


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


@pytest.mark.parametrize("content", [b"\x80\x02K\x01K\x02a.", b"\x80\x02}(K\x01e.", b"\x80\x02*."])
def test_reader_refuses_pickles_that_make_no_sense(tmp_path, content):
    path = tmp_path / "tensor.pt"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("tensor/data.pkl", content)
    with pytest.raises(ValueError, match="not a PyTorch file"):
        read_tensor(path)


@pytest.mark.parametrize("container", ["archive", "legacy"])
@pytest.mark.parametrize("nested", [b")" + b"\x85" * 100_000, b"]" + b"]a" * 100_000])
def test_reader_refuses_what_nests_deeper_than_a_tensor(tmp_path, container, nested):
    """A tuple that is a million deep ends the interpreter where it is hashed, compared or shown."""
    pickled = b"\x80\x02}" + nested + b"Ns."
    file = tmp_path / "deep.pt"
    if container == "archive":
        write_archive(file, np.zeros(3), pickled)
    else:
        file.write_bytes(pickled)
    with pytest.raises(ValueError, match=r"deep\.pt.*no end within 200 operations"):
        read_tensor(file)


def test_reader_refuses_compressed_archives(tmp_path):
    """They unpack to more than the file has."""
    path = tmp_path / "tensor.pt"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("tensor/data.pkl", tensor_pickle(np.zeros(3), "0", legacy=False))
        archive.writestr("tensor/data/0", bytes(24))
    with pytest.raises(ValueError, match="the archive is compressed"):
        read_tensor(path)


def test_reader_refuses_damaged_compression(tmp_path):
    path = tmp_path / "tensor.pt"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("tensor/data.pkl", b"\x80\x02" * 200)
    content = bytearray(path.read_bytes())
    begin = content.find(b"data.pkl") + len(b"data.pkl")
    content[begin : begin + 2] = b"\xff\xff"
    path.write_bytes(content)
    with pytest.raises(ValueError, match="not a PyTorch file"):
        read_tensor(path)
