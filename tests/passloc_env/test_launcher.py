"""The passloc command: one line instead of a traceback, but only for faults of the installation."""

import os
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import NoReturn

import pytest

from passloc_env import launcher

ROOT = Path(__file__).parents[2]


def run_command(directory: Path) -> subprocess.CompletedProcess[str]:
    """Runs the command in a process of its own, with the directory's packages before the installed ones."""
    return subprocess.run(
        [sys.executable, "-c", "import sys; sys.argv = ['passloc']; from passloc_env.launcher import main; main()"],
        cwd=directory,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(directory), str(ROOT)])},
        capture_output=True,
        text=True,
        check=False,
    )


def write_package(folder: Path, docstring: str, **modules: str) -> None:
    folder.mkdir()
    (folder / "__init__.py").write_text(f'"""{docstring}"""\n')
    for name, source in modules.items():
        (folder / f"{name}.py").write_text(source)


def replace_cli(monkeypatch: pytest.MonkeyPatch, main: Callable[[], object]) -> None:
    monkeypatch.setattr(launcher, "shadowed", lambda name: None)
    monkeypatch.setitem(sys.modules, "training.cli", SimpleNamespace(main=main))


def raising(error: Exception) -> Callable[[], NoReturn]:
    def main() -> NoReturn:
        raise error

    return main


@pytest.mark.parametrize("name", ["agents", "training"])
def test_foreign_package_is_named_in_one_line(tmp_path: Path, name: str) -> None:
    write_package(tmp_path / name, "Somebody else's package.")
    result = run_command(tmp_path)
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr.startswith(f"passloc: its package '{name}' is hidden by {tmp_path / name}: ")
    assert result.stderr.count("\n") == 1


def test_import_warns_in_one_line(tmp_path: Path) -> None:
    write_package(tmp_path / "agents", "Somebody else's package.")
    result = subprocess.run(
        [sys.executable, "-c", "import passloc_env"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])},
        capture_output=True,
        text=True,
        check=True,
    )
    warnings = [line for line in result.stderr.splitlines() if "UserWarning" in line]
    assert len(warnings) == 1
    assert f"its package 'agents' is hidden by {tmp_path / 'agents'}" in warnings[0]


def test_missing_extra_is_named_in_one_line(tmp_path: Path) -> None:
    write_package(tmp_path / "agents", "passloc agents.")
    # None in sys.modules makes an import fail as if the library were not installed.
    cli = "import sys\nsys.modules['tyro'] = None\nimport tyro\n"
    write_package(tmp_path / "training", "passloc training.", cli=cli)
    result = run_command(tmp_path)
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr == "passloc: this needs the 'train' extra: pip install 'passloc[train]'\n"


def test_status_of_the_command_line_is_the_exit_status(tmp_path: Path) -> None:
    write_package(tmp_path / "agents", "passloc agents.")
    cli = "def main():\n    print('ran')\n    return 3\n"
    write_package(tmp_path / "training", "passloc training.", cli=cli)
    result = run_command(tmp_path)
    assert (result.returncode, result.stdout, result.stderr) == (3, "ran\n", "")


@pytest.mark.parametrize(
    ("extra", "module"), [(extra, name) for extra, names in launcher.EXTRAS.items() for name in sorted(names)]
)
def test_every_module_of_an_extra_is_recognised(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], extra: str, module: str
) -> None:
    replace_cli(monkeypatch, raising(ModuleNotFoundError(name=module)))
    with pytest.raises(SystemExit) as exit_info:
        launcher.main()
    assert exit_info.value.code == 2
    assert f"passloc[{extra}]" in capsys.readouterr().err


@pytest.mark.parametrize(
    "error",
    [
        ModuleNotFoundError("a library of the core", name="yaml"),
        ModuleNotFoundError("an incomplete library", name="torch.nn"),
        ModuleNotFoundError("a slip in passloc itself", name="training.mistyped"),
        ImportError("a library that is there but broken", name="torch"),
        RuntimeError("anything else"),
    ],
)
def test_other_errors_propagate(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    replace_cli(monkeypatch, raising(error))
    with pytest.raises(type(error)) as raised:
        launcher.main()
    assert raised.value is error


@pytest.mark.parametrize("extra", launcher.EXTRAS)
def test_module_names_agree_with_the_declared_extra(extra: str) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    other_names = {"pygame_ce": "pygame", "pillow": "PIL", "ray[default]": "ray"}
    declared = [text.partition(">")[0].replace("-", "_") for text in project["optional-dependencies"][extra]]
    assert {other_names.get(name, name) for name in declared} == launcher.EXTRAS[extra]
