"""Hyperparameter files: what is shipped loads, and what cannot be used is refused in one line."""

import dataclasses
from pathlib import Path

import pytest

from passloc_env import SCENARIOS
from training import hyperparameters
from training.hyperparameters import HyperparameterError, Hyperparameters

SHIPPED = sorted(path for path in Path(hyperparameters.__file__).parent.iterdir() if path.suffix in (".yaml", ".yml"))


def write(tmp_path, text):
    path = tmp_path / "own.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def refusal(path):
    """The one line with which a file is refused."""
    with pytest.raises(HyperparameterError) as caught:
        Hyperparameters.load(path)
    message = str(caught.value)
    assert "\n" not in message
    assert caught.value.__suppress_context__ or caught.value.__context__ is None
    return message


def test_something_is_shipped():
    assert "BearingsOnly.yaml" in [path.name for path in SHIPPED]


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.name)
def test_every_shipped_file_belongs_to_a_scenario_and_fits_it(path):
    parameters = Hyperparameters.load(path)
    names = [path.stem] if path.stem in SCENARIOS else [name for name in SCENARIOS if name.startswith(path.stem)]
    assert names
    for name in names:
        SCENARIOS[name].override(parameters.overrides)
    if names == [path.stem]:
        assert parameters == Hyperparameters.for_scenario(path.stem)
    # Gradient steps need whole batches, and at least one of them per rollout.
    assert parameters.environments * parameters.rollout % parameters.batch_size == 0
    assert parameters.decisions >= parameters.environments * parameters.rollout


def test_a_scenario_without_a_file_gets_the_defaults():
    assert Hyperparameters.for_scenario("NoSuchScenario") == Hyperparameters()


def test_a_family_of_scenarios_shares_a_file(monkeypatch, tmp_path):
    """The longest name that a scenario's begins with; none is the beginning of nothing, and a stranger shares none."""
    monkeypatch.setattr(hyperparameters, "_FOLDER", tmp_path)
    for name, decisions in (("Own", 1), ("OwnShip", 2), ("OwnShipSevere", 3), ("Ship", 4)):
        (tmp_path / f"{name}.yaml").write_text(f"decisions: {decisions}\n")
    found = {
        name: Hyperparameters.for_scenario(name).decisions
        for name in ("OwnShipModerate", "OwnShipSevere", "OwnShipMine", "Owl")
    }
    default = Hyperparameters().decisions
    assert found == {"OwnShipModerate": 2, "OwnShipSevere": 3, "OwnShipMine": default, "Owl": default}


def test_what_a_file_leaves_out_keeps_its_default(tmp_path):
    text = "decisions: 1000\nnetwork: [32, 16, 8]\noverrides: {episode.decision_every: 8}\ndiscount: 1\n"
    loaded = Hyperparameters.load(write(tmp_path, text))
    expected = Hyperparameters(decisions=1000, network=(32, 16, 8), overrides={"episode.decision_every": 8}, discount=1)
    assert loaded == expected
    assert Hyperparameters.load(write(tmp_path, "")) == Hyperparameters()
    assert Hyperparameters.load(write(tmp_path, "# nothing\n")) == Hyperparameters()


def test_files_need_the_safe_loader_only(tmp_path):
    assert "YAML" in refusal(write(tmp_path, "decisions: !!python/object/apply:int ['7']\n"))


@pytest.mark.parametrize("key", ["decision", "lr", "Decisions", "overides", "1"])
def test_unknown_keys(tmp_path, key):
    message = refusal(write(tmp_path, f"{key}: 3\nepochs: 2\n"))
    assert repr(key) in message or f"[{key}]" in message
    assert all(field.name in message for field in dataclasses.fields(Hyperparameters))


def test_several_unknown_keys_of_different_kinds(tmp_path):
    assert "unknown" in refusal(write(tmp_path, "1: 2\nlr: 3\n"))


@pytest.mark.parametrize(
    "line",
    [
        "decisions: 0",
        "decisions: -5",
        "decisions: many",
        "decisions: true",
        "decisions: null",
        "decisions: .nan",
        "decisions: .inf",
        "decisions: 1000.5",
        "environments: 0",
        "environments: 2.5",
        "rollout: 0",
        "rollout: 1.5",
        "batch_size: 0",
        "batch_size: 1",
        "batch_size: 64.5",
        "epochs: 0",
        "epochs: 1.5",
        "learning_rate: 0",
        "learning_rate: -1.0e-3",
        "learning_rate: .inf",
        "reward_scale: 0",
        "reward_scale: [1]",
        "discount: 0",
        "discount: 1.01",
        "discount: high",
        "discount: null",
        "trace_decay: -0.1",
        "trace_decay: .nan",
        "trace_decay: [0.9]",
        "entropy: some",
        "entropy: .nan",
        "initial_log_sigma: wide",
        "initial_log_sigma: .inf",
        "network: 64",
        "network: [0]",
        "network: [64, wide]",
        "network: [64, -1]",
        "network: null",
        "overrides: 3",
        "overrides: [a]",
        "overrides: null",
    ],
)
def test_impossible_values(tmp_path, line):
    """One line that names the field."""
    assert line.split(":")[0] in refusal(write(tmp_path, line + "\n"))


@pytest.mark.parametrize("content", [b"[1, 2]", b"3", b"text", b"a: [", b"a: b: c", b"\xff\xfe\x00\x01", b"\x00"])
def test_what_is_no_mapping(tmp_path, content):
    path = tmp_path / "own.yaml"
    path.write_bytes(content)
    assert "own.yaml" in refusal(path)


def test_files_that_cannot_be_read(tmp_path):
    assert "cannot read" in refusal(tmp_path / "nowhere.yaml")
    assert "cannot read" in refusal(tmp_path)


def test_values_given_in_python_are_checked_too():
    with pytest.raises(HyperparameterError, match="decisions"):
        dataclasses.replace(Hyperparameters(), decisions=0)
