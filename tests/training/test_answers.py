"""How commands answer: to people, to machines, to those who want silence, and to those who interrupt."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3")

from ctrl_c import heed_ctrl_c

from agents import AgentFile
from passloc_env import SCENARIOS
from passloc_env.scenarios import environment_id
from training import cli, files
from training.arguments import file_stem
from training.commands import COMMANDS, GROUPS
from training.completion import completion_script
from training.curve import COLUMNS, read_curve
from training.parsing import described, options, parse
from training.progress import console

ROOT = Path(__file__).parents[2]
EVALUATE = ("evaluate", "--policies", "circle", "--episodes", "2", "--override", "episode.steps=8")


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(console, "width", 200)


def test_machines_get_json_alone_on_standard_output(capsys):
    assert cli.main([*EVALUATE, "--json", "-"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert [policy["policy"] for policy in data["policies"]] == ["circle"]
    assert cli.main(["list", "--json", "-"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert list(data) == [environment_id(name) for name in SCENARIOS]
    assert data["passloc/BearingsOnly-v0"]["rules"][0] == "stationary"


@pytest.mark.parametrize("word", ["-q", "--quiet"])
def test_quiet_is_silent_and_still_writes(word, capsys, tmp_path):
    assert cli.main([*EVALUATE, word, "--json", "results.json"]) == 0
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "")
    assert json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))["episodes"] == 2
    assert cli.main(EVALUATE) == 0
    assert "circle" in capsys.readouterr().out


def test_what_cannot_be_written_is_told_before_anything_is_flown(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("training.judging.evaluate", lambda *a, **k: pytest.fail("flown before looking"))
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    assert cli.main([*EVALUATE, "--json", "file/results.json"]) == 2
    assert capsys.readouterr().err == "passloc: file is not a folder\n"


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_a_summary_help_and_examples_that_parse(name, capsys):
    summary, _, rest = described(COMMANDS[name].takes).partition("\n")
    assert summary.endswith(".")
    assert len(summary) < 70
    examples = re.findall(r"^ +passloc (\S+) ?(.*)$", rest, re.MULTILINE)
    assert any(command == name for command, _ in examples)
    for command, words in examples:
        parse(command, words.split())
    with pytest.raises(SystemExit) as stop:
        parse(name, ["--help"])
    assert stop.value.code == 0
    out = capsys.readouterr().out
    assert f"usage: passloc {name}" in out
    assert "Examples:" in out
    for option in ("--json", "--quiet", "-q"):
        assert option in out
    module, _, function = COMMANDS[name].answered_by.partition(":")
    assert (ROOT / f"{module.replace('.', '/')}.py").exists() or (ROOT / module.replace(".", "/")).is_dir()
    assert function.isidentifier()


def test_help_names_every_command_once(capsys):
    assert cli.main(["--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 120
    for name in COMMANDS:
        assert sum(line.startswith(f"  {name} ") for line in lines) == 1
    assert [line[:-1] for line in lines if line[:-1] in GROUPS] == list(GROUPS)


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_completion_knows_all_commands_and_their_options(shell):
    script = completion_script(shell)
    assert all(name in script for name in COMMANDS)
    assert all(option.lstrip("-") in script for option in options(COMMANDS["evaluate"].takes) if option != "--scenario")


def test_bash_completes_a_command(tmp_path):
    script = tmp_path / "passloc.bash"
    script.write_text(completion_script("bash"), encoding="utf-8")
    function = re.search(r"complete .*-F (\S+) passloc", script.read_text(encoding="utf-8")).group(1)
    typed = f'source {script}; COMP_WORDS=(passloc eval); COMP_CWORD=1; {function}; echo "${{COMPREPLY[@]}}"'
    done = subprocess.run(["bash", "-c", typed], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["evaluate"]


@pytest.mark.parametrize(
    ("code", "unwanted"),
    [
        ("from training.cli import main; main(['--help'])", {"tyro.conf"}),
        ("from training.cli import main; main(['list'])", set()),
        ("import passloc_env", set()),
    ],
)
def test_what_starts_quickly_does_not_import_what_is_slow(code, unwanted):
    slow = {"gymnasium", "filterpy", "torch", "stable_baselines3", "matplotlib", "pygame", "llvmlite", "plotly"}
    words = [sys.executable, "-c", f"import sys; {code}; print(sorted({slow!r} & set(sys.modules)))"]
    done = subprocess.run(
        words, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(ROOT)}, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"


def interrupted(words, ready, tmp_path):
    """What a command says when Ctrl-C comes as soon as ``ready`` is true: status, standard error."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(
        [sys.executable, "-m", "training.cli", *words],
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        cwd=tmp_path,
        preexec_fn=heed_ctrl_c,
    )
    deadline = time.monotonic() + 120.0
    while not ready() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=120)
    return process.returncode, error


def test_an_interrupted_training_leaves_a_whole_agent_and_says_where(tmp_path):
    curve = tmp_path / "run" / "curve.csv"

    def learning():
        return curve.exists() and curve.read_text(encoding="utf-8").count("\n") > 2

    words = ("train", "BearingsOnly", "--out", "run", "--seed", "3")
    status, error = interrupted(words, learning, tmp_path)
    agent = AgentFile.load(tmp_path / "run")
    decisions = agent.card["training"]["decisions"]
    said = f"passloc: interrupted; saved so far: the agent after {decisions:,} decisions in run\n"
    assert (status, error) == (130, said)
    rows = read_curve(curve)
    assert set(rows) == set(COLUMNS)
    assert rows["decisions"][-1] <= decisions < agent.card["training"]["hyperparameters"]["decisions"]
    assert not [path for path in (tmp_path / "run").rglob("*") if "part" in path.name]


def test_of_many_files_the_folders_are_named():
    files.forget()
    for number in range(3):
        files.note(Path("a") / str(number))
    assert files.saved() == ["a/0", "a/1", "a/2"]
    for number in range(4):
        files.note(Path("b") / str(number))
    assert files.saved() == ["3 files in a", "4 files in b"]
    files.note(Path("b"), "all of it")
    assert files.saved() == ["a/0", "a/1", "a/2", "all of it in b"]


def test_a_command_leaves_nothing_behind_for_the_next(capsys, monkeypatch):
    def interrupt(*arguments, **named):
        raise KeyboardInterrupt

    assert cli.main(["list", "-q", "--json", "a.json"]) == 0
    monkeypatch.setattr("training.judging.evaluate", interrupt)
    assert cli.main(list(EVALUATE)) == 130
    assert capsys.readouterr().err == "passloc: interrupted; nothing was saved\n"
    assert not console.quiet


def test_a_file_appears_whole_or_not_at_all(tmp_path):
    path = tmp_path / "file"

    def broken():
        with files.appearing(path) as partial:
            partial.write_text("half", encoding="utf-8")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        broken()
    assert list(tmp_path.iterdir()) == []
    path.write_text("before", encoding="utf-8")
    with pytest.raises(KeyboardInterrupt):
        broken()
    assert path.read_text(encoding="utf-8") == "before"


def test_links_and_pipes_stay_what_they_are(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "target")
    files.write_whole(tmp_path / "link", "through the link")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text(encoding="utf-8") == "through the link"
    os.mkfifo(tmp_path / "pipe")
    reader = subprocess.Popen(["cat", tmp_path / "pipe"], stdout=subprocess.PIPE, text=True)
    files.write_whole(tmp_path / "pipe", "through the pipe")
    assert reader.communicate(timeout=30)[0] == "through the pipe"
    assert (tmp_path / "pipe").is_fifo()


@pytest.mark.parametrize(
    ("words", "stem"),
    [
        (("BearingsOnly", 3), "BearingsOnly-3"),
        (("zigzag 60° 40 s",), "zigzag-60-40-s"),
        (("a/../../b",), "a-..-..-b"),
        (("..",), ""),
        (("CON: *?<>|",), "CON"),
    ],
)
def test_names_become_files_and_never_paths(words, stem):
    assert file_stem(*words) == stem
