"""Metrics against loops that anybody can read."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from passloc_env.metrics import log_range_bound, lost, nees, relative_range_error, root_trace, time_to

HISTORIES = arrays.arrays(
    float,
    st.tuples(st.integers(1, 30), st.integers(1, 4)),
    elements=st.sampled_from([0.05, 0.1, 0.2, math.nan, math.inf]),
)


def first_time(level: float, errors: list[float], period: float, window: int) -> float:
    for start in range(len(errors) - window + 1):
        if all(error <= level for error in errors[start : start + window]):
            return (start + 1) * period
    return len(errors) * period


@given(HISTORIES, st.sampled_from([0.5, 1.0, 4.0, 60.0]), st.sampled_from([0.0, 1.0, 3.0, 10.0]))
def test_time_to(errors: np.ndarray, period: float, hold: float) -> None:
    window = max(1, round(hold / period))
    expected = [first_time(0.1, list(column), period, window) for column in errors.T]
    np.testing.assert_array_equal(time_to(0.1, errors, period, hold), expected)


def test_time_to_by_hand() -> None:
    errors = np.array([[0.5, 0.1, 0.1, 0.5], [0.1, 0.1, 0.5, 0.1], [0.1, 0.1, 0.1, 0.1], [0.1, 0.1, 0.1, 0.5]])
    np.testing.assert_array_equal(time_to(0.1, errors, 5.0), [10.0, 5.0, 15.0, 10.0])


@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_nees_is_the_quadratic_form(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    root, error = rng.normal(size=(n, n, 5)), rng.normal(size=(n, 5))
    covariance = np.einsum("ikN,jkN->ijN", root, root) + 0.1 * np.eye(n)[..., None]
    before = error.copy()
    expected = [error[:, c] @ np.linalg.solve(covariance[..., c], error[:, c]) for c in range(5)]
    np.testing.assert_allclose(nees(error, covariance), expected, rtol=1e-9)
    np.testing.assert_array_equal(error, before)


def test_nees_is_chi_square_when_consistent() -> None:
    rng, draws = np.random.default_rng(0), 50_000
    root = rng.normal(size=(4, 4))
    covariance = (root @ root.T)[..., None] * np.ones(draws)
    values = nees(root @ rng.standard_normal((4, draws)), covariance)
    # Four standard errors of a mean of χ²(4): by chance once in 16 000 seeds.
    assert values.mean() == pytest.approx(4.0, abs=4.0 * math.sqrt(8.0 / draws))


@pytest.mark.parametrize("dimension", [2, 3])
def test_relative_range_error(dimension: int) -> None:
    errors, ranges = np.random.default_rng(1).normal(size=(dimension, 9)), np.linspace(1.0, 9.0, 9)
    np.testing.assert_allclose(relative_range_error(errors, ranges), np.linalg.norm(errors, axis=0) / ranges)


def test_log_range_bound() -> None:
    np.testing.assert_allclose(log_range_bound(np.array([10.0, 1.0]), np.array([10.0, math.e])), [0.0, -1.0])


@pytest.mark.parametrize(
    ("error", "final_nees", "expected"),
    [
        (0.5, 4.0, False),
        (1.0, 100.0, False),
        (1.01, 4.0, True),
        (0.5, 100.1, True),
        (math.nan, 4.0, True),
        (0.5, math.nan, True),
        (math.inf, 4.0, True),
        (0.5, math.inf, True),
    ],
)
def test_lost(error: float, final_nees: float, expected: bool) -> None:
    assert lost(np.array([error]), np.array([final_nees])).tolist() == [expected]


def test_bits_do_not_depend_on_the_batch(assert_batch_free: Callable[..., None]) -> None:
    rng = np.random.default_rng(2)
    root, errors = rng.normal(size=(4, 4, 300)), rng.normal(size=(4, 300))
    covariance = np.einsum("ikN,jkN->ijN", root, root) + np.eye(4)[..., None]
    assert_batch_free(nees, errors, covariance)
    assert_batch_free(lambda e: relative_range_error(e[:2], np.hypot(e[2], e[3])), errors)
    assert_batch_free(lambda e: time_to(0.5, np.abs(e), 1.0, 2.0), errors)


def test_root_trace_is_the_length_of_the_deviations() -> None:
    covariance = np.diag([9.0, 16.0, 1e6, 25.0])[..., None]
    kept = covariance.copy()
    assert (root_trace(covariance, slice(0, 2))[0], root_trace(covariance, slice(3, 4))[0]) == (5.0, 5.0)
    np.testing.assert_array_equal(covariance, kept)
