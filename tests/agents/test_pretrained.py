"""Shipped agents: found by name and by scenario, and each as good as its card says."""

import json
import math

import numpy as np
import pytest
from scipy import stats

pytest.importorskip("rich")

import agents
from agents import AgentFile, AgentFileError, LearnedPolicy, find_policy, shipped
from agents.agent_file import CARD, WEIGHTS
from passloc_env import SCENARIOS
from passloc_env.models import observation_names
from passloc_env.tracking import InteractingModels
from training.card import scores
from training.evaluate import evaluate

SCENARIO = SCENARIOS["BearingsOnly"]
OWN_SHIP = SCENARIOS["OwnShipModerate"]

AGAIN = 200
"""Episodes of each card that are flown again."""

DEVIATIONS = 4.0
"""A true card fails with probability 6e-5 per mean (normal, both sides)."""

RARE = 1e-4
"""Likewise for a count of violations, each side, when the rate lies within the card's interval. Seeds are fixed: a card
that passes once always does, but for the last bits of another processor."""


def fault(entry, policy):
    """What is no longer true of an entry of a card, in words; empty when all of it is."""
    scenario = SCENARIOS[entry["scenario"]].override(entry.get("overrides", {}))
    if type(scenario.tracker).__name__ != entry["tracker"]:
        return "tracker"
    again = min(AGAIN, entry["episodes"])
    reference = find_policy(entry["reference"]["policy"], scenario)
    evaluation = evaluate(scenario, [reference, policy], again, entry["seed"])
    for verdict, written in zip(evaluation.verdicts, (entry["reference"], entry), strict=True):
        for name in ("log_range_bound", "end_rms"):
            if not mean_agrees(getattr(verdict, name).value, written[name], again, entry["episodes"]):
                return f"{name} of {verdict.policy}"
        if not rate_agrees(round(verdict.violations.value * again), written["violations"], again):
            return f"violations of {verdict.policy}"
    return ""


def mean_agrees(value, written, again, episodes):
    """Whether the mean of the first episodes fits that of all.

    The half-width of the 95 % interval gives the spread of one episode, ``σ = half √N / 1.96``; the mean of n episodes
    out of these N differs from that of all by ``σ √(1/n − 1/N)``; an RMS, which is nearly linear in the mean square,
    by about as much. 1e-6: rounding, where nothing else differs.
    """
    spread = (written["high"] - written["low"]) / 2.0 / 1.96 * math.sqrt(episodes)
    return abs(value - written["value"]) <= 1e-6 + DEVIATIONS * spread * math.sqrt(1.0 / again - 1.0 / episodes)


def rate_agrees(count, written, again):
    """Whether so many violations are possible at one of the rates of the card's interval."""
    too_many = stats.binom.sf(count - 1, again, written["high"]) < RARE
    too_few = stats.binom.cdf(count, again, written["low"]) < RARE
    return not (too_many or too_few)


def test_agents_are_shipped_and_small():
    """A few hundred kilobytes in all."""
    assert {"BearingDopplerCase1b", "BearingDopplerCase2b", "RadialAcceleration", "DualArray"} <= set(
        shipped.shipped_agents()
    )
    assert sum(path.stat().st_size for path in shipped.FOLDER.rglob("*") if path.is_file()) < 1_000_000


@pytest.mark.parametrize("name", shipped.shipped_agents())
def test_shipped_agents_are_as_good_as_their_cards_say(name):
    agent = AgentFile.load(shipped.FOLDER / name)
    entries = agent.card["scores"]
    assert sorted(agent.flies) == sorted(entry["scenario"] for entry in entries)
    for entry in entries:
        policy = agents.load(name, SCENARIOS[entry["scenario"]].override(entry.get("overrides", {})))
        assert fault(entry, policy) == "", entry["scenario"]


def fake(folder, scenario=SCENARIO, bias=1.0, **more):
    """An agent that always does the same, shipped."""
    names = observation_names(scenario)
    sizes = [len(names), scenario.action_size]
    weights = {
        "actor.0.weight": np.zeros(sizes[::-1], np.float32),
        "actor.0.bias": np.full(sizes[1], bias, np.float32),
    }
    card = {
        "architecture": {"actor": sizes},
        "observation": list(names),
        "scenario": scenario.to_dict(),
        **more,
    }
    folder.mkdir(parents=True)
    AgentFile(weights, card).save(folder)


@pytest.fixture
def fleet(tmp_path, monkeypatch):
    """A folder of shipped agents of its own: two for BearingsOnly, one for the own-ship cases."""
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    fake(tmp_path / "Another", flies=["BearingsOnly", "BearingsOnlyFar"])
    fake(tmp_path / "BearingsOnly")
    fake(tmp_path / "OwnShip", OWN_SHIP, flies=["OwnShipModerate", "OwnShipSevere"])
    (tmp_path / "README.md").write_text("no agent", encoding="utf-8")
    (tmp_path / "half").mkdir()
    return tmp_path


def refusal(what, *arguments):
    with pytest.raises(AgentFileError) as caught:
        what(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_by_name(fleet):
    assert agents.shipped_agents() == ("Another", "BearingsOnly", "OwnShip")
    policy = agents.load("BearingsOnly")
    assert isinstance(policy, LearnedPolicy)
    assert policy.name == "learned BearingsOnly"
    found = find_policy("agent:OwnShip", OWN_SHIP)
    assert found.agent.card == AgentFile.load(fleet / "OwnShip").card


def test_by_scenario(fleet):
    """The agent that bears the scenario's name comes first; without a word an agent flies what it was trained on."""
    assert agents.agents_for("BearingsOnly") == ("BearingsOnly", "Another")
    assert agents.agents_for("BearingsOnlyFar") == ("Another",)
    assert agents.agents_for("OwnShipSevere") == ("OwnShip",)
    assert agents.agents_for("CrossFix") == ()
    assert find_policy("learned", SCENARIO).name == "learned BearingsOnly"
    assert find_policy("learned", SCENARIOS["BearingsOnlyFar"]).name == "learned Another"


def test_of_several_agents_the_first_that_fits_flies(fleet):
    """Interacting models hold more states: the agent that bears the scenario's name sees something else there."""
    interacting = SCENARIO.override({"tracker": InteractingModels()})
    assert "which are not the same" in refusal(find_policy, "learned", interacting)
    fake(fleet / "Manoeuvres", interacting)
    assert find_policy("learned", SCENARIO).name == "learned BearingsOnly"
    assert find_policy("learned", interacting).name == "learned Manoeuvres"


def test_refusals_are_one_line(fleet, monkeypatch, tmp_path):
    assert "did you mean 'BearingsOnly'?" in refusal(agents.load, "BearingOnly")
    assert "did you mean 'OwnShip'?" in refusal(find_policy, "agent:OwnShop", OWN_SHIP)
    assert "known: Another, BearingsOnly, OwnShip" in refusal(agents.load, "../half")
    message = refusal(find_policy, "learned", SCENARIOS["CrossFix"])
    assert "CrossFix" in message
    assert "BearingsOnlyFar, OwnShipModerate, OwnShipSevere" in message
    monkeypatch.setattr(shipped, "FOLDER", tmp_path / "half")
    assert "no agents are shipped" in refusal(agents.load, "BearingsOnly")


@pytest.mark.parametrize("flies", ["BearingsOnly", [1], {}])
def test_cards_must_name_scenarios(fleet, flies):
    path = fleet / "Another" / CARD
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")) | {"flies": flies}), encoding="utf-8")
    assert "flies must be a list of names" in refusal(agents.load, "Another")


def test_shipping_replaces(fleet):
    agent = AgentFile.load(fleet / "OwnShip")
    assert shipped.ship(agent, "BearingsOnly") == fleet / "BearingsOnly"
    assert shipped.ship(agent, "New") == fleet / "New"
    assert {path.name for path in (fleet / "New").iterdir()} == {CARD, WEIGHTS}
    assert agents.load("BearingsOnly").agent.card == agent.card


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    """An agent with more episodes on its card than are flown again."""
    folder = tmp_path_factory.mktemp("fleet") / "Judged"
    fake(folder, OWN_SHIP)
    policy = LearnedPolicy.load(folder)
    return policy, scores(policy, OWN_SHIP, 2 * AGAIN, seed=70_000)


def test_a_true_card_passes(judged):
    policy, entry = judged
    assert (entry["scenario"], entry["seed"], entry["episodes"]) == ("OwnShipModerate", 70_000, 400)
    assert entry["tracker"] == "RangeBank"
    assert entry["reference"]["policy"] == "circle"
    assert entry["advantage"]["value"] == pytest.approx(
        entry["log_range_bound"]["value"] - entry["reference"]["log_range_bound"]["value"], abs=1e-12
    )
    assert json.loads(json.dumps(entry, allow_nan=False)) == entry
    assert fault(entry, policy) == ""


def shifted(estimate, by):
    return {name: value + by for name, value in estimate.items()}


def test_an_untrue_card_is_caught(judged):
    """Sabotage: better by a quarter, for the agent and for the reference; no violations; all violations; tracker."""
    policy, entry = judged
    reference = entry["reference"]
    better = entry | {"log_range_bound": shifted(entry["log_range_bound"], -0.25)}
    assert fault(better, policy) == f"log_range_bound of {policy.name}"
    worse = entry | {"reference": reference | {"log_range_bound": shifted(reference["log_range_bound"], 0.25)}}
    assert fault(worse, policy) == "log_range_bound of circle"
    always = {"value": 1.0, "low": 0.98, "high": 1.0}
    never = {"value": 0.0, "low": 0.0, "high": 0.01}
    wrong = never if entry["violations"]["value"] > 0.5 else always
    assert fault(entry | {"violations": wrong}, policy) == f"violations of {policy.name}"
    assert fault(entry | {"tracker": "UnscentedKalman"}, policy) == "tracker"


def test_another_agent_does_not_pass_for_this_one(judged, tmp_path):
    """It flies straight at the emitter's other side: nothing else on the card is changed."""
    fake(tmp_path / "other", OWN_SHIP, bias=0.0)
    assert fault(judged[1], LearnedPolicy.load(tmp_path / "other")) != ""


@pytest.mark.parametrize("seed", range(3))
def test_the_mean_of_a_part_differs_as_much_as_theory_says(seed):
    """Independent of any policy: 2000 parts of a finite population; their spread within 5 σ, of 1.6 % each."""
    rng = np.random.default_rng(seed)
    values = rng.normal(-3.0, 0.7, 1000)
    means = np.array([rng.choice(values, AGAIN, replace=False).mean() for _ in range(2000)])
    expected = values.std() * math.sqrt(1.0 / AGAIN - 1.0 / 1000)
    assert means.std() == pytest.approx(expected, rel=5.0 * 0.016)
