"""Scenario files to begin with: the scenario itself, with words that explain it."""

from pathlib import Path

import pytest

from passloc_env import SCENARIOS, Scenario
from training.cli import main
from training.starter import starter


@pytest.mark.parametrize("name", SCENARIOS)
def test_it_is_the_scenario(name: str) -> None:
    text = starter(SCENARIOS[name], name, "mine.yaml")
    assert Scenario.from_yaml(text) == SCENARIOS[name]


def test_every_field_is_explained() -> None:
    text = starter(SCENARIOS["BearingDoppler"], "BearingDoppler", "mine.yaml")
    lines = [line for line in text.splitlines() if not line.startswith("#") and "type: " not in line.partition("{")[0]]
    assert len(lines) > 40
    assert all("  # " in line for line in lines)
    assert any("sigma: 10.0  # " in line and line.endswith(", Hz") for line in lines)


def test_the_file_is_written_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "new" / "mine.yaml"
    assert main(["new-scenario", str(path), "--like", "passloc/BearingDoppler-v0"]) == 0
    scenario = Scenario.from_file(path)
    assert scenario == SCENARIOS["BearingDoppler"].override({"name": "mine"})
    before = path.read_bytes()
    assert main(["new-scenario", str(path)]) == 2
    assert "is there already" in capsys.readouterr().err
    assert path.read_bytes() == before


def test_a_wrong_name_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new-scenario", str(tmp_path / "mine.yaml"), "--like", "BearingDopler"]) == 2
    assert "did you mean 'BearingDoppler'?" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
