"""Batches of whole runs: what they keep is what the environments say, one by one, and what it is boiled down to."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from scipy import stats

from agents import find_policy
from passloc_env.batch import TILE
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.survey import Survey
from passloc_env.vector_env import LocalisationVectorEnv
from training.papers.monte_carlo import History, position_bound, position_error, run

QUICK = {"episode.steps": 12, "episode.decision_every": 4}
SHORT = {name: SCENARIOS[name].override(QUICK) for name in ("BearingDoppler", "DualArray", "BearingsOnly")}
SEED = 40
KEPT = tuple(field.name for field in fields(History) if field.name not in ("extra", "states"))


@pytest.fixture(params=SHORT.values(), ids=list(SHORT))
def scenario(request: pytest.FixtureRequest) -> Scenario:
    found: Scenario = request.param
    return found


def history_of(**changes: Any) -> History:
    """Three instants of two runs, by hand."""
    values: dict[str, Any] = {
        "time": np.array([2.0, 4.0, 6.0]),
        "error": np.array([[3.0, 4.0], [6.0, 8.0], [0.3, 0.4]]),
        "bound": np.array([[1.0, 7.0], [3.0, 4.0], [0.1, 0.1]]),
        "range": np.array([[10.0, 10.0], [20.0, 40.0], [1.0, 2.0]]),
        "nees": np.array([[4.0, 2.0], [6.0, 12.0], [1.0, 3.0]]),
        "states": 4,
    }
    return History(**{**values, **changes})


def same(found: History, expected: History) -> None:
    """Alike to the last bit."""
    for name in KEPT:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)
    assert found.extra.keys() == expected.extra.keys()
    for name, values in expected.extra.items():
        np.testing.assert_array_equal(found.extra[name], values)


def test_histories_are_what_the_environments_say(scenario: Scenario) -> None:
    """With a decision at every step, infos tell of every step; actions that the policy would take are replayed."""
    every_step = scenario.override({"episode.decision_every": 1})
    policy = find_policy("circle", every_step)
    history = run(every_step, 3, SEED, policy)
    env = LocalisationVectorEnv(
        3,
        every_step.override({**policy.overrides, "episode.early_end": False}),
        autoreset_mode=AutoresetMode.DISABLED,
        diagnostics=True,
    )
    observation, _ = env.reset(seed=SEED)
    rng = np.random.default_rng(SEED)
    assert len(history.time) == 12
    for k, time in enumerate(history.time):
        observation, *_, info = env.step(policy.act(observation, env.belief, rng))
        assert time == pytest.approx((k + 1) * scenario.episode.period)
        offset = info["estimate"][:, :2] - info["truth"][:, :2]
        np.testing.assert_allclose(history.error[k], np.linalg.norm(offset, axis=1), rtol=1e-12)
        np.testing.assert_array_equal(history.range[k], info["range"])
        np.testing.assert_array_equal(history.nees[k], info["nees"])
        np.testing.assert_allclose(history.relative_error[k], info["relative_range_error"], rtol=1e-12)
    assert history.states == {"DualArray": 6}.get(scenario.name, 4)


def test_bounds_are_those_of_each_episode_alone(scenario: Scenario) -> None:
    """As a survey finds them, which flies one episode."""
    policy = find_policy("circle", scenario)
    history = run(scenario, 3, SEED, policy)
    for column in range(3):
        alone = Survey(scenario.override(dict(policy.overrides)), policy.act, SEED + column)
        np.testing.assert_array_equal(history.bound[:, column], alone.position_bound)
        np.testing.assert_array_equal(history.time, alone.time)


def test_a_batch_of_runs_is_its_runs_one_by_one(scenario: Scenario) -> None:
    together = run(scenario, 4, SEED, "zigzag")
    for column in range(4):
        alone = run(scenario, 1, SEED + column, "zigzag")
        for name in KEPT:
            values = getattr(together, name)
            part = values if values.ndim == 1 else values[:, column : column + 1]
            np.testing.assert_array_equal(getattr(alone, name), part, err_msg=name)


def test_same_seed_same_history(scenario: Scenario) -> None:
    # A random policy, for its numbers must follow the seed as well.
    history = run(scenario, 2, SEED, "random")
    same(run(scenario, 2, SEED, "random"), history)
    assert not np.array_equal(run(scenario, 2, SEED + 1, "random").error, history.error)


@pytest.mark.parametrize("every", [2, 3, 5])
def test_every_few_steps(scenario: Scenario, every: int) -> None:
    whole, some = run(scenario, 2, SEED), run(scenario, 2, SEED, every=every)
    kept = slice(every - 1, None, every)
    same(some, History(**{name: getattr(whole, name)[kept] for name in KEPT}, states=whole.states))
    assert len(some.time) == 12 // every


def test_further_quantities_are_kept(scenario: Scenario) -> None:
    extra = {
        "error again": position_error,
        "bound again": position_bound,
        "clock": lambda simulation: simulation.time,
    }
    history = run(scenario, 2, SEED, every=4, extra=extra)
    np.testing.assert_array_equal(history.extra["error again"], history.error)
    np.testing.assert_array_equal(history.extra["bound again"], history.bound)
    np.testing.assert_array_equal(history.extra["clock"], history.time[:, None] * np.ones(2))
    np.testing.assert_array_equal(history.rms("clock"), history.time)


def test_nobody_moves_unless_told() -> None:
    """Policies bring their own overrides: without one the aircraft stands still, with one it does not."""
    place = {"east": lambda simulation: simulation.poses()[0].position[0].copy()}
    still = run(SHORT["BearingsOnly"], 2, SEED, extra=place)
    np.testing.assert_array_equal(still.extra["east"], 0.0)
    moving = run(SHORT["BearingsOnly"], 2, SEED, "straight", extra=place)
    assert np.ptp(moving.extra["east"], axis=0).min() > 100.0


def test_nothing_ends_early() -> None:
    """Not even inside the keep-out."""
    changes = {"target.start.range": 10.5e3, "target.start.speed": 0.0, "platforms.0.max_turn_rate": math.inf}
    history = run(SHORT["BearingsOnly"].override(changes), 3, SEED, "fly-at")
    assert history.range[-1].max() < 10e3
    assert np.diff(history.range, axis=0).max() < 0.0
    assert len(history.time) == 12


def test_more_runs_than_fit_a_tile() -> None:
    """Environments are cut into tiles for speed; histories do not show it."""
    scenario = Scenario().override({"episode.steps": 1, "episode.decision_every": 1})
    history = run(scenario, TILE + 2, SEED)
    assert history.error.shape == (1, TILE + 2)
    last = run(scenario, 2, SEED + TILE)
    for name in ("error", "bound", "range", "nees"):
        np.testing.assert_array_equal(getattr(history, name)[:, -2:], getattr(last, name))


def test_definitions() -> None:
    history = history_of(extra={"speed": np.array([[1.0, 7.0], [3.0, 4.0], [5.0, 5.0]])})
    np.testing.assert_allclose(history.relative_error, [[0.3, 0.4], [0.3, 0.2], [0.3, 0.2]])
    np.testing.assert_allclose(history.relative_rms, [math.sqrt(0.125), math.sqrt(0.065), math.sqrt(0.065)])
    np.testing.assert_allclose(history.relative_bound[:2], [math.sqrt(0.25), math.sqrt((0.15**2 + 0.1**2) / 2)])
    np.testing.assert_allclose(history.rms(), [math.sqrt(12.5), math.sqrt(50.0), math.sqrt(0.125)])
    np.testing.assert_allclose(history.rms("speed"), [5.0, math.sqrt(12.5), 5.0])
    np.testing.assert_allclose(history.efficiency, [math.sqrt(12.5) / 5.0, 2.0, math.sqrt(12.5)])
    assert history.anees == pytest.approx((3.0 + 9.0 + 2.0) / 3.0 / 4.0)
    end = history.end_anees
    assert end.value == pytest.approx(0.5)
    # Wilson and Hilferty's approximation is good to 1.3 % at eight degrees of freedom.
    np.testing.assert_allclose([end.low, end.high], stats.chi2.ppf([0.025, 0.975], 8) / 8, rtol=0.02)


@pytest.mark.parametrize(
    ("error", "nees", "share"),
    [
        ((0.5, 0.5), (4.0, 4.0), 0.0),
        ((1.5, 0.5), (4.0, 4.0), 0.5),
        ((0.5, 0.5), (4.0, 101.0), 0.5),
        ((1.5, 0.5), (4.0, 101.0), 1.0),
        ((math.nan, 0.5), (4.0, 4.0), 0.5),
        ((0.5, 0.5), (math.nan, math.inf), 1.0),
    ],
)
def test_lost_counts_the_end_alone(error: tuple[float, float], nees: tuple[float, float], share: float) -> None:
    """A relative error above one or a NEES above 100, and anything that is not a number."""
    ranges = np.ones((2, 2))
    history = history_of(
        time=np.array([1.0, 2.0]),
        error=np.array([[9.0, 9.0], error]),
        range=ranges,
        bound=ranges,
        nees=np.array([[999.0, 999.0], nees]),
    )
    assert history.lost == share


@pytest.mark.parametrize(
    ("time", "index"), [(2.0, 0), (3.9, 0), (4.0, 1), (4.0 - 1e-12, 1), (6.0, 2), (math.inf, 2), (0.0, 0)]
)
def test_at_a_time(time: float, index: int) -> None:
    assert history_of().at(time) == index


def test_relative_rms_at_a_time_with_its_interval() -> None:
    """For errors that are normal: within 1.96 standard deviations of an RMS, 1/√(2N) of it, to a tenth."""
    rng = np.random.default_rng(1)
    runs = 2000
    ones = np.ones((2, runs))
    history = History(np.array([1.0, 2.0]), rng.normal(size=(2, runs)), ones, 2.0 * ones, ones, 4)
    for time, k in ((1.0, 0), (math.inf, 1)):
        found = history.relative_rms_at(time)
        assert found.value == pytest.approx(history.relative_rms[k], rel=1e-12)
        half = 1.96 * found.value / math.sqrt(2.0 * runs)
        np.testing.assert_allclose([found.value - found.low, found.high - found.value], half, rtol=0.1)
