"""Policies by name: what exists, how parameters are given, and one helpful line for what does not."""

import json

import numpy as np
import pytest

from agents import (
    PLANNER_NAMES,
    RULE_NAMES,
    AgentFile,
    LearnedPolicy,
    Policy,
    PolicyError,
    default_policies,
    find_policy,
)
from agents.agent_file import CARD, WEIGHTS
from passloc_env import SCENARIOS, LocalisationVectorEnv
from passloc_env.models import observation_names

SCENARIO = SCENARIOS["BearingsOnly"]
OWN_SHIP = SCENARIOS["OwnShipModerate"]
STRANGE = {"target.start.range": {"type": "Uniform", "low": 30e3, "high": 31e3}, "name": "Strange"}


def agent_for(scenario, folder):
    """An agent that always does the same, in a folder of its own."""
    names = observation_names(scenario)
    sizes = [len(names), scenario.action_size]
    weights = {
        f"actor.0.{kind}": np.zeros(shape, np.float32) for kind, shape in (("weight", (1, sizes[0])), ("bias", (1,)))
    }
    card = {
        "architecture": {"actor": sizes},
        "observation": list(names),
        "scenario": scenario.to_dict(),
    }
    folder.mkdir()
    AgentFile(weights, card).save(folder)
    return folder


def refusal(text, scenario=SCENARIO):
    """The one-line message with which ``find_policy`` refuses."""
    with pytest.raises(PolicyError) as caught:
        find_policy(text, scenario)
    message = str(caught.value)
    assert "\n" not in message
    assert caught.value.__suppress_context__ or caught.value.__context__ is None
    return message


@pytest.mark.parametrize("name", RULE_NAMES + PLANNER_NAMES)
def test_every_name_finds_a_policy(name):
    policy = find_policy(name, SCENARIOS["DualSatellite"] if name in ("yaw", "roll") else OWN_SHIP)
    assert isinstance(policy, Policy)
    assert policy.name.split()[0] == name


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_default_table_can_be_flown_and_repeats_nobody(name):
    """Legs where they were published, headings where they can be chosen, body rates where bodies can be turned."""
    scenario = SCENARIOS[name]
    names = default_policies(scenario)
    assert ("legs" in names) == name.startswith("OwnShip")
    turning = {"yaw", "roll"}
    expected = {"stationary", "random", *turning} if name == "DualSatellite" else set(RULE_NAMES) - turning - {"legs"}
    assert {text.split(":")[0] for text in names} - {"legs"} == expected
    policies = [find_policy(text, scenario) for text in names]
    assert len({policy.name for policy in policies}) == len(policies)
    for policy in policies:
        env = LocalisationVectorEnv(2, scenario, overrides=policy.overrides)
        observation, _ = env.reset(seed=0)
        actions = policy.act(observation, env.belief, np.random.default_rng(0))
        assert actions.shape == (2, scenario.action_size)
        assert np.isfinite(env.step(actions)[0]).all()


@pytest.mark.parametrize(
    ("text", "angle", "leg"),
    [
        ("zigzag", 60.0, 40.0),
        ("zigzag:angle=45", 45.0, 40.0),
        ("zigzag:leg=80:angle=45", 45.0, 80.0),
        ("zigzag:angle=1.05e2:leg=480", 105.0, 480.0),
    ],
)
def test_parameters(text, angle, leg):
    policy = find_policy(text, SCENARIO)
    assert (policy.angle, policy.leg) == (angle, leg)
    assert policy.name == f"zigzag {angle:g}° {leg:g} s"


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("greedy", "greedy D"),
        ("greedy:objective=A", "greedy A"),
        ("greedy-truth:objective=range:grid=16", "greedy-truth range"),
        ("horizon", "horizon range 48 s"),
        ("horizon:seconds=480:margin=2", "horizon range 8 min"),
        ("horizon:objective=D:over=end:seconds=24", "horizon D end 24 s"),
        ("horizon-truth:seconds=96", "horizon-truth range 96 s"),
        ("shrinking:legs=3:looks=20:generations=2:caution=10", "shrinking range"),
        ("shrinking-truth:objective=A", "shrinking-truth A"),
    ],
)
def test_planners_by_name(text, name):
    assert find_policy(text, SCENARIO).name == name


def test_parameters_of_planners():
    policy = find_policy("horizon:seconds=96:margin=2:caution=5:legs=3:looks=6:generations=4:over=end", SCENARIO)
    assert (policy.seconds, policy.legs, policy.looks, policy.generations) == (96.0, 3, 6, 4)
    assert (policy.criterion.margin, policy.criterion.caution, policy.criterion.span) == (2.0, 5.0, "end")
    assert find_policy("horizon", OWN_SHIP).seconds == 720.0
    assert find_policy("horizon", SCENARIOS["CrossFix"]).generations == 3


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("greedy:objective=E", "objective must be one of range, A, D"),
        ("horizon:over=start", "over must be one of mean, end"),
        ("horizon:seconds=0", "seconds must be a finite number above 0"),
        ("horizon:seconds=inf", "seconds must be a finite number above 0"),
        ("horizon:margin=-1", "margin must be"),
        ("horizon:caution=nan", "caution must be"),
        ("horizon:legs=1.5", "legs must be a whole number of at least 1"),
        ("shrinking:looks=0", "looks must be a whole number of at least 1"),
        ("shrinking:generations=-1", "generations must be a whole number of at least 0"),
        ("greedy:grid=1", "grid must be a whole number of at least 2"),
        ("greedy:seconds=4", "takes no such parameter"),
        ("shrinking:seconds=4", "takes no such parameter"),
        ("horizon:weight=4", "takes no such parameter"),
        ("zigzag:objective=A", "takes no such parameter"),
        ("horizon:seconds=long", "must be name=number"),
    ],
)
def test_an_impossible_planner(text, reason):
    assert reason in refusal(text)


@pytest.mark.parametrize("name", PLANNER_NAMES)
def test_scenarios_that_cannot_be_planned_for(name):
    fixed = SCENARIO.override({"platforms": [{"type": "FixedStation"}]})
    assert "nothing that can be steered" in refusal(name, fixed)


@pytest.mark.parametrize(
    ("text", "close"),
    [
        ("cirle", "circle"),
        ("Straight", "straight"),
        ("flyat", "fly-at"),
        ("zigzgag", "zigzag"),
        ("zigzgag:angle=45:leg=80", "zigzag"),
        ("perpendiclar:angle=45", "perpendicular"),
    ],
)
def test_a_typo_names_the_closest(text, close):
    message = refusal(text)
    assert f"did you mean {close!r}?" in message
    assert all(name in message for name in RULE_NAMES)
    assert repr(text) in message


def test_nothing_close_still_lists_what_there_is():
    message = refusal("xyz")
    assert "did you mean" not in message
    assert all(name in message for name in RULE_NAMES)
    assert "run folder" in message


@pytest.mark.parametrize("text", ["zigzag:angel=45", "circle:rate=3", "straight:x=1", "zigzag:scenario=3", "legs:a=1"])
def test_an_unknown_parameter(text):
    assert "takes no such parameter" in refusal(text, OWN_SHIP)


@pytest.mark.parametrize("text", ["zigzag:angle=wide", "zigzag:angle", "zigzag:", "zigzag:angle=", "zigzag:=3"])
def test_a_malformed_parameter(text):
    message = refusal(text)
    assert "must be name=number" in message or "takes no such parameter" in message
    assert repr(text) in message


@pytest.mark.parametrize("text", ["zigzag:leg=0", "zigzag:leg=-40", "zigzag:leg=nan", "zigzag:angle=inf"])
def test_an_impossible_number(text):
    """A leg of no length has no side, and an angle that is none no heading: better said here than in flight."""
    assert repr(text) in refusal(text)


@pytest.mark.parametrize("name", ["BearingsOnly", "BearingDoppler"])
def test_no_legs_where_none_were_published(name):
    message = refusal("legs", SCENARIOS[name])
    assert name in message
    assert "OwnShipModerate" in message
    assert "OwnShipSevere" in message


def test_legs_belong_to_their_case():
    moderate, severe = (find_policy("legs", SCENARIOS[name]) for name in ("OwnShipModerate", "OwnShipSevere"))
    assert moderate.legs[0] == (0.0, 140.0)
    assert severe.legs == ((0.0, -80.0), (900.0, 146.0))


@pytest.mark.parametrize("part", ["", CARD, WEIGHTS])
def test_an_agent_by_its_folder_or_either_file(part, tmp_path):
    folder = agent_for(SCENARIO, tmp_path / "my agent")
    policy = find_policy(str(folder / part), SCENARIO)
    assert isinstance(policy, LearnedPolicy)
    assert policy.name == "my agent"


def test_an_agent_trained_on_another_scenario_flies_where_it_sees_the_same(tmp_path):
    folder = agent_for(SCENARIO.override(STRANGE), tmp_path / "agent")
    assert find_policy(str(folder), SCENARIO).agent.scenario.name == "Strange"


def test_a_folder_without_an_agent(tmp_path):
    from agents import AgentFileError

    with pytest.raises(AgentFileError, match=r"is not a run folder: it holds no agent\.json") as caught:
        find_policy(str(tmp_path), SCENARIO)
    assert "\n" not in str(caught.value)


def test_a_folder_called_like_a_rule_does_not_hide_it(tmp_path, monkeypatch):
    """``./circle`` still names the folder."""
    agent_for(SCENARIO, tmp_path / "circle")
    monkeypatch.chdir(tmp_path)
    assert isinstance(find_policy("./circle", SCENARIO), LearnedPolicy)
    assert not isinstance(find_policy("circle", SCENARIO), LearnedPolicy)


def test_saved_cards_are_plain_json(tmp_path):
    card = json.loads((agent_for(SCENARIO, tmp_path / "agent") / CARD).read_text(encoding="utf-8"))
    assert card["format"] == "passloc-agent-1"
    assert card["observation"] == list(observation_names(SCENARIO))


@pytest.mark.parametrize(
    ("scenario", "text", "why"),
    [
        (
            "DualSatellite",
            "circle",
            "no platform of DualSatellite chooses a heading; known: stationary, random, yaw, roll",
        ),
        ("DualSatellite", "zigzag:angle=45", "chooses a heading"),
        ("CrossFix", "yaw", "no platform of CrossFix turns its body"),
        ("CrossFix", "legs", "no legs were published for CrossFix, only for OwnShipModerate, OwnShipSevere"),
    ],
)
def test_rules_that_nothing_can_follow(scenario, text, why):
    """Refused in one line that says once what is not possible, and what is."""
    message = refusal(text, SCENARIOS[scenario])
    assert why in message
    assert message.count("is not possible") == 1


def test_parameters_that_a_policy_takes_are_named():
    assert "known: angle, leg" in refusal("zigzag:angel=4")
    assert "known: none" in refusal("circle:radius=3")
    assert "known: seconds, looks, objective, over, margin, caution, legs, generations" in refusal("horizon:second=4")
