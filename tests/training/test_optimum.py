"""The trajectory optimum: flown in the environment, against independent searches, mirrored, and kept in a file."""

import numpy as np
import pytest
import torch
from scipy.optimize import differential_evolution

from agents import find_policy
from passloc_env import SCENARIOS
from passloc_env.distributions import Uniform
from passloc_env.errors import InputError
from passloc_env.vector_env import LocalisationVectorEnv
from training.episodes import fly as fly_episodes
from training.optimum import NAME, Optimum, optimise
from training.optimum.bound import Problem
from training.optimum.future import foresee
from training.optimum.starts import RECIPES, starting_turns

SHORT = SCENARIOS["BearingsOnly"].override({"episode.steps": 48, "episode.decision_every": 8})
"""Six decisions of at most 24°."""
EASY = {"restarts": 4, "iterations": 25, "polish": 10}


@pytest.fixture(scope="module")
def short():
    return optimise(SHORT, range(50, 62), restarts=16, iterations=80, polish=60)


@pytest.mark.parametrize(
    "name", ["BearingsOnly", "BearingDoppler", "BearingDopplerUnknownCarrier", "OwnShipModerate", "DualArray"]
)
def test_the_environment_confirms_the_value(name):
    """Relative 1e-6, asked of both; rounding in four hundred steps leaves far less."""
    episode = SCENARIOS[name].episode
    scenario = SCENARIOS[name].override({"episode.steps": 8 * episode.decision_every})
    for objective in ("log_range_bound", "end_position_bound"):
        optimum = optimise(scenario, range(20, 25), **EASY, objective=objective)
        scores, _ = fly_episodes(scenario, optimum.policy(), 5, 20)
        np.testing.assert_allclose(optimum.value, getattr(scores, objective), rtol=1e-6)
        assert np.array_equal(optimum.violated, scores.violated)


def test_the_flight_follows_the_path(short):
    """A micrometre: the headings go through an angle relative to the believed line of sight."""
    env = LocalisationVectorEnv(12, SHORT)
    observation, _ = env.reset(seed=50)
    policy = short.policy()
    for decision in range(6):
        observation, *_ = env.step(policy.act(observation, env.belief, np.random.default_rng(0)))
        flown = env.batch.tiles[0].poses()[0].position
        np.testing.assert_allclose(flown, short.paths[:, 8 * decision + 7], rtol=0, atol=1e-6)


def test_better_than_rules(short):
    optimum, _ = fly_episodes(SHORT, short.policy(), 12, 50)
    for rule in ("circle", "perpendicular", "zigzag:angle=60:leg=16"):
        flown, _ = fly_episodes(SHORT, find_policy(rule, SHORT), 12, 50)
        assert (optimum.log_range_bound < flown.log_range_bound + 1e-9).all()


@pytest.mark.parametrize("column", [0, 1])
def test_no_worse_than_differential_evolution(short, column):
    """An independent search without gradients, in six dimensions: within 1 %, and not better.

    Seed 50 turns one way and then the other, which descents from circles and zigzags alone miss by 1 %.
    """
    future = foresee(SHORT, [50 + column])
    reach = future.largest_turn[0]

    def worth(turns):
        """Many candidates at once, one per column."""
        with torch.no_grad():
            value = Problem(future.take(np.zeros(turns.shape[1], np.int64)))(torch.from_numpy(turns))
        return torch.where((value.range >= 10e3).all(0), value.objective, 10.0).numpy()

    search = {"popsize": 12, "maxiter": 80, "vectorized": True, "updating": "deferred", "polish": False}
    found = differential_evolution(worth, [(-reach, reach)] * 6, seed=3, **search)
    assert short.value[column] <= found.fun + 1e-3
    assert short.value[column] == pytest.approx(found.fun, rel=0.01)


def test_no_worse_than_brute_force():
    """Four free headings of an own ship, each of sixteen: the grid never beats the optimum."""
    scenario = SCENARIOS["OwnShipModerate"].override({"episode.steps": 4})
    optimum = optimise(scenario, [7], restarts=16, iterations=150, polish=0)
    headings = np.stack(np.meshgrid(*[np.arange(16) * np.pi / 8] * 4, indexing="ij")).reshape(4, -1)
    future = foresee(scenario, [7]).take(np.zeros(headings.shape[1], np.int64))
    turns = np.diff(headings, axis=0, prepend=future.heading[None])
    with torch.no_grad():
        best = Problem(future)(torch.from_numpy(turns)).objective.min().item()
    assert optimum.value[0] <= best + 1e-9
    assert optimum.value[0] == pytest.approx(best, rel=0.01)


def test_mirrored_paths_are_worth_the_same():
    """An emitter at rest straight ahead: every start has its mirror image, and so has every optimum.

    1e-6: the descents are mirror images up to rounding, which they may magnify.
    """
    still = {
        "target.start.speed": 0.0,
        "target.start.bearing": 0.5,
        "platforms.0.heading": 0.5,
        "platforms.0.speed": 220.0,
        "target.start.range": 30e3,
    }
    starts = starting_turns(foresee(SHORT.override(still), [4]), 8, [4], 0)
    np.testing.assert_allclose(starts[:, 1::2], -starts[:, ::2], atol=1e-12)
    optimum = optimise(SHORT.override(still), [4], restarts=8, iterations=60, polish=0)
    pairs = optimum.values[0].reshape(4, 2)
    np.testing.assert_allclose(pairs[:, 0], pairs[:, 1], rtol=1e-6)
    both = np.flatnonzero(optimum.values[0] <= optimum.value[0] + 1e-6)
    assert len(both) >= 2
    assert np.ptp(pairs[:, 0]) > 1e-6


def test_keep_out_is_held():
    """An emitter at rest, obliquely ahead: the best would be to fly by closely; all paths stay out, some at the edge.

    Fixed seeds. Without the keep-out the bound is lower by 0.6 in the mean, so that half of it is asked for.
    """
    ahead = {"target.start.bearing": Uniform(low=-0.3, high=0.3), "platforms.0.heading": 0.8}
    close = SHORT.override({"episode.steps": 96, "target.start.range": 16e3, "target.start.speed": 0.0} | ahead)
    seeds = range(8)
    held = optimise(close, seeds, restarts=6, iterations=80, polish=30)
    free = optimise(close.override({"episode.min_range": 0.0}), seeds, restarts=6, iterations=80, polish=30)
    scores, _ = fly_episodes(close, held.policy(), 8, 0)
    assert not held.violated.any()
    assert not scores.violated.any()
    assert free.value.mean() < held.value.mean() - 0.3
    inside, outside = (np.hypot(*(foresee(close, seeds).truth[:2] - each.paths)).min(axis=0) for each in (free, held))
    assert (inside < 10e3).all()
    assert (outside >= 10e3).all()
    assert outside.min() < 10.05e3


def test_what_cannot_keep_out_says_so():
    """Heading straight in from 11 km with a turn radius of 3.8 km or more, the best circle comes to within 8 km."""
    still = {"target.start.range": 11e3, "target.start.speed": 0.0}
    doomed = SHORT.override(still | {"target.start.bearing": 0.5, "platforms.0.heading": 0.5})
    optimum = optimise(doomed, range(3), **EASY)
    scores, _ = fly_episodes(doomed, optimum.policy(), 3, 0)
    assert optimum.violated.all()
    assert scores.violated.all()
    assert np.isfinite(optimum.value).all()


def test_more_work_is_never_worse():
    """Restarts are the same whatever their number; the best of more is at least as good."""
    few, many = (optimise(SHORT, range(6), restarts=count, iterations=20, polish=0) for count in (3, 14))
    np.testing.assert_allclose(many.values[:, :3], few.values, rtol=1e-9)
    assert (many.value <= few.value + 1e-9).all()
    longer = optimise(SHORT, range(6), restarts=3, iterations=80, polish=40)
    assert longer.value.mean() < few.value.mean()


def test_chunks_and_neighbours_change_nothing(monkeypatch):
    """Random starts included. 1e-6: torch's vector units round the ends of an array differently."""
    arguments = {"restarts": 14, "iterations": 5, "polish": 0, "seed": 3}
    done = []
    whole = optimise(SHORT, [8, 3, 5, 4, 9], **arguments)
    monkeypatch.setattr("training.optimum.search._COLUMNS", 28)
    parts = optimise(SHORT, [8, 3, 5, 4, 9], **arguments, progress=done.append)
    assert done == [2, 2, 1]
    np.testing.assert_allclose(whole.values, parts.values, rtol=1e-6)
    np.testing.assert_allclose(optimise(SHORT, [4], **arguments).values[0], whole.values[3], rtol=1e-6)


def test_starts_are_within_reach_and_differ():
    future = foresee(SHORT, range(4))
    turns = starting_turns(future, 16, range(4), 0)
    assert turns.shape == (6, 16, 4)
    assert (np.abs(turns) <= future.largest_turn * (1 + 1e-12)).all()
    assert np.array_equal(turns[:, len(RECIPES) :], starting_turns(future, 16, range(4), 0)[:, len(RECIPES) :])
    assert not np.array_equal(turns[:, len(RECIPES) :], starting_turns(future, 16, range(4), 1)[:, len(RECIPES) :])
    for column in range(4):
        assert len(np.unique(turns[:, :, column].round(9), axis=1).T) == 16


def test_replay_finds_its_episodes_anywhere(short):
    """In another order, and in a batch that holds one episode twice."""
    policy = short.policy()
    assert policy.name == NAME == "trajectory optimum (truth)"
    env = LocalisationVectorEnv(3, SHORT)
    observation, _ = env.reset(seed=[60, 52, 60])
    for _ in range(6):
        observation, *_ = env.step(policy.act(observation, env.belief, np.random.default_rng(0)))
    flown = env.batch.tiles[0].poses()[0].position
    np.testing.assert_allclose(flown, short.paths[:, -1, [10, 2, 10]], rtol=0, atol=1e-6)
    observation, _ = env.reset(seed=[60, 52, 99])
    with pytest.raises(InputError, match=r"environments \[2\] fly an episode for which no path was optimised"):
        policy.act(observation, env.belief, np.random.default_rng(0))


def test_file(tmp_path, monkeypatch):
    """A second run reads it and searches nothing; another search is refused, and so are other files."""
    path = tmp_path / "optimum.npz"
    first = optimise(SHORT, range(3), **EASY, cache=path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["optimum.npz"]
    with monkeypatch.context() as patch:
        patch.setattr("training.optimum.search.foresee", None)
        again = optimise(SHORT, range(3), **EASY, cache=path)
    assert again.scenario == first.scenario == Optimum.load(path).scenario
    for name in ("seeds", "headings", "paths", "values", "legal", "chosen"):
        assert np.array_equal(getattr(first, name), getattr(again, name)), name
    for other in ({"seeds": range(4)}, {"restarts": 5}, {"objective": "end_position_bound"}):
        with pytest.raises(InputError, match="holds another search"):
            optimise(**({"scenario": SHORT, "seeds": range(3)} | EASY | other), cache=path)
    np.savez(path, about="{}")
    with pytest.raises(InputError, match="is not a file of trajectory optima"):
        Optimum.load(path)
    path.write_bytes(b"nonsense")
    with pytest.raises(InputError, match="is not a file of trajectory optima"):
        Optimum.load(path)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"restarts": 0}, "restarts = 0 is not possible"),
        ({"iterations": -1}, "iterations = -1 is not possible"),
        ({"objective": "log_range"}, "did you mean 'log_range_bound'"),
        ({"seeds": []}, "seeds are not possible"),
        ({"seeds": [1, 1]}, "seeds are not possible"),
    ],
)
def test_impossible_searches(changes, words):
    with pytest.raises(InputError, match=words) as caught:
        optimise(**({"scenario": SHORT, "seeds": [1]} | EASY | changes))
    assert "\n" not in str(caught.value)


def test_threads_are_put_back():
    threads = torch.get_num_threads()
    optimise(SHORT, [1], restarts=1, iterations=1, polish=0)
    assert torch.get_num_threads() == threads
