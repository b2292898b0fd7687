"""Archives of strangers: read member by member and within a limit, never unpacked into files, nothing unpickled."""

from __future__ import annotations

import io
import math
import struct
import zipfile
import zlib
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from passloc_env.errors import InputError
from passloc_env.reading import read_bytes

ARCHIVE_LIMIT = 1 << 28
"""Bytes that an archive may take, as it is and when it is unpacked."""

_MEMBERS = 10_000
_MEMBER = b"PK\x01\x02"
"""How each entry in the list of members begins, which the standard library reads whole before it says anything."""

_DAMAGE = (zipfile.BadZipFile, zlib.error, EOFError, LookupError, OSError, RuntimeError, ValueError, struct.error)
_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def open_archive(content: bytes) -> zipfile.ZipFile:
    """An archive that takes at most :data:`ARCHIVE_LIMIT` bytes when it is unpacked.

    Raises:
        InputError: another content, too many members, or one that is there twice.
    """
    if content.count(_MEMBER) > _MEMBERS:
        raise InputError(f"an archive of more than {_MEMBERS} members")
    try:
        archive = zipfile.ZipFile(io.BytesIO(content))
    except _DAMAGE:
        raise InputError("not an archive") from None
    members = archive.infolist()
    if sum(member.file_size for member in members) > ARCHIVE_LIMIT:
        raise InputError(f"an archive of more than {ARCHIVE_LIMIT >> 20} MiB when it is unpacked")
    if len({member.filename for member in members}) < len(members):
        raise InputError("an archive that holds a member twice")
    if any(member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for member in members):
        raise InputError("an archive packed in an unusual way")
    return archive


def read_member(archive: zipfile.ZipFile, name: str) -> bytes:
    """The content of a member; InputError when it is damaged or not there."""
    if name not in archive.namelist():
        raise InputError(f"an archive without {name}")
    try:
        # Just so many bytes are asked for: of a member that says less than it holds, all would be unpacked first.
        with archive.open(name) as member:
            return member.read(max(archive.getinfo(name).file_size, 1))
    except _DAMAGE:
        raise InputError(f"an archive whose {name} is damaged") from None


def read_arrays(path: Path, names: Iterable[str]) -> dict[str, np.ndarray]:
    """Arrays by name from an ``.npz`` file.

    Raises:
        OSError: a file that cannot be read, or is larger than :data:`ARCHIVE_LIMIT`.
        InputError: no archive of these arrays.
    """
    archive = open_archive(read_bytes(path, ARCHIVE_LIMIT))
    return {name: _array(name, read_member(archive, f"{name}.npy")) for name in names}


def _array(name: str, content: bytes) -> np.ndarray:
    """An array; InputError unless it takes just the bytes that are there, before any memory is set aside for it."""
    file = io.BytesIO(content)
    try:
        shape, _, kind = _HEADERS[np.lib.format.read_magic(file)](file)
        if math.prod(shape) * kind.itemsize == len(content) - file.tell() > 0:
            file.seek(0)
            return np.lib.format.read_array(file, allow_pickle=False)
    except Exception:  # NumPy's reader of headers fails in as many ways as a text can be wrong.
        pass
    raise InputError(f"an archive whose {name} is no array")
