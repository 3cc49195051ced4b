"""Arrays of numbers in an ``.npz`` archive, read within bounds that the caller states.

An archive says what arrays it has, and each array its shape, before any number of it is read. So
names and sizes are checked first, and an archive of a few megabytes that unpacks to gigabytes is
refused by its directory.
"""

from __future__ import annotations

import math
import os
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

MAX_BYTES = 1 << 28
"""No archive is read whose arrays take more bytes together."""

_NUMBERS = "biuf"
_COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_MAX_ARRAYS = 1000
_CHUNK = 1 << 20  # bytes unpacked at a time


class ArrayHeader(NamedTuple):
    """Shape and type of an array that has not been read yet."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    fortran_order: bool

    @property
    def nbytes(self) -> int:
        """Bytes of its numbers."""
        return math.prod(self.shape) * self.dtype.itemsize


class ArrayArchive(Mapping[str, ArrayHeader]):
    """The headers of an ``.npz`` archive by name, and the arrays on demand.

    Parameters
    ----------
    file
        An archive as `numpy.savez` and `numpy.savez_compressed` write it.
    max_bytes
        What its arrays may take together.

    Raises
    ------
    ValueError
        If the file is damaged, is no such archive, holds anything but numbers, or declares more
        than `max_bytes`. It names the array where one is at fault.
    OSError
        If the file cannot be opened.

    Examples
    --------
    >>> np.savez("throw.npz", time=np.arange(3.0))
    >>> with ArrayArchive("throw.npz") as archive:
    ...     archive["time"].shape, archive.read("time")
    ((3,), array([0., 1., 2.]))
    """

    def __init__(self, file: str | os.PathLike[str], max_bytes: int = MAX_BYTES) -> None:
        with Path(file).open("rb") as stream:
            start = stream.read(len(np.lib.format.MAGIC_PREFIX))
        if start == np.lib.format.MAGIC_PREFIX:
            raise ValueError("it holds one array; an .npz archive of named arrays is needed")
        try:
            self._zip = zipfile.ZipFile(file)
        except Exception as error:  # whatever the container's parser makes of damage
            raise ValueError(f"it is no .npz archive: {_said(error)}") from error
        try:
            self._headers = _read_headers(self._zip, max_bytes)
        except BaseException:
            self._zip.close()
            raise

    def read(self, name: str) -> NDArray[Any]:
        """Return an array of the archive.

        Raises
        ------
        KeyError
            If there is no such array.
        ValueError
            If its numbers are damaged.
        """
        header = self._headers[name]
        flat = np.empty(math.prod(header.shape), header.dtype)
        try:
            with self._zip.open(self._member(name)) as stream:
                _parse_header(stream)
                place = flat.view(np.uint8)
                for begin in range(0, place.size, _CHUNK):
                    count = min(_CHUNK, place.size - begin)
                    place[begin : begin + count] = np.frombuffer(stream.read(count), np.uint8)
                stream.read(1)  # the end, where the checksum is compared
        except Exception as error:
            raise ValueError(f"array {name!r} is damaged: {_said(error)}") from error
        return flat.reshape(header.shape, order="F" if header.fortran_order else "C")

    def _member(self, name: str) -> str:
        return name if name in self._zip.NameToInfo else f"{name}.npy"

    def __getitem__(self, name: str) -> ArrayHeader:
        return self._headers[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._headers)

    def __len__(self) -> int:
        return len(self._headers)

    def __enter__(self) -> ArrayArchive:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._zip.close()


def _read_headers(archive: zipfile.ZipFile, max_bytes: int) -> dict[str, ArrayHeader]:
    members = archive.infolist()
    if len(members) > _MAX_ARRAYS:
        raise ValueError(f"it holds {len(members)} arrays; at most {_MAX_ARRAYS} are read")
    headers: dict[str, ArrayHeader] = {}
    for member in members:
        name = member.filename.removesuffix(".npy")
        if name in headers:
            raise ValueError(f"array {name!r} is there twice")
        headers[name] = _read_header(archive, member, name)
    total = sum(header.nbytes for header in headers.values())
    if total > max_bytes:
        raise ValueError(f"its arrays take {total} bytes; at most {max_bytes} are read")
    return headers


def _read_header(archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str) -> ArrayHeader:
    if member.compress_type not in _COMPRESSIONS:
        raise ValueError(f"array {name!r} is compressed in a way that numpy does not write")
    try:
        with archive.open(member) as stream:
            header = _parse_header(stream)
            start = stream.tell()
    except Exception as error:
        raise ValueError(f"array {name!r} is damaged: {_said(error)}") from error
    if header.dtype.kind not in _NUMBERS:
        raise ValueError(f"array {name!r} is of type {header.dtype}, not of numbers")
    if min((0, *header.shape)) < 0 or start + header.nbytes != member.file_size:
        raise ValueError(
            f"array {name!r} declares shape {header.shape}, which {member.file_size - start} bytes "
            "do not hold"
        )
    return header


def _parse_header(stream: Any) -> ArrayHeader:
    version = np.lib.format.read_magic(stream)
    if version == (1, 0):
        shape, fortran_order, dtype = np.lib.format.read_array_header_1_0(stream)
    elif version == (2, 0):
        shape, fortran_order, dtype = np.lib.format.read_array_header_2_0(stream)
    else:
        raise ValueError(f"version {version} of the array format is unknown")
    return ArrayHeader(tuple(shape), dtype, fortran_order)


def _said(error: Exception) -> str:
    """Return the first line of what a parser said, or its kind where it said nothing."""
    lines = str(error).splitlines()
    return lines[0] if lines and lines[0] else type(error).__name__
