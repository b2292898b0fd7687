"""The agent never sees the truth: equal measurements give equal observations and beliefs, whatever is true."""

import ast
import dataclasses
import inspect

import numpy as np
import pytest

from agents import PLANNER_NAMES, RULE_NAMES, TruthKnowing, find_policy, rules_for
from passloc_env import SCENARIOS, LocalisationVectorEnv, belief
from passloc_env.errors import InputError
from passloc_env.target import PolarStart
from passloc_env.tracking import RangePrior

SIZE = 5
FROM_MEASUREMENT_ALONE = [name for name, scenario in SCENARIOS.items() if isinstance(scenario.prior, RangePrior)]


def build(name, **overrides):
    overrides = {"episode.early_end": False, "episode.steps": 12 * SCENARIOS[name].episode.decision_every, **overrides}
    return LocalisationVectorEnv(SIZE, name, overrides=overrides, autoreset_mode="Disabled", diagnostics=True)


def record(env, heard):
    """Keep every measurement that the environment makes."""
    (world,) = env.batch.tiles
    world.straight = False
    measure = world.measure

    def listen(scene, *columns):
        heard.append(measure(scene, *columns))
        return heard[-1]

    world.measure = listen


def replay(env, heard):
    """Let the environment hear what another one has heard."""
    (world,) = env.batch.tiles
    world.straight = False
    remaining = iter(heard)
    world.measure = lambda scene, *columns: next(remaining)


def displace(env):
    """Put every emitter elsewhere, at another speed."""
    (world,) = env.batch.tiles
    world.truth *= -0.7


def assert_equal_beliefs(ours, theirs, assert_same):
    for field in ("time", "time_left", "mean", "covariance", "last_action", "range", "line_of_sight", "bearing"):
        assert_same(getattr(ours, field), getattr(theirs, field), field)
    for field in ("position", "velocity", "acceleration", "attitude", "attitude_rate"):
        assert_same(getattr(ours.poses[0], field).copy(), getattr(theirs.poses[0], field).copy(), field)


def assert_blind(first, second, heard, actions, assert_same):
    """Both have just been reset alike; from here on the second hears what the first hears."""
    stream = actions(SIZE, first.scenario.action_size)
    for _ in range(12):
        action = next(stream)
        heard.clear()
        ours = first.step(action)
        replay(second, heard)
        theirs = second.step(action)
        assert_same(theirs[0], ours[0], "observation")
        assert_equal_beliefs(second.belief, first.belief, assert_same)
        assert_same(theirs[3], ours[3], "truncated")
        assert (theirs[4]["truth"] != ours[4]["truth"]).any(axis=1).all()
        assert (theirs[1] != ours[1]).all()


@pytest.mark.parametrize("name", FROM_MEASUREMENT_ALONE)
def test_from_the_first_measurement_on(name, actions, assert_same):
    assert isinstance(SCENARIOS[name].target.start, PolarStart)
    first, heard = build(name), []
    second = build(
        name,
        **{
            "target.start.range": 77e3,
            "target.start.speed": 12.0,
            "target.start.bearing": 0.3,
            "episode.min_range": 1e3,
        },
    )
    record(first, heard)
    ours = first.reset(seed=6)
    replay(second, heard)
    theirs = second.reset(seed=6)
    assert_same(theirs[0], ours[0])
    assert (theirs[1]["range"] != ours[1]["range"]).all()
    assert_blind(first, second, heard, actions, assert_same)


@pytest.mark.parametrize("name", SCENARIOS)
def test_after_the_prior(name, actions, assert_same):
    first, second, heard = build(name), build(name), []
    assert_same(first.reset(seed=6), second.reset(seed=6))
    record(first, heard)
    displace(second)
    assert_blind(first, second, heard, actions, assert_same)


def test_measurements_do_matter(actions):
    """Control: without the replay the displaced emitter is heard, and seen."""
    first, second = build("BearingsOnly"), build("BearingsOnly")
    first.reset(seed=6)
    second.reset(seed=6)
    displace(second)
    action = next(actions(SIZE))
    assert (first.step(action)[0] != second.step(action)[0]).any(axis=1).all()


@pytest.mark.parametrize("planner", PLANNER_NAMES)
def test_planners_see_the_belief(planner):
    """Nobody finds the truth in a belief: those who need it are told, and their names say so."""
    first, second = build("BearingsOnly"), build("BearingsOnly")
    observation = first.reset(seed=6)[0]
    second.reset(seed=6)
    displace(second)
    policy = find_policy(planner, first.scenario)
    assert isinstance(policy, TruthKnowing) == planner.endswith("-truth") == policy.name.split()[0].endswith("-truth")
    if not isinstance(policy, TruthKnowing):
        ours, theirs = (policy.act(observation, env.belief, np.random.default_rng(0)) for env in (first, second))
        assert ours.tobytes() == theirs.tobytes()
        return
    for env in (first, second):
        with pytest.raises(InputError, match="tells it the truth"):
            policy.act(observation, env.belief, np.random.default_rng(0))


def test_rules_are_never_told():
    found = [find_policy(name, scenario) for scenario in SCENARIOS.values() for name in rules_for(scenario)]
    assert {policy.name.split()[0] for policy in found} == set(RULE_NAMES)
    assert not any(isinstance(policy, TruthKnowing) for policy in found)


def test_belief_has_no_word_for_the_truth():
    names = {node.attr for node in ast.walk(ast.parse(inspect.getsource(belief))) if isinstance(node, ast.Attribute)}
    names |= {node.id for node in ast.walk(ast.parse(inspect.getsource(belief))) if isinstance(node, ast.Name)}
    names |= {field.name for field in dataclasses.fields(belief.Belief)}
    assert "covariance" in names
    assert not names & {"truth", "truth_layout", "simulation", "Simulation", "outcome", "information"}
    assert list(inspect.signature(belief.BeliefFeatures.observe).parameters) == ["self", "belief"]
    assert np.isfinite(belief.OBSERVATION_LIMIT)
