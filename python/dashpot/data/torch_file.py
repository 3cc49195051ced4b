"""Read one tensor from a PyTorch ``.pt`` file without PyTorch and without unpickling.

A ``.pt`` file holds a pickle, and a pickle is a program. Nothing here runs it: the opcode stream
is *read* with :func:`pickletools.genops`, and only the handful of opcodes and the two names
(``torch._utils._rebuild_tensor[_v2]`` and ``collections.OrderedDict``) with which PyTorch writes
one dense tensor are understood. Any other opcode or name is refused by name, so that no file can
make this reader import or call anything.

Both containers are read: the zip archive of PyTorch 1.6 and later (``data.pkl`` and one file per
storage) and the older stream of five pickles followed by the raw storages.
"""

from __future__ import annotations

import io
import itertools
import math
import os
import pickletools
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

_STORAGE_DTYPES = {
    "torch DoubleStorage": "<f8",
    "torch FloatStorage": "<f4",
    "torch LongStorage": "<i8",
    "torch IntStorage": "<i4",
}
_REBUILD_TENSOR = {"torch._utils _rebuild_tensor_v2", "torch._utils _rebuild_tensor"}
_ORDERED_DICT = "collections OrderedDict"

# First pickle of the pre-1.6 container.
_LEGACY_MAGIC = 0x1950A86A20F9469CFC6C
_LEGACY_PROTOCOL = 1001

# Opcodes whose argument is the value; strings of Python 2 are there for files that it wrote.
_CONSTANTS = {
    "BINUNICODE",
    "SHORT_BINUNICODE",
    "BINSTRING",
    "SHORT_BINSTRING",
    "BININT",
    "BININT1",
    "BININT2",
    "LONG1",
}

_MAX_BYTES = 100_000_000
_MAX_OPCODES = 200  # a tensor takes some forty; what they nest is no deeper


class _Name(str):
    """A global that the pickle names, as "module name"; never imported."""


class _Storage(NamedTuple):
    key: str
    dtype: str
    size: int


class _Tensor(NamedTuple):
    storage: _Storage
    offset: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]


class _Mark:
    """Where a pickle's MARK stands on the stack."""


def read_tensor(path: str | os.PathLike[str]) -> NDArray[Any]:
    """Return the single dense tensor stored in a PyTorch file as a numpy array.

    Parameters
    ----------
    path
        A file written by ``torch.save(tensor, path)``.

    Returns
    -------
    ndarray
        A fresh array of the tensor's shape; float64, float32, int64 or int32.

    Raises
    ------
    ValueError
        If the file is damaged, is not a PyTorch file, holds anything but one dense tensor, or
        if its pickle asks for any operation or name that a tensor does not need.
    FileNotFoundError
        If there is no such file.
    """
    path = Path(path)
    if path.stat().st_size > _MAX_BYTES:
        raise ValueError(f"{path}: a file of one tensor has at most {_MAX_BYTES} bytes")
    content = path.read_bytes()
    try:
        if zipfile.is_zipfile(io.BytesIO(content)):
            return _read_archive(content)
        return _read_legacy(io.BytesIO(content))
    except Exception as error:  # whatever the parsers of archive and pickle make of damage
        raise ValueError(f"{path}: not a PyTorch file with one tensor: {error}") from error


def _read_archive(content: bytes) -> NDArray[Any]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        names = archive.namelist()
        if any(m.compress_type != zipfile.ZIP_STORED for m in archive.infolist()):
            raise ValueError("the archive is compressed, which PyTorch's are not")
        pickles = [name for name in names if name == "data.pkl" or name.endswith("/data.pkl")]
        if len(pickles) != 1:
            raise ValueError(f"the archive holds {len(pickles)} data.pkl instead of one")
        root = pickles[0][: -len("data.pkl")]
        if root + "byteorder" in names and archive.read(root + "byteorder") != b"little":
            raise ValueError("the storages are not little-endian")
        tensor = _expect_tensor(_interpret(io.BytesIO(archive.read(pickles[0]))))
        raw = archive.read(f"{root}data/{tensor.storage.key}")
    return _build(tensor, raw)


def _read_legacy(stream: BinaryIO) -> NDArray[Any]:
    if _interpret(stream) != _LEGACY_MAGIC:
        raise ValueError("no PyTorch magic number at the start")
    protocol = _interpret(stream)
    if protocol != _LEGACY_PROTOCOL:
        raise ValueError(f"container protocol {protocol!r} is not {_LEGACY_PROTOCOL}")
    system = _interpret(stream)
    if not isinstance(system, dict) or system.get("little_endian") is not True:
        raise ValueError("the storages are not little-endian")
    tensor = _expect_tensor(_interpret(stream))
    keys = _interpret(stream)
    if keys != [tensor.storage.key]:
        raise ValueError(f"storages {keys!r} stored, {tensor.storage.key!r} needed")
    size = int.from_bytes(stream.read(8), "little")
    if size != tensor.storage.size:
        raise ValueError(f"the storage holds {size} elements, {tensor.storage.size} declared")
    return _build(tensor, stream.read())


def _expect_tensor(value: Any) -> _Tensor:
    if not isinstance(value, _Tensor):
        raise ValueError(f"it holds a {type(value).__name__}, not a tensor")
    return value


def _build(tensor: _Tensor, raw: bytes) -> NDArray[Any]:
    storage = tensor.storage
    expected = storage.size * np.dtype(storage.dtype).itemsize
    if len(raw) != expected:
        raise ValueError(f"storage {storage.key!r} has {len(raw)} bytes, {expected} declared")
    flat = np.frombuffer(raw, storage.dtype)
    if len(tensor.shape) != len(tensor.strides) or min((0, tensor.offset, *tensor.strides)) < 0:
        raise ValueError(f"impossible strides {tensor.strides} for shape {tensor.shape}")
    steps = zip(tensor.shape, tensor.strides, strict=True)
    last = tensor.offset + sum((n - 1) * stride for n, stride in steps)
    size = math.prod(tensor.shape)
    if min((1, *tensor.shape)) < 1 or max(last + 1, size) > flat.size:
        raise ValueError(f"shape {tensor.shape} does not fit a storage of {flat.size} elements")
    strides = tuple(s * flat.itemsize for s in tensor.strides)
    view = np.lib.stride_tricks.as_strided(
        flat[tensor.offset :], tensor.shape, strides, writeable=False
    )
    return np.array(view)


def _interpret(stream: BinaryIO) -> Any:
    """Read one pickle up to its STOP and return the plain value or tensor that it describes."""
    stack: list[Any] = []
    memo: dict[int, Any] = {}

    def pop_to_mark() -> list[Any]:
        items: list[Any] = []
        while not isinstance(top := stack.pop(), _Mark):
            items.append(top)
        return items[::-1]

    opcodes: Iterable[tuple[pickletools.OpcodeInfo, Any, int | None]] = pickletools.genops(stream)
    for opcode, argument, _ in itertools.islice(opcodes, _MAX_OPCODES):
        name = opcode.name
        if name in ("PROTO", "FRAME"):
            continue
        if name == "STOP":
            return stack.pop()
        if name == "MARK":
            stack.append(_Mark())
        elif name == "GLOBAL":
            stack.append(_known_name(argument))
        elif name in ("BINPUT", "LONG_BINPUT"):
            memo[argument] = stack[-1]
        elif name in ("BINGET", "LONG_BINGET"):
            stack.append(memo[argument])
        elif name in _CONSTANTS:
            stack.append(argument)
        elif name in ("NONE", "NEWTRUE", "NEWFALSE"):
            stack.append({"NONE": None, "NEWTRUE": True, "NEWFALSE": False}[name])
        elif name in ("EMPTY_TUPLE", "EMPTY_LIST", "EMPTY_DICT"):
            stack.append({"EMPTY_TUPLE": (), "EMPTY_LIST": [], "EMPTY_DICT": {}}[name])
        elif name == "TUPLE":
            stack.append(tuple(pop_to_mark()))
        elif name in ("TUPLE1", "TUPLE2", "TUPLE3"):
            count = int(name[-1])
            items = tuple(stack[-count:])
            del stack[-count:]
            stack.append(items)
        elif name == "APPEND":
            item = stack.pop()
            stack[-1].append(item)
        elif name == "APPENDS":
            appended = pop_to_mark()
            stack[-1].extend(appended)
        elif name == "SETITEM":
            value, key = stack.pop(), stack.pop()
            stack[-1][key] = value
        elif name == "SETITEMS":
            pairs = pop_to_mark()
            stack[-1].update(zip(pairs[::2], pairs[1::2], strict=True))
        elif name == "BINPERSID":
            stack.append(_storage(stack.pop()))
        elif name == "REDUCE":
            arguments, callee = stack.pop(), stack.pop()
            stack.append(_describe(callee, arguments))
        else:
            raise ValueError(f"refused: the pickle uses {name}, which no tensor needs")
    raise ValueError(f"the pickle has no end within {_MAX_OPCODES} operations")


def _known_name(argument: str) -> _Name:
    if argument not in {*_STORAGE_DTYPES, *_REBUILD_TENSOR, _ORDERED_DICT}:
        raise ValueError(f"refused: the pickle names {argument!r}, which no tensor needs")
    return _Name(argument)


def _storage(identifier: Any) -> _Storage:
    kind, dtype, key, _device, size, *view = identifier
    if kind != "storage" or dtype not in _STORAGE_DTYPES or any(v is not None for v in view):
        raise ValueError(f"unknown storage {identifier!r}")
    if not isinstance(key, str) or not isinstance(size, int) or size < 1:
        raise ValueError(f"storage key {key!r} or size {size!r} is not possible")
    return _Storage(key, _STORAGE_DTYPES[dtype], size)


def _describe(callee: Any, arguments: Any) -> Any:
    """Return the tensor that a call of PyTorch's rebuild function stands for."""
    if callee == _ORDERED_DICT and arguments == ():
        return {}
    if not isinstance(callee, _Name) or callee not in _REBUILD_TENSOR:
        raise ValueError(f"refused: the pickle calls {callee!r}")
    storage, offset, shape, strides, *_ = arguments
    if not isinstance(storage, _Storage):
        raise ValueError("a tensor without a storage")
    numbers = (offset, *shape, *strides)
    if not all(isinstance(number, int) for number in numbers):
        raise ValueError(f"offset, shape and strides {numbers!r} are not whole numbers")
    return _Tensor(storage, offset, tuple(shape), tuple(strides))
