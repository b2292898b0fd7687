"""The command line: what it prints, what it writes, and one line on standard error for what it cannot do."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3")

from agents import rules_for
from passloc_env import SCENARIOS
from passloc_env.scenarios import environment_id
from training import cli
from training.progress import console
from training.scenario_words import sensor_names, summary

ROOT = Path(__file__).parents[2]
UNWRITABLE = pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a folder that nobody may write into")
QUICK = ("--override", "episode.steps=8")
YAML = "decisions: 64\nenvironments: 4\nrollout: 8\nbatch_size: 16\nepochs: 1\nnetwork: [4]\n"


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    """Commands write where they are called, and tables have room."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(console, "width", 200)
    (tmp_path / "tiny.yaml").write_text(YAML, encoding="utf-8")


@pytest.fixture
def passloc(capsys):
    """Runs a command in this process: its status, standard output and standard error."""

    def passloc(*words):
        try:
            status = cli.main(list(words))
        except SystemExit as exit_:
            status = exit_.code
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return passloc


@pytest.fixture
def refused(passloc):
    """Runs a command that must fail: the one line on standard error."""

    def refused(*words):
        status, out, err = passloc(*words)
        assert (status, out) == (2, "")
        assert err.startswith("passloc: ")
        assert err.count("\n") == 1
        assert err.endswith("\n")
        return err

    return refused


def in_a_process(*words, module="training.cli"):
    """The same as a user would type it, with no terminal."""
    command = [sys.executable, "-m", module, *words]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "100"}
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=300, check=False)


def test_list_names_every_scenario_with_its_figures_and_rules(passloc):
    status, out, err = passloc("list")
    assert (status, err) == (0, "")
    lines = out.splitlines()
    ends = set()
    for name, scenario in SCENARIOS.items():
        (number,) = (i for i, line in enumerate(lines) if line.startswith(environment_id(name) + " "))
        figures, sensors = re.fullmatch(r"(\S+ +\d+ s +\d+ s)  (.*)", lines[number]).groups()
        ends.add(len(figures))
        assert figures.split()[1:] == f"{scenario.episode.duration:g} s {scenario.episode.interval:g} s".split()
        assert sensors == sensor_names(scenario)
        assert lines[number + 1].strip() == summary(scenario)
        (number,) = (i for i, line in enumerate(lines) if re.match(rf"rules for .*\b{name}\b", line))
        assert tuple(lines[number + 1].strip().split(", ")) == rules_for(scenario)
    assert len(ends) == 1
    assert "PhaseDifference ×4, TimeDifference" in out


def test_results_make_their_folder(passloc, tmp_path):
    words = ("evaluate", "--policies", "circle", "--episodes", "2", "--json", "new/deep/results.json")
    assert passloc(*words, *QUICK)[0] == 0
    assert [path.name for path in (tmp_path / "new" / "deep").iterdir()] == ["results.json"]


def test_evaluate_prints_a_table_and_writes_the_file(passloc, tmp_path):
    words = ("evaluate", "BearingsOnly", "--policies", "circle, straight", "--episodes", "6", "--json", "results.json")
    status, out, err = passloc(*words, *QUICK)
    assert (status, err) == (0, "")
    assert "BearingsOnly: 6 episodes, seeds 1000000–1000005" in out
    assert "circle" in out
    assert "straight" in out
    data = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert [policy["policy"] for policy in data["policies"]] == ["circle", "straight"]
    assert (data["episodes"], data["seed"], data["scenario"]["episode"]["steps"]) == (6, 1_000_000, 8)
    value = data["policies"][0]["log_range_bound"]["value"]
    assert f"{value:.3f}" in out


def test_evaluate_judges_every_rule_by_default(passloc):
    status, out, _ = passloc("evaluate", "passloc/OwnShipModerate-v0", "--episodes", "2", "--seed", "7", *QUICK)
    assert status == 0
    assert "seeds 7–8" in out
    for name in ("stationary", "random", "perpendicular", "fly-at", "legs"):
        assert name in out
    assert out.count("zigzag") == 4


def test_evaluate_reads_scenario_files(passloc, tmp_path):
    (tmp_path / "mine.yaml").write_text("name: Mine\nepisode: {steps: 8}\n", encoding="utf-8")
    status, out, _ = passloc("evaluate", "mine.yaml", "--policies", "circle", "--episodes", "2")
    assert status == 0
    assert "Mine: 2 episodes" in out


def test_train_then_evaluate_the_agent(passloc, tmp_path):
    words = ("--hyperparameters", "tiny.yaml", "--override", "episode.steps=8", "sensors.0.sigma=1e-2")
    status, out, err = passloc("train", "BearingsOnly", "--seed", "2", *words)
    assert (status, err) == (0, "")
    assert "runs/BearingsOnly-2" in out
    card = json.loads((tmp_path / "runs/BearingsOnly-2/agent.json").read_text(encoding="utf-8"))
    assert card["scenario"]["sensors"][0]["sigma"] == 0.01
    status, out, err = passloc(
        "evaluate", "BearingsOnly", "--policies", "runs/BearingsOnly-2,circle", "--episodes", "4", *QUICK
    )
    assert (status, err) == (0, "")
    assert "BearingsOnly-2" in out


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (("evaluate", "BearingOnly"), "did you mean 'BearingsOnly'?"),
        (("train", "OwnShipModrate"), "did you mean 'OwnShipModerate'?"),
        (("evaluate", "nowhere.yaml"), "cannot be read"),
        (("evaluate", "."), "no such scenario"),
        (("evaluate", "tiny.yaml"), "decisions"),
        (("evaluate", "--policies", "cirle"), "did you mean 'circle'?"),
        (("evaluate", "--policies", "circle,"), "policy"),
        (("evaluate", "--policies", "zigzag:leg=x"), "name=number"),
        (("evaluate", "--policies", "legs"), "no legs were published"),
        (("evaluate", "--policies", "./"), "is not a run folder"),
        (("evaluate", "--policies", "nowhere/agent.json"), "cannot read"),
        (("evaluate", "--override", "episode.stepz=8"), "did you mean 'steps'?"),
        (("evaluate", "--override", "episode.steps"), "dotted.name=value"),
        (("evaluate", "--override", "episode.steps=["), "not readable YAML"),
        (("evaluate", "--override", "episode.steps=-1"), "at least 1"),
        (("evaluate", "--episodes", "0"), "at least 1"),
        (("evaluate", "--episodes", "-3"), "at least 1"),
        (("evaluate", "--episodes", "2", "--policies", "circle", "--seed", "-1", *QUICK), "seed"),
        (("evaluate", "--json", "tiny.yaml/results.json"), "tiny.yaml is not a folder"),
        pytest.param(("evaluate", "--json", "/proc/self/results.json"), "cannot be written into", marks=UNWRITABLE),
        pytest.param(("train", "--out", "/proc/self/run"), "cannot be written into", marks=UNWRITABLE),
        (("evaluate", "--episodes", "2", "--policies", "circle", "--json", ".", *QUICK), "."),
        (("train", "--decisions", "0"), "decisions"),
        (("train", "--hyperparameters", "nowhere.yaml"), "cannot read"),
        (("train", "--hyperparameters", "tiny.yaml", "--seed", "-1", "--quiet", *QUICK), "seed"),
        (("train", "--hyperparameters", "tiny.yaml", "--out", "."), "--out"),
        (("train", "--hyperparameters", "tiny.yaml", "--out", "tiny.yaml"), "tiny.yaml"),
        (("demo", "--out", "."), "--out"),
        (("demo", "--decisions", "-1"), "decisions"),
        (("demo", "--episodes", "0"), "at least 1"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_faults_are_one_line(refused, words, hint, monkeypatch):
    # What is refused must be refused at once, not after minutes of training.
    if words[0] == "demo":
        monkeypatch.setattr("training.demo.run", lambda *arguments, **named: pytest.fail("trained before looking"))
    assert hint in refused(*words)


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (("evalute",), "no command is called 'evalute'; did you mean 'evaluate'?"),
        (("evaluate", "--episode", "3"), "did you mean '--episodes'?"),
        (("evaluate", "BearingsOnly", "CrossFix"), "evaluate does not know 'CrossFix'"),
        (("train", "--seed", "one"), "train: Error parsing --seed: invalid literal for int()"),
        (("new-scenario",), "Missing from passloc new-scenario: PATH"),
        (("completion", "powershell"), "('bash', 'zsh', 'tcsh')"),
        ((), "name a command: list, new-scenario"),
    ],
    ids=str,
)
def test_typos_in_words_are_usage_errors(refused, words, hint):
    assert hint in refused(*words)


@pytest.mark.parametrize("words", [("--help",), ("train", "--help"), ("evaluate", "--help"), ("demo", "--help")])
def test_help(passloc, words):
    status, out, err = passloc(*words)
    assert (status, err) == (0, "")
    assert "passloc" in out
    assert len(out.splitlines()) > 10


def test_an_interrupt_is_no_crash(passloc, monkeypatch):
    def interrupt(*arguments, **named):
        raise KeyboardInterrupt

    monkeypatch.setattr("training.judging.evaluate", interrupt)
    said = "passloc: interrupted; nothing was saved\n"
    assert passloc("evaluate", "--episodes", "2", "--policies", "circle") == (130, "", said)


def test_being_terminated_is_no_crash(passloc, monkeypatch):
    def terminate(*arguments, **named):
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr("training.judging.evaluate", terminate)
    said = "passloc: terminated; nothing was saved\n"
    assert passloc("evaluate", "--episodes", "2", "--policies", "circle") == (143, "", said)
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_bugs_are_not_hidden(monkeypatch):
    """What is no fault of the input keeps its traceback."""

    def broken(*arguments, **named):
        raise ZeroDivisionError("bug")

    monkeypatch.setattr("training.judging.evaluate", broken)
    with pytest.raises(ZeroDivisionError):
        cli.main(["evaluate", "--episodes", "2", "--policies", "circle"])


def test_in_a_process_of_its_own(tmp_path):
    done = in_a_process("evaluate", "--policies", "circle", "--episodes", "2", "--json", "a b.json", *QUICK)
    assert (done.returncode, done.stderr) == (0, "")
    assert "circle" in done.stdout
    data = json.loads((tmp_path / "a b.json").read_text(encoding="utf-8"))
    words = "evaluate --policies circle --episodes 2 --json 'a b.json' --override episode.steps=8"
    assert data["provenance"]["command"] == f"python -m training.cli {words}"


def test_faults_in_a_process_of_its_own():
    done = in_a_process("evaluate", "BearingOnly")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert "did you mean 'BearingsOnly'?" in done.stderr


def test_python_m_training_train():
    done = in_a_process("--help", module="training.train")
    assert (done.returncode, done.stderr) == (0, "")
    for option in ("--decisions", "--seed", "--out", "--hyperparameters", "--override"):
        assert option in done.stdout


def test_arguments_load_fast():
    """Help must not wait for PyTorch."""
    code = "import sys, training.cli; print(sorted({'torch', 'stable_baselines3', 'matplotlib'} & set(sys.modules)))"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    assert done.stdout == "[]\n"
