"""What the tests of the command line share."""

from collections.abc import Callable
from pathlib import Path

import pytest

Said = tuple[int, str, str]


@pytest.fixture
def logs_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """SB3 would leave a log folder in the system's temporary one."""
    monkeypatch.setenv("SB3_LOGDIR", str(tmp_path / "logs"))


@pytest.fixture
def passloc(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Said]:
    """Runs a command in this process and a folder of its own: its status, standard output and standard error."""
    from training import cli
    from training.progress import console

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(console, "width", 200)

    def passloc(*words: str) -> Said:
        try:
            status = cli.main(list(words))
        except SystemExit as exit_:
            status = int(exit_.code or 0)
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return passloc


@pytest.fixture
def refused(passloc: Callable[..., Said]) -> Callable[..., str]:
    """Runs a command that must fail before it does anything: the one line on standard error."""

    def refused(*words: str) -> str:
        status, out, err = passloc(*words)
        assert (status, out) == (2, "")
        assert err.startswith("passloc: ")
        assert err.count("\n") == 1
        assert err.endswith("\n")
        return err

    return refused
