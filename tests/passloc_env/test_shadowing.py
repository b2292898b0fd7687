"""Which package would Python import: ours or a stranger's?"""

import sys
import zipfile
from pathlib import Path

import pytest

from passloc_env.shadowing import explain, shadowed

NAME = "package_that_only_this_test_knows"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The place of the package: tmp_path is the first entry of sys.path."""
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path / NAME


def write_package(folder: Path, source: str) -> None:
    folder.mkdir()
    (folder / "__init__.py").write_text(source, encoding="utf-8")


@pytest.mark.parametrize("name", ["passloc_env", "agents", "training"])
def test_real_packages_are_ours(name: str) -> None:
    assert shadowed(name) is None


def test_absent_package_is_not_shadowed() -> None:
    assert shadowed(NAME) is None


@pytest.mark.parametrize(
    "source",
    [
        '"""passloc agents: who decides."""\n',
        '#!/usr/bin/env python3\n# A header.\n\n"""passloc agents: who decides."""\n',
    ],
)
def test_marked_package_is_ours(folder: Path, source: str) -> None:
    write_package(folder, source)
    assert shadowed(NAME) is None


@pytest.mark.parametrize(
    "source",
    [
        "",
        "# passloc, but only in a comment\nimport os\n",
        '"""Somebody else\'s agents."""\n\nNOTE = "passloc"\n',
        '"""A broken docstring\n',
    ],
)
def test_unmarked_package_is_foreign(folder: Path, source: str) -> None:
    write_package(folder, source)
    assert shadowed(NAME) == str(folder)


def test_looking_does_not_import(folder: Path) -> None:
    write_package(folder, "raise RuntimeError('imported')\n")
    assert shadowed(NAME) == str(folder)
    assert NAME not in sys.modules


def test_undecodable_package_is_foreign(folder: Path) -> None:
    folder.mkdir()
    (folder / "__init__.py").write_bytes(b'"""passloc \xff\xfe"""\n')
    assert shadowed(NAME) == str(folder)


def test_unreadable_package_is_foreign(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_package(folder, '"""passloc agents."""\n')

    def refuse(loader: object, path: str) -> bytes:
        raise PermissionError(path)

    # Taking the permission away would not stop a test that runs as root.
    monkeypatch.setattr("importlib.machinery.SourceFileLoader.get_data", refuse)
    assert shadowed(NAME) == str(folder)


def test_plain_folder_is_foreign(folder: Path) -> None:
    folder.mkdir()
    (folder / "helper.py").write_text('"""passloc, but not a package."""\n')
    assert shadowed(NAME) == str(folder)


def test_regular_package_wins_over_plain_folder(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_package(folder, '"""passloc agents."""\n')
    working_directory = tmp_path / "elsewhere"
    (working_directory / NAME).mkdir(parents=True)
    monkeypatch.syspath_prepend(working_directory)
    assert shadowed(NAME) is None


def test_single_module_is_foreign(folder: Path) -> None:
    module = folder.with_suffix(".py")
    module.write_text('"""passloc agents."""\n')
    assert shadowed(NAME) == str(module)


def test_marked_package_in_zip_archive_is_ours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    archive = tmp_path / "packages.zip"
    with zipfile.ZipFile(archive, "w") as packed:
        packed.writestr(f"{NAME}/__init__.py", '"""passloc agents."""\n')
    monkeypatch.syspath_prepend(archive)
    assert shadowed(NAME) is None


def test_explanation_is_one_line_with_name_path_and_remedies(tmp_path: Path) -> None:
    line = explain("agents", str(tmp_path))
    assert "\n" not in line
    for part in ("'agents'", str(tmp_path), "of its own", "rename that folder", "another directory"):
        assert part in line


def test_explanation_calls_a_file_a_file(tmp_path: Path) -> None:
    module = tmp_path / "agents.py"
    module.touch()
    assert "rename that file" in explain("agents", str(module))
