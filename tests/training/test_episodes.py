"""Flying whole episodes: the same world for every policy, and scores recomputed by hand."""

import math

import numpy as np
import pytest

from agents import Random, find_policy
from passloc_env import SCENARIOS, LocalisationEnv
from passloc_env.distributions import Uniform
from training import episodes
from training.episodes import Recorder, Scores, fly

EVERY_STEP = {"episode.decision_every": 1, "episode.steps": 60}
"""One decision per sensor step, so that the infos of a scalar environment hold every step."""

POLICIES = ("circle", "straight", "stationary", "fly-at", "random")


@pytest.fixture
def watched(monkeypatch):
    """Every recorder that ``fly`` makes, with the truth and noise that its simulation met."""
    made = []

    class Watching(Recorder):
        def __init__(self, simulation):
            super().__init__(simulation)
            self.truth, self.own, self.noise = [], [], []
            made.append(self)

        def _watch(self, simulation):
            super()._watch(simulation)
            self.truth.append(simulation.truth.copy())
            self.own.append(simulation.poses()[0].position.copy())
            self.noise.append({name: array.copy() for name, array in simulation.noise.state_arrays().items()})

    monkeypatch.setattr(episodes, "Recorder", Watching)
    return made


def same(one: Scores, other: Scores) -> bool:
    """Equality to the last bit."""
    pairs = ((getattr(one, name), getattr(other, name)) for name in vars(one))
    return all(a.dtype == b.dtype and a.tobytes() == b.tobytes() for a, b in pairs)


@pytest.mark.parametrize("name", ["BearingsOnly", "OwnShipModerate", "BearingDoppler"])
def test_every_policy_meets_the_same_truth_and_noise(name, watched):
    """Bit for bit, including the policy that changes the scenario; the seed makes another world."""
    scenario = SCENARIOS[name].override({"episode.steps": 20})
    for policy in POLICIES:
        fly(scenario, find_policy(policy, scenario), 4, seed=7)
    fly(scenario, find_policy("circle", scenario), 4, seed=8)
    first, *others, stranger = watched
    assert len(others) == len(POLICIES) - 1
    for recorder in others:
        assert np.array_equal(recorder.truth, first.truth)
        for mine, theirs in zip(recorder.noise, first.noise, strict=True):
            assert all(np.array_equal(mine[kind], theirs[kind]) for kind in theirs)
        assert not np.array_equal(recorder.own, first.own)
    assert all(np.ptp(array) > 1.0 for array in (first.noise[0]["measurement"], first.truth[0]))
    assert not np.array_equal(stranger.truth, first.truth)
    # Seeds count up: the stranger's first episode is the second of the others, in truth and in noise.
    assert np.array_equal(np.array(stranger.truth)[..., 0], np.array(first.truth)[..., 1])
    assert np.array_equal(stranger.noise[0]["measurement"][..., 0], first.noise[0]["measurement"][..., 1])


def first_sustained(level: float, errors: list[float], period: float) -> float:
    """First time from which the error stays at or below the level for 10 s; the episode's length when never."""
    for start in range(len(errors)):
        window = errors[start : start + round(10.0 / period)]
        if len(window) == round(10.0 / period) and all(error <= level for error in window):
            return (start + 1) * period
    return len(errors) * period


class HandBound:
    """The Cramér–Rao recursion of BearingsOnly in information form: no process noise, 3 mrad, 127 m/s, 15 km."""

    def __init__(self, offset):
        along = offset / np.linalg.norm(offset)
        across = np.array([along[1], -along[0]])
        prior = np.zeros((4, 4))
        prior[:2, :2] = 15e3**2 * np.outer(along, along) + (3e-3 * np.linalg.norm(offset)) ** 2 * np.outer(
            across, across
        )
        prior[2:, 2:] = 127.0**2 * np.eye(2)
        self.information = np.linalg.inv(prior)
        self._backwards = np.linalg.inv(np.eye(4) + np.eye(4, k=2))

    def step(self, offset):
        slope = np.array([offset[1], -offset[0], 0.0, 0.0]) / (offset @ offset)
        self.information = self._backwards.T @ self.information @ self._backwards + np.outer(slope, slope) / 3e-3**2

    @property
    def position(self):
        return np.linalg.inv(self.information)[:2, :2]


def by_hand(scenario, policy, seed):
    """The scores of one episode from a scalar environment, its diagnostics and a bound of our own."""
    env = LocalisationEnv(scenario, overrides={**policy.overrides, "episode.early_end": False}, diagnostics=True)
    observation, info = env.reset(seed=seed)
    bound = HandBound(info["truth"][:2] - env.belief.poses[0].position[:, 0])
    logs, errors, nees, violated, truncated = [], [], [], [], False
    while not truncated:
        action = policy.act(observation[None], env.belief, np.random.default_rng(0))[0]
        observation, _, terminated, truncated, info = env.step(action)
        assert not terminated
        offset = info["truth"][:2] - env.belief.poses[0].position[:, 0]
        bound.step(offset)
        distance = np.linalg.norm(offset)
        sigma = math.sqrt(offset @ bound.position @ offset) / distance
        error = info["estimate"] - info["truth"]
        logs.append(math.log(sigma / distance))
        errors.append(np.linalg.norm(error[:2]) / distance)
        nees.append(error @ np.linalg.solve(info["covariance"], error))
        violated.append(distance < env.scenario.episode.min_range)
    return {
        "log_range_bound": np.mean(logs),
        "end_error": errors[-1],
        "mean_error": np.mean(errors),
        "time_to_10": first_sustained(0.10, errors, env.scenario.episode.period),
        "time_to_5": first_sustained(0.05, errors, env.scenario.episode.period),
        "violated": any(violated),
        "lost": errors[-1] > 1.0 or nees[-1] > 100.0,
        "end_position_error": np.linalg.norm(error[:2]),
        "end_position_bound": math.sqrt(np.trace(bound.position)),
        "mean_nees": np.mean(nees),
    }


@pytest.mark.parametrize("name", ["circle", "zigzag:angle=60:leg=15", "straight", "fly-at", "stationary"])
def test_scores_by_hand(name):
    """1e-6: the information form loses a few digits while the range is unobservable."""
    close = {"target.start.range": Uniform(low=10.2e3, high=30e3)}
    scenario = SCENARIOS["BearingsOnly"].override(EVERY_STEP | close)
    policy = find_policy(name, scenario)
    scores, seconds = fly(scenario, policy, 3, seed=100)
    assert seconds > 0.0
    for index in range(3):
        expected = by_hand(scenario, policy, 100 + index)
        assert expected.keys() == vars(scores).keys()
        for field, value in expected.items():
            assert getattr(scores, field).shape == (3,)
            assert getattr(scores, field)[index] == pytest.approx(value, rel=1e-6), field


def test_scores_by_hand_see_every_kind_of_outcome():
    """What the test above compares is not constant."""
    close = {"target.start.range": Uniform(low=10.2e3, high=30e3)}
    scenario = SCENARIOS["BearingsOnly"].override(EVERY_STEP | close)
    flown = [fly(scenario, find_policy(name, scenario), 3, seed=100)[0] for name in ("circle", "fly-at")]
    assert {bool(event) for scores in flown for event in scores.violated} == {True, False}
    times = np.concatenate([scores.time_to_10 for scores in flown])
    assert times.min() < 60.0


def test_a_confident_error_is_a_lost_track():
    """A fifth of the range off and sure of it to 100 m: lost by its NEES alone."""
    sure = {"prior.range_sigma": 100.0, "target.start.range": Uniform(low=30e3, high=34e3)}
    scenario = SCENARIOS["BearingsOnly"].override(EVERY_STEP | sure)
    scores, _ = fly(scenario, find_policy("straight", scenario), 5, seed=0)
    assert (scores.end_error < 1.0).all()
    assert scores.lost.all()
    vague, _ = fly(scenario.override({"prior.range_sigma": 15e3}), find_policy("straight", scenario), 5, seed=0)
    assert not vague.lost.any()


def test_violations_are_counted_and_end_nothing(watched):
    """Everybody starts a little outside and flies in; the episode goes on to its last step."""
    changes = {"target.start.range": Uniform(low=10.05e3, high=10.3e3), "target.start.speed": 0.0}
    scenario = SCENARIOS["BearingsOnly"].override(changes)
    scores, _ = fly(scenario, find_policy("fly-at", scenario), 5, seed=0)
    assert scores.violated.all()
    (recorder,) = watched
    assert recorder.violated.shape == (240, 5)
    assert len(recorder.truth) == 240
    inside = np.array([np.hypot(*(t[:2] - o)) for t, o in zip(recorder.truth, recorder.own, strict=True)]) < 10e3
    assert np.array_equal(recorder.violated, inside)
    assert (inside.argmax(axis=0) < 120).all()
    # The same flight in training ends there and then.
    env = LocalisationEnv(scenario)
    observation, _ = env.reset(seed=0)
    ended, decisions = False, 0
    while not ended:
        action = find_policy("fly-at", scenario).act(observation[None], env.belief, np.random.default_rng(0))[0]
        observation, _, ended, truncated, _ = env.step(action)
        decisions += 1
    assert not truncated
    assert decisions == inside[:, 0].argmax() // 4 + 1


def test_straying_tracks_end_nothing(watched):
    """A limit on the error that any track exceeds would end every episode at once in training."""
    scenario = SCENARIOS["BearingsOnly"].override({"episode.steps": 40, "episode.lost_error": 1e-6})
    fly(scenario, find_policy("circle", scenario), 3, seed=0)
    assert len(watched[0].truth) == 40


@pytest.mark.parametrize("name", ["circle", "zigzag", "stationary", "random"])
def test_chunks_change_nothing(name, monkeypatch):
    """How many episodes fit into memory at once is nobody's business."""
    scenario = SCENARIOS["BearingsOnly"].override({"episode.steps": 24})
    policy = find_policy(name, scenario)
    whole, _ = fly(scenario, policy, 11, seed=5)
    monkeypatch.setattr(episodes, "CHUNK", 4)
    done = []
    parts, _ = fly(scenario, policy, 11, seed=5, progress=done.append)
    assert done == [4, 4, 3]
    assert same(parts, whole)


def test_random_numbers_are_new_at_every_decision_of_every_episode(monkeypatch):
    """Across chunks as well: what a policy draws it never draws again."""
    drawn = []

    class Watched(Random):
        def act(self, observation, belief, rng):
            drawn.append(super().act(observation, belief, rng))
            return drawn[-1]

    monkeypatch.setattr(episodes, "CHUNK", 4)
    fly(SCENARIOS["BearingsOnly"].override({"episode.steps": 24}), Watched(), 6, seed=5)
    assert [actions.shape for actions in drawn] == [(3, 1)] * 12
    assert len(np.unique(np.concatenate(drawn))) == 36


def test_more_episodes_begin_with_the_same_ones():
    scenario = SCENARIOS["BearingsOnly"].override({"episode.steps": 24})
    few, many = (fly(scenario, find_policy("circle", scenario), count, seed=5)[0] for count in (3, 7))
    first = Scores(**{name: values[:3] for name, values in vars(many).items()})
    assert same(few, first)
    again, _ = fly(scenario, find_policy("random", scenario), 3, seed=5)
    assert same(again, fly(scenario, find_policy("random", scenario), 3, seed=5)[0])
