"""Beats against numpy's polyfit, and their variances against sympy's sums."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st

from passloc_env.errors import InputError
from passloc_env.tracking.beats import line_covariance, line_fit, start_value_loss

SEEDS = st.integers(0, 2**32 - 1)
PULSES = st.integers(2, 200)
SPACINGS = st.floats(-4.0, 1.0).map(lambda exponent: 10.0**exponent)

K = sympy.symbols("K", integer=True, positive=True)
SPACING, AT = sympy.symbols("Delta", positive=True), sympy.symbols("at", real=True)


def derived_covariance() -> sympy.Matrix:
    """``(XᵀX)⁻¹`` of the line whose value is taken at ``AT (K − 1) Δ`` after the first pulse, for symbolic K."""
    k = sympy.symbols("k", integer=True)
    lever = (k - AT * (K - 1)) * SPACING
    normal = sympy.Matrix(2, 2, lambda i, j: sympy.summation(sympy.expand(lever ** (i + j)), (k, 0, K - 1)))
    return normal.inv().applyfunc(sympy.factor)


DERIVED = derived_covariance()


def test_variances_follow_from_the_normal_equations() -> None:
    start, middle = DERIVED.subs(AT, 0), DERIVED.subs(AT, sympy.Rational(1, 2))
    claimed_start = sympy.Matrix(
        [
            [2 * (2 * K - 1) / (K * (K + 1)), -6 / (K * (K + 1) * SPACING)],
            [-6 / (K * (K + 1) * SPACING), 12 / (K * (K**2 - 1) * SPACING**2)],
        ]
    )
    assert (start - claimed_start).applyfunc(sympy.simplify).is_zero_matrix
    claimed_middle = sympy.diag(1 / K, 12 / (K * (K**2 - 1) * SPACING**2))
    assert (middle - claimed_middle).applyfunc(sympy.simplify).is_zero_matrix


@given(PULSES, SPACINGS, st.floats(-2.0, 3.0))
def test_line_covariance_is_the_derived_one(pulses: int, spacing: float, at: float) -> None:
    exact = DERIVED.subs({K: pulses, SPACING: sympy.Float(spacing, 40), AT: sympy.Float(at, 40)}).evalf(30)
    expected = np.array(exact.tolist(), float)
    # A dozen roundings; near mid-beat the covariance vanishes, so it is compared with its two deviations.
    deviations = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        line_covariance(pulses, spacing, at) / np.outer(deviations, deviations),
        expected / np.outer(deviations, deviations),
        rtol=0.0,
        atol=1e-13,
    )


def test_loss_of_the_start_value() -> None:
    # Beats of 0.1 s and 1 s at a PRF of 100 Hz: √3.45 and √3.94 (paper 001); equal to rounding.
    assert start_value_loss(10) ** 2 == pytest.approx(38.0 / 11.0, rel=1e-15)
    assert start_value_loss(100) ** 2 == pytest.approx(398.0 / 101.0, rel=1e-15)
    assert (round(38.0 / 11.0, 2), round(398.0 / 101.0, 2)) == (3.45, 3.94)
    for pulses in (2, 3, 10, 100):
        start, middle = (line_covariance(pulses, 0.01, at)[0, 0] for at in (0.0, 0.5))
        assert start_value_loss(pulses) == pytest.approx(np.sqrt(start / middle), rel=1e-14)  # a dozen roundings


@given(SEEDS, st.integers(2, 60), SPACINGS)
def test_line_equals_polyfit(seed: int, pulses: int, spacing: float) -> None:
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(2, pulses, 3))
    fit = line_fit(values, spacing)
    # Counted in pulses from mid-beat polyfit is well conditioned; both sum at most 60 terms of order one.
    steps = np.arange(pulses) - 0.5 * (pulses - 1)
    slope, middle = np.polyfit(steps, np.moveaxis(values, 1, 0).reshape(pulses, -1), 1)
    np.testing.assert_allclose(fit.middle.ravel(), middle, atol=1e-13)
    np.testing.assert_allclose(fit.rate.ravel() * spacing, slope, atol=1e-13)
    np.testing.assert_allclose(fit.start.ravel(), middle + steps[0] * slope, atol=1e-12)
    np.testing.assert_array_equal(fit.start_covariance, line_covariance(pulses, spacing))
    np.testing.assert_array_equal(fit.middle_covariance, line_covariance(pulses, spacing, at=0.5))
    assert fit.middle_covariance[0, 1] == 0.0


def test_a_line_is_recovered_under_a_large_offset() -> None:
    # An offset of 1e9 leaves 1e-7 of the values themselves; the fit adds less than another such rounding.
    time = 0.01 * np.arange(100)[:, None]
    start, rate = np.array([1e9, -1e9, 0.0]), np.array([2.0, -3.0, 1e-3])
    fit = line_fit(start + rate * time, 0.01)
    np.testing.assert_allclose(fit.start, start, rtol=0.0, atol=2.5e-7)
    np.testing.assert_allclose(fit.middle, start + rate * 0.495, rtol=0.0, atol=2.5e-7)
    np.testing.assert_allclose(fit.rate, rate, rtol=0.0, atol=2.5e-7)


def test_noise_scatters_as_the_covariance_says() -> None:
    fit = line_fit(np.random.default_rng(5).normal(size=(10, 40_000)), 0.01)
    # 40 000 draws: standard deviations of a (co)variance are 1/√20 000 of it or less, 0.7 %; four of them.
    for value, covariance in ((fit.start, fit.start_covariance), (fit.middle, fit.middle_covariance)):
        deviations = np.sqrt(np.diag(covariance))
        np.testing.assert_allclose(
            np.cov(value, fit.rate) / np.outer(deviations, deviations),
            covariance / np.outer(deviations, deviations),
            atol=0.028,
        )


def test_leading_axes_are_kept_and_the_batch_does_not_matter(assert_batch_free: Callable[..., None]) -> None:
    values = np.random.default_rng(1).normal(size=(3, 2, 7, 50))
    assert [part.shape for part in line_fit(values, 0.1)[:3]] == [(3, 2, 50)] * 3
    np.testing.assert_array_equal(line_fit(values, 0.1).rate[1, 0], line_fit(values[1, 0], 0.1).rate)
    long = np.random.default_rng(2).normal(size=(37, 50))
    for part in range(3):
        assert_batch_free(lambda pulses, part=part: line_fit(pulses, 0.1)[part], values)
        assert_batch_free(lambda pulses, part=part: line_fit(pulses, 0.1)[part], long)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: line_fit(np.zeros((1, 3)), 0.1), "pulses = 1 is not possible: must be at least 2, a whole number"),
        (lambda: line_fit(np.zeros(3), 0.1), r"values of shape \(3,\) is not possible"),
        (lambda: line_fit(np.zeros((2, 3)), 0.0), "spacing = 0.0 is not possible: must be finite and above 0"),
        (lambda: line_fit(np.array([[0.0], [np.nan]]), 0.1), "values = nan is not possible: must be finite"),
        (lambda: line_covariance(0, 0.1), "pulses = 0 is not possible"),
        (lambda: line_covariance(2, np.inf), "spacing = inf is not possible"),
        (lambda: line_covariance(2, 0.1, at=np.nan), "at = nan is not possible: must be finite"),
        (lambda: start_value_loss(1), "pulses = 1 is not possible"),
        (lambda: start_value_loss(2.5), "pulses = 2.5 is not possible: must be at least 2, a whole number"),
        (lambda: line_covariance(10.5, 0.1), "pulses = 10.5 is not possible"),
        (lambda: line_fit([["a"], ["b"]], 0.1), "values = .* is not possible: must be real numbers"),
    ],
)
def test_bad_input_is_refused_in_one_line(call: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_whole_numbers_of_few_bits_do_not_wrap() -> None:
    """A falling line in bytes: 200, 150, 100, 50. Changes from the first pulse are negative, which bytes are not."""
    fit = line_fit(np.array([[200], [150], [100], [50]], np.uint8), 0.5)
    np.testing.assert_allclose([fit.start[0], fit.middle[0], fit.rate[0]], [200.0, 125.0, -100.0], rtol=1e-14)
