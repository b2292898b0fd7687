"""Cards: the scores of an agent are written into its card, and only what is named is shipped."""

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rich")

from agents import AgentFile, LearnedPolicy, find_policy, shipped
from agents.agent_file import CARD, WEIGHTS
from passloc_env import SCENARIOS
from passloc_env.models import observation_names
from training.evaluate import evaluate

SCENARIO = SCENARIOS["OwnShipModerate"]
EPISODES = 6


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A run folder with an agent that always does the same; shipped agents lie elsewhere."""
    monkeypatch.setattr(shipped, "FOLDER", tmp_path / "pretrained")
    names = observation_names(SCENARIO)
    weights = {
        f"actor.0.{kind}": np.full(shape, 0.5 if kind == "bias" else 0.0, np.float32)
        for kind, shape in (("weight", (1, len(names))), ("bias", (1,)))
    }
    card = {
        "architecture": {"actor": [len(names), 1]},
        "observation": list(names),
        "scenario": SCENARIO.to_dict(),
        "training": {"algorithm": "none"},
    }
    folder = tmp_path / "run"
    folder.mkdir()
    AgentFile(weights, card).save(folder)
    return folder


def test_scores_are_those_of_an_evaluation(run, passloc):
    status, out, err = passloc("card", str(run), "--episodes", str(EPISODES), "--seed", "900")
    assert (status, err) == (0, "")
    agent = AgentFile.load(run)
    assert agent.flies == ("OwnShipModerate",)
    (entry,) = agent.card["scores"]
    policies = [find_policy("circle", SCENARIO), LearnedPolicy.load(run)]
    circle, own = evaluate(SCENARIO, policies, EPISODES, 900).verdicts
    for name in ("log_range_bound", "violations", "end_error", "end_rms", "advantage"):
        assert entry[name] == vars(getattr(own, name))
    assert entry["reference"]["log_range_bound"] == vars(circle.log_range_bound)
    assert (entry["seed"], entry["episodes"], entry["tracker"]) == (900, EPISODES, "RangeBank")
    assert agent.card["training"] == {"algorithm": "none"}
    assert f"{own.log_range_bound.value:.3f}" in out
    assert not shipped.FOLDER.exists()


def test_named_agents_are_shipped(run, passloc):
    words = ("--scenarios", "OwnShipModerate, OwnShipSevere", "--episodes", "2", "--name", "OwnShip")
    status, _, err = passloc("card", str(run / CARD), *words)
    assert (status, err) == (0, "")
    assert shipped.shipped_agents() == ("OwnShip",)
    assert shipped.agents_for("OwnShipSevere") == ("OwnShip",)
    for name in (CARD, WEIGHTS):
        assert (shipped.FOLDER / "OwnShip" / name).read_bytes() == (run / name).read_bytes()
    card = json.loads((run / CARD).read_text(encoding="utf-8"))
    assert [entry["scenario"] for entry in card["scores"]] == card["flies"] == ["OwnShipModerate", "OwnShipSevere"]
    assert find_policy("learned", SCENARIOS["OwnShipSevere"]).name == "learned OwnShip"
    status, out, _ = passloc("evaluate", "OwnShipSevere", "--policies", "learned,agent:OwnShip", "--episodes", "2")
    assert status == 0
    assert "learned OwnShip" in out


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (("run", "--episodes", "0"), "at least 1"),
        (("run", "--seed", "-1"), "seed"),
        (("run", "--scenarios", "OwnShipModrate"), "did you mean 'OwnShipModerate'?"),
        (("run", "--scenarios", "CrossFix"), "CrossFix"),
        (("run", "--name", "../elsewhere"), "letters, digits"),
        (("nowhere",), "cannot read"),
    ],
    ids=str,
)
def test_faults_are_one_line_and_change_nothing(run, refused, words, hint):
    before = (run / CARD).read_bytes()
    assert Path(words[0]).exists() == (words[0] == "run")
    assert hint in refused("card", *words)
    assert (run / CARD).read_bytes() == before
    assert not shipped.FOLDER.exists()


def test_scores_of_a_changed_scenario_say_what_was_changed(run, passloc):
    """An agent trained with another tracker is judged with that."""
    words = ("--override", "tracker={type: UnscentedKalman}", "--episodes", "2", "--name", "Plain")
    status, _, err = passloc("card", str(run), *words)
    assert (status, err) == (0, "")
    (entry,) = json.loads((run / CARD).read_text(encoding="utf-8"))["scores"]
    assert (entry["overrides"], entry["tracker"]) == ({"tracker": {"type": "UnscentedKalman"}}, "UnscentedKalman")


@pytest.mark.parametrize(
    ("said", "kept"),
    [
        ("passloc train BearingsOnly --seed 0", "passloc train BearingsOnly --seed 0"),
        ("passloc train X --out runs/a --seed 0", "passloc train X --seed 0"),
        ("passloc train X --out=runs/a", "passloc train X"),
        ("passloc train X --out 'two words/a' --seed 3", "passloc train X --seed 3"),
        ("passloc train X --out '/home/me/it'\"'\"'s' --quiet", "passloc train X --quiet"),
    ],
)
def test_shipped_cards_do_not_say_where_the_run_lay(run, said, kept):
    agent = AgentFile.load(run)
    agent.card["training"]["command"] = said
    agent.save(run)
    shipped.ship(AgentFile.load(run), "Moved")
    assert AgentFile.load(shipped.FOLDER / "Moved").card["training"]["command"] == kept
    assert AgentFile.load(run).card["training"]["command"] == said
