"""The README's examples run as written."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from markdown_blocks import ROOT, blocks, run

from training.cli import main

README = (ROOT / "README.md").read_text(encoding="utf-8")
EXAMPLES = blocks(ROOT / "README.md")


def test_there_are_examples_for_gymnasium_and_stable_baselines3() -> None:
    assert any("gym.make(" in example and "gym.make_vec(" in example for example in EXAMPLES)
    assert any("make_vec_env" in example and "PPO(" in example for example in EXAMPLES)


@pytest.mark.parametrize("example", EXAMPLES, ids=[example.split("\n")[0] for example in EXAMPLES])
def test_example_runs_as_written(example: str, tmp_path: Path) -> None:
    run(example, tmp_path)


@pytest.mark.parametrize("command", sorted(set(re.findall(r"^passloc ([\w-]+)", README, flags=re.MULTILINE))))
def test_command_exists(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main([command, "--help"])
    assert stop.value.code == 0
    assert f"passloc {command}" in capsys.readouterr().out


def test_the_make_targets_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"^make (\w+)", README, flags=re.MULTILINE):
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE)
