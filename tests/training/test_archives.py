"""Archives of strangers: arrays that are there, within a limit, or one line."""

import io
import os
import pickle
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from passloc_env.errors import InputError
from training.archives import ARCHIVE_LIMIT, open_archive, read_arrays


def array(header: str, data: bytes = b"") -> bytes:
    text = header.encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data


def archive(path: Path, *members: tuple[str, bytes], compression: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", compression) as file:
        for name, content in members:
            file.writestr(name, content)
    return path


def refusal(path: Path) -> str:
    """The one line, before more than 64 MiB have gone into it."""
    tracemalloc.start()
    with pytest.raises(InputError) as caught:
        read_arrays(path, ("a",))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert str(caught.value).isprintable()
    assert peak < 1 << 26
    return str(caught.value)


@pytest.mark.parametrize(
    "values", [np.arange(6.0).reshape(2, 3), np.asfortranarray(np.eye(3)[:, :2]), np.array("about"), np.array([True])]
)
def test_arrays_come_back(values: np.ndarray, tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "a.npz", a=values)
    found = read_arrays(tmp_path / "a.npz", ("a",))["a"]
    assert found.dtype == values.dtype
    assert np.array_equal(found, values)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"nonsense",
        array("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }", bytes(8)),
        array("{'descr': '<f8', 'fortran_order': False, 'shape': (-1, -1), }", bytes(8)),
        array("{'descr': '<f8', 'fortran_order': False, 'shape': (2,), }", bytes(8)),
        array("{'descr': '|V0', 'fortran_order': False, 'shape': (1000000000000,), }"),
        array("{'descr': '<f8', 'fortran_order': False, 'shape': __import__('os').mkdir('run'), }", bytes(8)),
        array("((((((((((((((((((((((((((((((((((((((((((((((((((((((((((((("),
        b"\x93NUMPY\x09\x00" + bytes(100),
        pickle.dumps([1.0]),
    ],
)
def test_what_is_no_array(content: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert refusal(archive(tmp_path / "a.npz", ("a.npy", content))) == "an archive whose a is no array"
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_arrays_of_objects_are_not_opened(tmp_path: Path) -> None:
    class Payload:
        def __reduce__(self) -> object:
            return os.mkdir, (str(tmp_path / "run"),)

    np.savez(tmp_path / "a.npz", a=np.array([Payload()], dtype=object))
    assert "no array" in refusal(tmp_path / "a.npz")
    assert not (tmp_path / "run").exists()


def test_bombs(tmp_path: Path) -> None:
    """1 MiB that would be 1 GiB, honestly and not."""
    zeros = zipfile.ZipFile(tmp_path / "zeros.npz", "w", zipfile.ZIP_DEFLATED)
    with zeros, zeros.open("a.npy", "w") as member:
        for _ in range(1 << 6):
            member.write(bytes((ARCHIVE_LIMIT >> 6) + 1))
    assert "MiB when it is unpacked" in refusal(tmp_path / "zeros.npz")
    content = (tmp_path / "zeros.npz").read_bytes()
    size = ((ARCHIVE_LIMIT >> 6) + 1 << 6).to_bytes(4, "little")
    assert size in content
    (tmp_path / "zeros.npz").write_bytes(content.replace(size, (1 << 10).to_bytes(4, "little")))
    assert "damaged" in refusal(tmp_path / "zeros.npz")


def test_unusual_archives(tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_bytes(b"text")
    assert refusal(tmp_path / "text.npz") == "not an archive"
    assert refusal(archive(tmp_path / "b.npz", ("b.npy", b""))) == "an archive without a.npy"
    assert "unusual" in refusal(archive(tmp_path / "l.npz", ("a.npy", b"x"), compression=zipfile.ZIP_LZMA))
    with pytest.warns(UserWarning, match="Duplicate name"):
        archive(tmp_path / "twice.npz", ("a.npy", b"x"), ("a.npy", b"y"))
    assert "twice" in refusal(tmp_path / "twice.npz")


def test_a_list_of_members_without_end() -> None:
    """It is counted before it is read: 20 000 entries."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as many:
        for number in range(20_000):
            many.writestr(str(number), b"")
    with pytest.raises(InputError, match="more than 10000 members"):
        open_archive(file.getvalue())
