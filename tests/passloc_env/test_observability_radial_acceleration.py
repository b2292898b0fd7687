"""The determinants of paper 002: derived by sympy from the measurement equations, evaluated far from its parameters."""

from __future__ import annotations

from collections.abc import Callable

import mpmath
import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st

from passloc_env.errors import InputError
from passloc_env.observability import (
    bearing_radial_acceleration_gram_determinant,
    degree_of_observability,
    radial_acceleration_gram_determinant,
    track_state_rows,
)

D, L, V, PHI = sympy.symbols("D L v phi", real=True)
T = sympy.symbols("T", positive=True)
STATE = (D, L, V, PHI)


def squared_range(age: int) -> sympy.Expr:
    return D**2 + (L - age * V * T) ** 2


def acceleration(age: int) -> sympy.Expr:
    """``a`` of paper 002, eq. 4, ``age`` periods ago."""
    return D**2 * V**2 / sympy.sqrt(squared_range(age)) ** 3


def bearing(age: int) -> sympy.Expr:
    """``θ`` of paper 002, eq. 12."""
    return sympy.atan2(L - age * V * T, D) + PHI


ACCELERATIONS = sympy.Matrix([acceleration(age) for age in range(3)]).jacobian(STATE[:3])
BOTH = sympy.Matrix([measure(age) for age in range(2) for measure in (bearing, acceleration)]).jacobian(STATE)


def test_eighteen_and_seventh_power_of_the_radial_acceleration_determinant() -> None:
    # Times r⁵ each row is a polynomial, and so is the determinant: the paper's 42 is 18, for every T.
    rows = [
        (ACCELERATIONS.row(age) * sympy.sqrt(squared_range(age)) ** 5).applyfunc(sympy.simplify) for age in range(3)
    ]
    determinant = sympy.expand(sympy.Matrix.vstack(*rows).det())
    assert sympy.expand(determinant + 18 * D**7 * V**8 * T**3) == 0


def test_three_of_the_bearing_and_radial_acceleration_determinant() -> None:
    powers = (2, 5, 2, 5)  # bearings lose their denominators with r², accelerations with r⁵
    rows = [
        (BOTH.row(i) * sympy.sqrt(squared_range(i // 2)) ** power).applyfunc(sympy.simplify)
        for i, power in enumerate(powers)
    ]
    determinant = sympy.expand(sympy.Matrix.vstack(*rows).det())
    claimed = -3 * D**4 * V**5 * T**2 * squared_range(0) * squared_range(1)
    assert sympy.expand(determinant - claimed) == 0


def test_the_degree_is_the_determinant_of_instants_close_together() -> None:
    r, aspect = sympy.symbols("r chi", positive=True)
    here = {D: r * sympy.sin(aspect), L: r * sympy.cos(aspect)}
    per_cubed_period = -18 * D**7 * V**8 / sympy.prod([sympy.sqrt(squared_range(age)) ** 5 for age in range(3)])
    together = per_cubed_period.subs(T, 0).subs(here)
    assert sympy.simplify(together + 18 * (V / r) ** 8 * sympy.sin(aspect) ** 7) == 0


# The paper's geometry (200 km, 200 to 350 m/s, 1 s) lies inside by far; below a metre a pulse spans many ranges.
DISTANCES = st.tuples(st.sampled_from([-1.0, 1.0]), st.floats(-3.0, 7.0)).map(lambda pair: pair[0] * 10.0 ** pair[1])
OFFSETS = st.floats(-1e6, 1e6)
SPEEDS = st.floats(-2.0, 4.0).map(lambda exponent: 10.0**exponent)
PERIODS = st.floats(-2.0, 3.0).map(lambda exponent: 10.0**exponent)

exact_accelerations = sympy.lambdify((*STATE[:3], T), ACCELERATIONS, "mpmath")
exact_both = sympy.lambdify((*STATE, T), BOTH, "mpmath")


@given(DISTANCES, OFFSETS, SPEEDS, PERIODS)
def test_determinants_equal_those_of_the_derived_jacobians(d: float, offset: float, v: float, period: float) -> None:
    with mpmath.workdps(120):
        arguments = [mpmath.mpf(value) for value in (d, offset, v)]
        three = float(mpmath.det(exact_accelerations(*arguments, mpmath.mpf(period))))
        four = float(mpmath.det(exact_both(*arguments, mpmath.mpf(0.3), mpmath.mpf(period))))
    # Formulas of some thirty roundings, whose one subtraction (L − ivT) may lose digits where it nears contact; the
    # oracle carries 120. Below 1e-280 the floats run out.
    near = min(np.hypot(d, offset - i * v * period) for i in range(3))
    tolerance = 1e-12 * (1.0 + abs(offset) / near)
    np.testing.assert_allclose(
        radial_acceleration_gram_determinant(d, offset, v, period), three, rtol=tolerance, atol=1e-280
    )
    np.testing.assert_allclose(
        bearing_radial_acceleration_gram_determinant(d, offset, v, period), four, rtol=tolerance, atol=1e-280
    )


@given(DISTANCES, OFFSETS, SPEEDS, PERIODS)
def test_rows_equal_the_derived_jacobians(d: float, offset: float, v: float, period: float) -> None:
    with mpmath.workdps(60):
        exact = exact_both(*map(mpmath.mpf, (d, offset, v, 0.3, period)))
        expected = np.array(exact.tolist(), float).reshape(2, 2, 4)
    near = min(np.hypot(d, offset - i * v * period) for i in range(2))
    # Entries are sums of at most two terms; what cancels is compared with the largest entry of its row.
    tolerance = 1e-12 * (1.0 + abs(offset) / near)
    found = track_state_rows(d, offset, v, period, 2, bearings=True)
    error = np.abs(found - expected) / np.abs(expected).max(axis=-1, keepdims=True)
    assert error.max() < tolerance
    np.testing.assert_array_equal(track_state_rows(d, offset, v, period, 2)[:, 0], found[:, 1, :3])


PAPER = [(200e3 * np.sin(chi), 200e3 * np.cos(chi), v) for chi in (np.pi / 4, np.pi / 3) for v in (200.0, 350.0)]


def test_determinants_of_the_papers_own_geometry() -> None:
    d, along, v = np.array(PAPER).T
    rows = track_state_rows(d, along, v, 1.0, 2, bearings=True).reshape(4, 4, -1)
    # A determinant in floats loses the digits by which two instants 200 m apart at 200 km resemble each other.
    scale = np.array([1e5, 1e5, 1e2, 1.0])[:, None]
    expected = np.linalg.det(np.moveaxis(rows * scale, -1, 0)) / scale.prod()
    found = bearing_radial_acceleration_gram_determinant(d, along, v, 1.0)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    with mpmath.workdps(60):
        exact = [float(mpmath.det(exact_accelerations(*map(mpmath.mpf, case), mpmath.mpf(1.0)))) for case in PAPER]
    np.testing.assert_allclose(radial_acceleration_gram_determinant(d, along, v, 1.0), exact, rtol=1e-12)  # roundings
    # The approximation moves with the range by at most 15 times 2 vT/r of 1/285.
    degree = degree_of_observability(200e3, v, np.arctan2(d, along), 1.0)
    np.testing.assert_allclose(degree, np.abs(exact), rtol=0.06)
    np.testing.assert_array_equal(degree_of_observability(200e3, v, -np.arctan2(d, along), 1.0), degree)


def test_a_radial_track_and_a_contact_give_zero_and_nothing_that_is_not_finite() -> None:
    d = np.array([0.0, 0.0, 0.0, 0.0, 5.0, 1e-70, 1e-30])
    along = np.array([0.0, 300.0, 600.0, 1e4, 0.0, 0.0, 0.0])
    v = np.array([300.0, 300.0, 300.0, 300.0, 0.0, 300.0, 300.0])
    three = radial_acceleration_gram_determinant(d, along, v, 1.0)
    four = bearing_radial_acceleration_gram_determinant(d, along, v, 1.0)
    np.testing.assert_array_equal(three[:6], 0.0)
    np.testing.assert_array_equal(four[:6], 0.0)
    rows = track_state_rows(d, along, v, 1.0, 3, bearings=True)
    for result in (three, four, rows, degree_of_observability(np.hypot(d, along), v, 0.7, 1.0)):
        assert np.isfinite(result).all()
    # Close to a contact the limit −3 v⁵T²/(D r₁⁵) holds, with r₁ = vT; roundings only.
    np.testing.assert_allclose(four[6], -3e30, rtol=1e-13)
    np.testing.assert_array_equal(rows[0, 1, :, 0], 0.0)
    np.testing.assert_array_equal(rows[0, 0, :, 0], [0.0, 0.0, 0.0, 1.0])
    assert degree_of_observability(0.0, 300.0, 0.7, 1.0) == 0.0


def test_arguments_broadcast_with_the_batch_last(assert_batch_free: Callable[..., None]) -> None:
    rng = np.random.default_rng(0)
    d, along, v = rng.uniform(-1e4, 1e4, 60), rng.uniform(-1e4, 1e4, 60), rng.uniform(1.0, 300.0, 60)
    assert radial_acceleration_gram_determinant(d[:5, None], along, 300.0, 1.0).shape == (5, 60)
    assert bearing_radial_acceleration_gram_determinant(1e3, 0.0, 300.0, 1.0).shape == ()
    assert track_state_rows(d[:5, None], along, 300.0, 1.0, 4, bearings=True).shape == (4, 2, 4, 5, 60)
    assert_batch_free(lambda *state: radial_acceleration_gram_determinant(*state, 2.0), d, along, v)
    assert_batch_free(lambda *state: bearing_radial_acceleration_gram_determinant(*state, 2.0), d, along, v)
    assert_batch_free(lambda *state: track_state_rows(*state, 2.0, 3, bearings=True), d, along, v)
    assert_batch_free(lambda r, a, speed: degree_of_observability(np.abs(r), speed, a, 2.0), d, along, v)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: radial_acceleration_gram_determinant(1.0, 1.0, 1.0, 0.0),
            "period = 0.0 is not possible: must be fini",
        ),
        (lambda: radial_acceleration_gram_determinant(np.nan, 1.0, 1.0, 1.0), "closest_approach = nan is not possible"),
        (lambda: bearing_radial_acceleration_gram_determinant(1.0, np.inf, 1.0, 1.0), "along_track = inf is not pos"),
        (lambda: bearing_radial_acceleration_gram_determinant(1.0, 1.0, 1.0, -1.0), "period = -1.0 is not possible"),
        (lambda: track_state_rows(1.0, 1.0, np.array([1.0, -np.inf]), 1.0, 3), "speed = -inf is not possible: must be"),
        (lambda: track_state_rows(1.0, 1.0, 1.0, np.nan, 3), "period = nan is not possible"),
        (lambda: track_state_rows(1.0, 1.0, 1.0, 1.0, 0), "instants = 0 is not possible: must be at least 1"),
        (
            lambda: track_state_rows(1.0, 1.0, 1.0, 1.0, 2.5),
            "instants = 2.5 is not possible: must be at least 1, a whole",
        ),
        (lambda: radial_acceleration_gram_determinant([1.0, 2.0], [1.0, 2.0, 3.0], 1.0, 1.0), "must broadcast against"),
        (
            lambda: radial_acceleration_gram_determinant(1.0, 1.0, 1.0, np.ones(2)),
            r"period = \[1. 1.\] is not possible",
        ),
        (
            lambda: degree_of_observability(1.0, "fast", 1.0, 1.0),
            "speed = 'fast' is not possible: must be real numbers",
        ),
        (lambda: degree_of_observability(-1.0, 1.0, 1.0, 1.0), "range = -1.0 is not possible: must be at least 0"),
        (lambda: degree_of_observability(1.0, 1.0, np.nan, 1.0), "aspect = nan is not possible"),
        (lambda: degree_of_observability(1.0, 1.0, 1.0, np.inf), "period = inf is not possible"),
    ],
)
def test_bad_input_is_refused_in_one_line(call: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_degrees_beyond_all_floats_are_infinite_and_silent() -> None:
    """pytest turns warnings into errors: ``18 (v/r)⁸`` of v/r = 1e60 is no float any more."""
    assert degree_of_observability(1.0, 1e60, 1.0, 1.0) == np.inf
    assert bearing_radial_acceleration_gram_determinant(1e-50, 0.0, 1e300, 1.0) == -np.inf
