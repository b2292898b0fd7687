"""Gramians and ranks against theory: what a straight observer can and cannot know."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from passloc_env import observability
from passloc_env.errors import InputError
from passloc_env.layout import StateLayout
from passloc_env.motion import ConstantVelocity
from passloc_env.observability import (
    fisher_rows,
    gram_gain,
    gramian,
    observability_matrix,
    pseudo_linear_rows,
    rank_report,
    record_scale,
    windowed_gram_determinant,
)
from passloc_env.scenarios import SCENARIOS
from passloc_env.simulation import Simulation

LAYOUT = StateLayout()
PERIOD = 1.0
TRANSITION = ConstantVelocity().transition(LAYOUT, PERIOD)
SCALE = np.array([1e4, 1e4, 1e2, 1e2])


def bearings(turn_rate: float, steps: int = 200, batch: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """Bearings ``(K, N)`` from an observer turning at a rate to random constant-velocity emitters, and their states."""
    rng = np.random.default_rng(3)
    state = np.concatenate([rng.uniform(20e3, 40e3, (2, batch)), rng.uniform(-200, 200, (2, batch))])
    time = PERIOD * np.arange(steps)[:, None]
    heading = turn_rate * time
    speed = 220.0
    if turn_rate:
        own = speed / turn_rate * np.stack([1.0 - np.cos(heading), np.sin(heading)])
    else:
        own = speed * np.stack([0.0 * time, time])
    east, north = state[0] + time * state[2] - own[0], state[1] + time * state[3] - own[1]
    return np.arctan2(east, north), state


def rank_of(turn_rate: float, doppler: bool) -> np.ndarray:
    rows = pseudo_linear_rows(bearings(turn_rate)[0], LAYOUT, doppler=doppler)
    return rank_report(rows, TRANSITION, LAYOUT, SCALE).rank


def test_straight_observer_with_bearings_knows_three_of_four_states() -> None:
    assert (rank_of(turn_rate=0.0, doppler=False) == 3).all()


def test_doppler_or_a_turn_makes_all_four_states_observable() -> None:
    assert (rank_of(turn_rate=0.0, doppler=True) == 4).all()
    assert (rank_of(turn_rate=0.03, doppler=False) == 4).all()


def test_the_blind_direction_is_the_relative_state_itself() -> None:
    # Bearings are unchanged when the relative state is scaled: that is the direction nobody can see.
    angles, state = bearings(turn_rate=0.0)
    report = rank_report(pseudo_linear_rows(angles, LAYOUT), TRANSITION, LAYOUT, SCALE)
    relative = state - np.array([0.0, 0.0, 0.0, 220.0])[:, None]
    aligned = np.abs((report.weakest / SCALE[:, None] * relative / SCALE[:, None]).sum(axis=0))
    length = np.linalg.norm(report.weakest / SCALE[:, None], axis=0) * np.linalg.norm(relative / SCALE[:, None], axis=0)
    np.testing.assert_allclose(aligned, length, rtol=1e-6)  # SVD of a record with singular values over 9 decades
    assert set(report.weakest_name) <= set(LAYOUT.names)


def test_gramian_equals_the_sum_of_outer_products() -> None:
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(7, 2, 4, 3))
    expected = np.zeros((4, 4, 3))
    for env in range(3):
        power = np.eye(4)
        for k in range(7):
            mapped = rows[k, :, :, env] @ power
            expected[..., env] += mapped.T @ mapped
            power = TRANSITION[..., 0] @ power
    np.testing.assert_allclose(gramian(rows, TRANSITION), expected, rtol=1e-12)
    assert observability_matrix(rows, TRANSITION).shape == (14, 4, 3)


def test_results_do_not_depend_on_the_batch(assert_batch_free: Callable[..., None]) -> None:
    rng = np.random.default_rng(2)
    rows, per_environment = rng.normal(size=(11, 2, 4, 60)), rng.normal(size=(4, 4, 60))
    for transition in (TRANSITION, per_environment):
        assert_batch_free(observability_matrix, rows, transition)
        assert_batch_free(gramian, rows, transition)
    assert_batch_free(lambda given: rank_report(given, TRANSITION, LAYOUT, SCALE).condition, rows)
    assert_batch_free(lambda given: rank_report(given, TRANSITION, LAYOUT, SCALE).weakest, rows)


def test_a_record_shorter_than_the_state_is_reported_too() -> None:
    rows = pseudo_linear_rows(np.array([[0.3]]), LAYOUT, doppler=True)
    report = rank_report(rows, TRANSITION, LAYOUT, SCALE)
    assert report.rank == 2
    assert np.isinf(report.condition)
    assert np.isfinite(report.weakest).all()


def test_a_record_of_nothing_has_rank_zero() -> None:
    report = rank_report(np.zeros((6, 1, 4, 1)), TRANSITION, LAYOUT, SCALE)
    assert report.rank == 0
    assert np.isinf(report.condition)


def test_record_scale_makes_a_speed_of_everything() -> None:
    layout = StateLayout(order=2, nuisance=("constant",))
    np.testing.assert_array_equal(record_scale(layout, 50.0), [50.0, 50.0, 1.0, 1.0, 0.02, 0.02, 1.0])


def test_windowed_determinant_equals_the_determinant_of_each_window() -> None:
    rows = np.random.default_rng(1).normal(size=(9, 1, 4, 2))
    determinants = windowed_gram_determinant(rows, TRANSITION, window=6)
    for first in range(4):
        window = gramian(rows[first : first + 6], TRANSITION)
        expected = [np.linalg.slogdet(window[..., env])[1] for env in range(2)]
        np.testing.assert_allclose(determinants[first], expected, rtol=1e-8)  # conditioning of the Gramian


def test_a_window_too_short_to_see_the_state_says_so() -> None:
    rows = np.random.default_rng(1).normal(size=(9, 1, 4, 2))
    assert np.isneginf(windowed_gram_determinant(rows, TRANSITION, window=3)).all()
    with pytest.raises(ValueError, match="window = 10 is not possible"):
        windowed_gram_determinant(rows, TRANSITION, window=10)


def test_gram_gain_of_the_simulation_is_the_gain_of_the_gramian() -> None:
    # The simulation gets the gain from the determinant lemma; here it comes from the Gramian itself.
    scenario = SCENARIOS["BearingDoppler"].override({"episode.decision_every": 1, "episode.early_end": False})
    simulation = Simulation(scenario, 3)
    simulation.reset(np.arange(3), [np.random.default_rng(seed) for seed in range(3)])
    prior = np.moveaxis(np.linalg.inv(np.moveaxis(simulation.information.covariance[:, :, -1], -1, 0)), 0, -1)
    history: list[np.ndarray] = [np.zeros((2, 4, 3))]
    for k in range(40):
        simulation.step(np.full((1, 3), 0.4 if k < 20 else -0.4))
        before = gramian(np.stack(history), TRANSITION)
        history.append(fisher_rows(simulation.models.suite, simulation.bound_scene()))
        after = gramian(np.stack(history), TRANSITION)
        expected = gram_gain(before, after, prior)
        # Both forms lose digits to the conditioning of the information matrix, about 1e9 here.
        np.testing.assert_allclose(simulation.information.gram_gain, expected, rtol=1e-5, atol=1e-7)


ROWS, STEP = np.random.default_rng(0).normal(size=(5, 1, 4, 2)), np.eye(4)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: observability.observability_matrix(np.zeros((5, 1, 4)), STEP), r"rows of shape \(5, 1, 4\)"),
        (
            lambda: observability.gramian(ROWS, np.eye(3)),
            r"transition of shape \(3, 3\) is not possible: must be",
        ),
        (lambda: observability.gramian(ROWS, np.zeros((4, 4, 3))), r"transition of shape \(4, 4, 3\) is not possible"),
        (lambda: observability.gramian(ROWS, STEP * np.nan), "transition = nan is not possible: must be finite"),
        (lambda: observability.windowed_gram_determinant(ROWS * np.nan, STEP, 2), "rows = nan is not possible"),
        (lambda: observability.windowed_gram_determinant(ROWS, STEP, 2.0), "window = 2.0 is not possible"),
        (lambda: report_of(ROWS * np.nan), "rows = nan is not possible: must be finite"),
        (lambda: report_of(ROWS[:, :, :3]), r"transition of shape \(4, 4\) is not possible: must be \(3, 3\)"),
        (lambda: report_of(ROWS, scale=np.ones(3)), r"scale of shape \(3,\) is not possible: must be \(4,\)"),
        (lambda: report_of(ROWS, scale=np.zeros(4)), "scale = 0.0 is not possible: must be finite and above 0"),
        (lambda: report_of(ROWS, layout=StateLayout(3)), "rows of 4 states is not possible: the layout has 6"),
        (lambda: gain_of(np.ones((3, 3, 2))), r"after of shape \(3, 3, 2\) is not possible: must be \(4, 4, 2\)"),
        (lambda: gain_of(np.ones((4, 4, 2)), np.ones((4, 4))), r"prior_information of shape \(4, 4\) is not possible"),
        (
            lambda: observability.gram_gain(np.ones((4, 3, 2)), STEP, STEP),
            r"before of shape \(4, 3, 2\) is not",
        ),
    ],
)
def test_bad_input_is_refused_in_one_line(call: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


def report_of(rows: np.ndarray, layout: StateLayout | None = None, scale: np.ndarray | None = None) -> object:
    return observability.rank_report(rows, STEP, layout or StateLayout(), np.ones(4) if scale is None else scale)


def gain_of(after: np.ndarray, prior: np.ndarray | None = None) -> object:
    return observability.gram_gain(np.ones((4, 4, 2)), after, np.ones((4, 4, 1)) if prior is None else prior)
