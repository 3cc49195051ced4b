"""Tosses as they were published: made-up states, and files as torch.save writes them."""

from __future__ import annotations

import io
import pickle
import struct
import zipfile
from collections import OrderedDict
from pathlib import Path

import numpy as np


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
