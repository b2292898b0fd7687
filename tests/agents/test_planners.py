"""Planners: the best of what they compare, from the belief alone, the same in any batch."""

import dataclasses
import math

import numpy as np
import pytest

from agents import Policy, TruthKnowing, find_policy
from agents.criterion import OBJECTIVES, Criterion
from agents.forecast import Forecast, Pace, Situation
from agents.planners import Horizon, WithTruth
from passloc_env import SCENARIOS, LocalisationVectorEnv
from passloc_env.angles import wrap
from passloc_env.batch import Batch
from passloc_env.errors import InputError
from passloc_env.platforms import PlanarPose
from passloc_env.sightline import distance
from passloc_env.simulation import Simulation
from training import episodes
from training.episodes import fly

STEERED = [name for name, scenario in SCENARIOS.items() if scenario.action_size]
NAMES = ("greedy", "greedy:objective=A", "horizon", "horizon:objective=D:over=end", "shrinking")
RNG = np.random.default_rng(0)


def environment(name="BearingsOnly", size=6, decisions=3, seed=20, **overrides):
    env = LocalisationVectorEnv(
        size, name, overrides={"episode.early_end": False, **overrides}, autoreset_mode="Disabled"
    )
    observation, _ = env.reset(seed=seed)
    rng = np.random.default_rng(5)
    for _ in range(decisions):
        observation, *_ = env.step(rng.uniform(-1.0, 1.0, (size, env.scenario.action_size)))
    return env, observation


@pytest.mark.parametrize("scenario", STEERED)
@pytest.mark.parametrize("name", NAMES)
def test_every_planner_flies_every_scenario(name, scenario):
    env, observation = environment(scenario, size=2, decisions=1)
    policy = find_policy(name, env.scenario)
    assert isinstance(policy, Policy)
    assert not isinstance(policy, TruthKnowing)
    actions = policy.act(observation, env.belief, RNG)
    assert actions.shape == (2, env.scenario.action_size)
    assert np.abs(actions).max() <= 1.0


def true_cost(env, actions, objective):
    """What one decision of each action comes to by hand: the covariance of the believed world, flown step by step."""
    (world,) = env.batch.tiles
    belief, models = env.belief, world.models.tracker
    (state,) = (p.state_at(pose) for p, pose in zip(belief.platforms, belief.poses, strict=True))
    (platform,) = belief.platforms
    offset = belief.mean[:2] - belief.poses[0].position
    held = platform.set_point(state, actions[None], offset / distance(offset))
    emitter, covariance = belief.mean.copy(), np.moveaxis(belief.covariance, -1, 0).copy()
    transition = models.dynamics.transition.matrix[..., 0]
    noise = models.dynamics.process_noise[..., 0]
    for _ in range(round(belief.interval / belief.period)):
        state = platform.move(state, held, belief.period)
        emitter = transition @ emitter
        east, north = emitter[:2] - state[:2]
        row = np.zeros((len(actions), 1, 4))
        row[:, 0, 0], row[:, 0, 1] = north / (east**2 + north**2), -east / (east**2 + north**2)
        covariance = transition @ covariance @ transition.T + noise
        inverse = np.linalg.inv(covariance) + row.swapaxes(1, 2) @ row / models.suite.noise_covariance[0, 0, 0]
        covariance = np.linalg.inv(inverse)
    place = covariance[:, :2, :2]
    if objective == "D":
        return -0.5 * np.linalg.slogdet(inverse)[1]
    if objective == "A":
        return np.trace(place, axis1=1, axis2=2)
    line = np.stack([east, north]) / np.hypot(east, north)
    return np.log(np.sqrt(np.einsum("iN,Nij,jN->N", line, place, line)) / np.hypot(east, north))


@pytest.mark.parametrize("control", ["heading", "turn_rate"])
@pytest.mark.parametrize("objective", OBJECTIVES)
def test_greedy_picks_the_best_of_the_grid(objective, control):
    """Brute force with plain matrices: what was picked is no worse than any of the grid, to a relative 1e-9."""
    env, observation = environment(**{"platforms.0.control": control, "episode.min_range": 0.0})
    policy = find_policy(f"greedy:objective={objective}:grid=16", env.scenario)
    chosen = policy.act(observation, env.belief, RNG)[:, 0]
    grid = np.arange(16) / 8.0 - 1.0 if control == "heading" else np.linspace(-1.0, 1.0, 16)
    assert set(chosen) <= set(grid)
    costs = np.stack([true_cost(env, np.full(6, action), objective) for action in grid])
    picked = true_cost(env, chosen, objective)
    slack = 1e-9 * np.abs(costs.min(axis=0))
    assert (picked <= costs.min(axis=0) + slack).all()
    assert (costs.max(axis=0) > costs.min(axis=0) + 100.0 * slack).all()


def test_a_horizon_of_one_leg_is_searched_well():
    """Against all 2000 constant actions: what the search leaves is below 2 % of what there is to choose between."""
    env, _ = environment()
    policy = dataclasses.replace(find_policy("horizon:seconds=48:legs=1", env.scenario), generations=4)
    belief = env.belief
    chosen = policy.plan(belief)[:, 0]
    situation, pace = Situation.of(belief), Pace.of(48, policy.looks, 4)

    def cost(actions):
        looks = Forecast(situation.take(np.tile(np.arange(6), len(actions))), pace).fly(actions.reshape(1, 1, -1))
        return policy.criterion.cost(looks, (0,), belief.min_range).reshape(len(actions), 6)

    all_of_them = cost(np.repeat(np.linspace(-1.0, 1.0, 2000)[:, None], 6, axis=1))
    gap = cost(chosen[None])[0] - all_of_them.min(axis=0)
    spread = np.median(all_of_them, axis=0) - all_of_them.min(axis=0)
    assert (gap < 0.02 * spread).all()
    assert (spread > 0.0).all()


@pytest.mark.parametrize("name", ["greedy", "horizon", "shrinking"])
@pytest.mark.parametrize("scenario", ["BearingsOnly", "CrossFix", "BearingDopplerUnknownCarrier"])
def test_batch_size_changes_nothing(name, scenario, monkeypatch):
    """Bit for bit, passes cut anywhere; a planner draws no random numbers, so none can differ."""
    env, observation = environment(scenario, size=7)
    policy = find_policy(name, env.scenario)
    together = policy.act(observation, env.belief, None)
    for columns in (7, 3, 1):
        monkeypatch.setattr("agents.planners._COLUMNS", columns * policy.candidates)
        assert policy.act(observation, env.belief, None).tobytes() == together.tobytes()
    for index in range(7):
        alone, seen = environment(scenario, size=1, decisions=0, seed=20 + index)
        rng = np.random.default_rng(5)
        for _ in range(3):
            seen, *_ = alone.step(rng.uniform(-1.0, 1.0, together.shape)[index : index + 1])
        assert policy.act(seen, alone.belief, None).tobytes() == together[index : index + 1].tobytes()


def test_environments_with_clocks_of_their_own(monkeypatch):
    """The shrinking horizon plans each for the time it has left."""
    env, observation = environment()
    belief, policy = env.belief, find_policy("shrinking", env.scenario)
    left = np.array([228.0, 40.0, 4.0, 40.0, 0.0, 120.0])
    mixed = policy.act(observation, dataclasses.replace(belief, time_left=left), None)
    for index, seconds in enumerate(left):
        same = policy.act(observation, dataclasses.replace(belief, time_left=np.full(6, max(seconds, 4.0))), None)
        assert mixed[index] == same[index]
    reach = []
    monkeypatch.setattr(Horizon, "_plan", lambda self, b, s, columns, pace: reach.append(pace.steps) or 0.0)
    policy.act(observation, dataclasses.replace(belief, time_left=left), None)
    assert reach == [4, 40, 120, 228]
    reach.clear()
    find_policy("horizon:seconds=48", env.scenario).act(observation, dataclasses.replace(belief, time_left=left), None)
    assert reach == [4, 40, 48]


def test_the_belief_is_left_alone():
    env, observation = environment()
    (world,) = env.batch.tiles
    before = {name: values.copy() for name, values in world.state_arrays().items()}
    for name in NAMES:
        find_policy(name, env.scenario).act(observation, env.belief, RNG)
    assert all(np.array_equal(before[name], values) for name, values in world.state_arrays().items())


def mirrored(belief):
    """The same scene seen in a mirror: east and west change places."""
    flip = np.array([-1.0, 1.0, -1.0, 1.0])
    pose = belief.poses[0]
    return dataclasses.replace(
        belief,
        mean=flip[:, None] * belief.mean,
        covariance=flip[:, None, None] * belief.covariance * flip[:, None],
        poses=[
            PlanarPose(flip[:2, None] * pose.position, flip[:2, None] * pose.velocity, -pose.heading, -pose.turn_rate)
        ],
        last_action=-belief.last_action,
    )


def heading_after(belief, actions):
    (platform,), (pose,) = belief.platforms, belief.poses
    state = platform.state_at(pose)
    return platform.pose(platform.move(state, platform.set_point(state, actions.T, belief.line_of_sight), 4.0)).heading


@pytest.mark.parametrize("control", ["heading", "turn_rate"])
@pytest.mark.parametrize("name", ["greedy", "greedy:objective=range", "greedy:objective=A:grid=23"])
def test_a_mirror_mirrors_the_decision(name, control):
    """The course flown, since many headings beyond reach are the same turn."""
    env, observation = environment(size=40, **{"platforms.0.control": control})
    policy, belief = (
        find_policy(name.replace(":grid=23", "") if control == "heading" else name, env.scenario),
        env.belief,
    )
    ours = heading_after(belief, policy.act(observation, belief, RNG))
    other = mirrored(belief)
    theirs = heading_after(other, policy.act(observation, other, RNG))
    assert np.abs(wrap(ours + theirs)).max() < 1e-9
    assert (np.abs(wrap(ours - belief.poses[0].heading)) > 1e-3).any()


def test_the_margin_keeps_the_distance():
    """Near the keep-out with a vague idea of the range: more standard deviations, more room."""
    closest = []
    for margin in (0.0, 1.0, 3.0):
        env, observation = environment(
            size=12, decisions=0, **{"target.start.range": 24e3, "target.start.speed": 100.0}
        )
        policy = find_policy(f"horizon:margin={margin}", env.scenario)
        ranges = []
        env.batch.tiles[0].watchers.append(lambda world, kept=ranges: kept.append(world.outcome.range.copy()))
        for _ in range(30):
            observation, *_ = env.step(policy.act(observation, env.belief, RNG))
        closest.append(np.min(ranges, axis=0))
    assert closest[0].mean() < closest[1].mean() < closest[2].mean()
    assert (closest[2] > 10e3).all()


def test_trespass_by_hand():
    """2 km outside a keep-out of 10 km, σ = 1.5 km, a margin of 2: 1 km inside, a tenth, costs ten of a hundred."""
    env, _ = environment("OwnShipModerate", size=1)
    belief = env.belief
    towards = belief.line_of_sight
    mean = belief.mean.copy()
    mean[:2] = belief.poses[0].position + 12e3 * towards
    mean[2:] = belief.poses[0].velocity
    covariance = 1e-6 * np.eye(4)[..., None]
    covariance[:2, :2] += 1.5e3**2 * towards[:, None] * towards
    # A platform that keeps its course beside an emitter that does the same keeps its range.
    course = float(wrap(belief.poses[0].heading[0] - belief.bearing[0]) / math.pi)
    situation = Situation.of(dataclasses.replace(belief, mean=mean, covariance=covariance))
    quiet = dataclasses.replace(situation, motion=dataclasses.replace(situation.motion, acceleration_density=0.0))
    costs = [
        Criterion(objective="A", margin=2.0, weight=weight).cost(
            Forecast(quiet, Pace((1,))).fly(np.full((1, 1, 1), course)), (0,), 10e3
        )
        for weight in (0.0, 100.0)
    ]
    np.testing.assert_allclose(costs[1] - costs[0], 10.0, rtol=1e-6)


def test_beyond_caution_measurements_count():
    env, _ = environment(size=1)
    situation = Situation.of(env.belief)
    plan = np.full((1, 1, 1), 0.5)

    def risk(caution):
        looks = Forecast(situation, Pace((4,) * 8)).fly(plan)
        with_it, without = (
            Criterion(margin=20.0, caution=caution, weight=weight).cost(
                Forecast(situation, Pace((4,) * 8)).fly(plan), (0,), 10e3
            )[0]
            for weight in (1.0, 0.0)
        )
        assert next(looks).decision == 1.0
        return with_it - without

    assert risk(8.0) > risk(4.0) > risk(0.0) > 0.0


def test_a_horizon_sees_more_than_a_decision():
    """32 episodes of BearingsOnly, paired: the mean gain of 48 s over 4 s is some 0.1 with a standard error of 0.03."""
    scenario = SCENARIOS["BearingsOnly"]
    scores = {name: fly(scenario, find_policy(name, scenario), 32, 5_100_000)[0] for name in ("greedy", "horizon")}
    gain = scores["greedy"].log_range_bound - scores["horizon"].log_range_bound
    assert gain.mean() > 0.1
    assert scores["horizon"].violated.mean() <= 1 / 32


def test_chunks_of_episodes_change_nothing(monkeypatch):
    scenario = SCENARIOS["BearingsOnly"].override({"episode.steps": 24})
    policy = find_policy("horizon", scenario)
    whole, _ = fly(scenario, policy, 7, seed=5)
    monkeypatch.setattr(episodes, "CHUNK", 3)
    parts, _ = fly(scenario, policy, 7, seed=5)
    assert np.array_equal(whole.end_error, parts.end_error)
    assert np.array_equal(whole.end_position_bound, parts.end_position_bound)


def corrupt(world: Simulation) -> None:
    world.truth[:2] += np.array([[9e3], [-7e3]])
    world.truth[2:4] *= -1.3


@pytest.mark.parametrize("scenario", ["BearingsOnly", "CrossFix"])
@pytest.mark.parametrize("name", ["greedy", "horizon", "shrinking"])
def test_only_those_that_say_so_know_the_truth(name, scenario):
    """A corrupted truth changes nothing for the one and the decision of the other."""
    env, observation = environment(scenario)
    blind, knowing = find_policy(name, env.scenario), find_policy(f"{name}-truth", env.scenario)
    before = [episodes.decide(policy, env, observation, RNG) for policy in (blind, knowing)]
    corrupt(env.batch.tiles[0])
    after = [episodes.decide(policy, env, observation, RNG) for policy in (blind, knowing)]
    assert after[0].tobytes() == before[0].tobytes()
    assert (after[1] != before[1]).any(axis=1).mean() > 0.5


def test_what_knows_the_truth_is_given_it_in_the_rows_of_the_belief():
    env, observation = environment("DualArray")
    given = []

    class Listening(WithTruth):
        def act_on_truth(self, truth, observation, belief, rng):
            given.append(truth)
            return super().act_on_truth(truth, observation, belief, rng)

    policy = Listening(find_policy("horizon", env.scenario))
    actions = episodes.decide(policy, env, observation, RNG)
    (world,) = env.batch.tiles
    assert np.array_equal(given[0], world.truth)
    assert given[0] is not world.truth
    assert given[0].shape == env.belief.mean.shape
    assert policy.planner.plan(env.belief, world.truth).tobytes() == actions.tobytes()


def test_nobody_else_can_tell_it():
    env, observation = environment()
    policy = find_policy("horizon-truth:seconds=24", env.scenario)
    assert isinstance(policy, TruthKnowing)
    assert policy.name == "horizon-truth range 24 s"
    with pytest.raises(InputError, match="nobody here tells it the truth"):
        policy.act(observation, env.belief, RNG)


def test_actions_stay_finite_whatever_the_belief():
    env, observation = environment()
    belief = env.belief
    broken = dataclasses.replace(belief, mean=np.full_like(belief.mean, np.nan))
    close = dataclasses.replace(belief, mean=np.concatenate([belief.poses[0].position, belief.mean[2:]]))
    for name in NAMES:
        for bad in (broken, close):
            assert np.isfinite(find_policy(name, env.scenario).act(observation, bad, RNG)).all()


def test_tiles_of_a_batch_are_one_to_a_planner(monkeypatch):
    """Beliefs joined over tiles, random noise levels and all, give the decisions of the whole."""
    noise = {"sensors.0.sigma": {"type": "Uniform", "low": 1e-3, "high": 5e-3}}
    env, observation = environment(size=5, **noise)
    policy = find_policy("horizon", env.scenario)
    whole = policy.act(observation, env.belief, RNG)
    monkeypatch.setattr(Batch.__init__, "__defaults__", (2,))
    tiled, seen = environment(size=5, **noise)
    assert len(tiled.batch.tiles) == 3
    assert policy.act(seen, tiled.belief, RNG).tobytes() == whole.tobytes()
