"""A straight track from three radial accelerations: recovered where there is one, flagged where there is none."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st

from passloc_env.errors import InputError
from passloc_env.tracking.radial_acceleration import solve_track

SEEDS = st.integers(0, 2**32 - 1)


def accelerations(distance: np.ndarray, along: np.ndarray, speed: np.ndarray, period: float) -> np.ndarray:
    """``D² v² / r³`` at the latest three instants ``(3, N)``, oldest first."""
    offsets = along + period * speed * np.array([-2.0, -1.0, 0.0])[:, None]
    return distance**2 * speed**2 / np.hypot(distance, offsets) ** 3


def test_the_quadratic_in_time_and_its_invariant() -> None:
    d, v, t = sympy.symbols("D v t", positive=True)
    along = sympy.symbols("L", real=True)
    scale = (d * v) ** sympy.Rational(4, 3)
    a, b, c = v**2 / scale, 2 * along * v / scale, (d**2 + along**2) / scale
    power = (d**2 + (along + v * t) ** 2) / (d**2 * v**2) ** sympy.Rational(2, 3)
    assert sympy.simplify(power - (a * t**2 + b * t + c)) == 0
    assert sympy.simplify(a * c - b**2 / 4 - (d * v) ** sympy.Rational(-2, 3)) == 0


@given(SEEDS, st.floats(-2.0, 2.0))
def test_random_tracks_are_recovered(seed: int, exponent: float) -> None:
    rng = np.random.default_rng(seed)
    period = 10.0**exponent
    speed = 10.0 ** rng.uniform(-1.0, 3.5, 20)
    step = speed * period
    distance, along = step * 10.0 ** rng.uniform(-1.0, 1.5, 20), step * rng.uniform(-20.0, 20.0, 20)
    found = solve_track(accelerations(distance, along, speed, period), period)
    assert found.sound.all()
    # Rounding of 1e-16 grows with the curvature's share of a^(−2/3), (r/vT)² up to 2.6e3, and once more with that of
    # D² in r², up to (200)² for the most oblique of these tracks.
    ranges = np.hypot(distance, np.abs(along) + 2.0 * step)
    growth = (ranges / step) ** 2 * (ranges / distance) ** 2
    error = np.abs(found.state - np.stack([distance, along, speed])) / np.stack([distance, ranges, speed])
    assert (error < 1e-14 * growth + 1e-13).all()


def test_the_papers_geometry_is_recovered() -> None:
    # 200 km, 45° and 60°, 200 and 350 m/s (paper 002, sec. 3), instants a minute apart: (r/vT)² is below 300.
    aspect, speed = np.repeat([np.pi / 4, np.pi / 3], 2), np.tile([200.0, 350.0], 2)
    truth = np.stack([200e3 * np.sin(aspect), -200e3 * np.cos(aspect), speed])
    found = solve_track(accelerations(*truth, 60.0), 60.0)
    assert found.sound.all()
    np.testing.assert_allclose(found.state, truth, rtol=1e-11)


def test_side_of_passage_and_units_do_not_matter() -> None:
    distance, along, speed = np.array([300.0]), np.array([-450.0]), np.array([200.0])
    left, right = (solve_track(accelerations(side * distance, along, speed, 1.0), 1.0) for side in (-1.0, 1.0))
    np.testing.assert_array_equal(left.state, right.state)
    # A thousandth of all lengths scales accelerations alike, and the solution with them; rounding only.
    small = solve_track(1e-3 * accelerations(distance, along, speed, 1.0), 1.0)
    np.testing.assert_allclose(small.state, 1e-3 * right.state, rtol=1e-12)


IMPOSSIBLE = {
    "negative": (1.0, -1.0, 1.0),
    "zero, a radial track or an emitter at rest": (0.0, 0.0, 0.0),
    "latest zero": (1.0, 1.0, 0.0),
    "constant": (0.3, 0.3, 0.3),
    "constant but for rounding": (0.3, 0.3 * (1.0 + 4e-16), 0.3),
    "curved the wrong way": (1.0, 0.1, 1.0),
    "through zero": (0.01, 100.0, 0.02),
    "to zero and back": (1.0, 8.0**-1, 27.0**-1),
    "not a number": (np.nan, 1.0, 1.0),
    "oldest infinite": (np.inf, 1.0, 1.0),
    "previous infinite": (1.0, np.inf, 1.0),
    "latest infinite": (1.0, 1.0, np.inf),
    "all infinite": (np.inf, np.inf, np.inf),
    "of a track too large for floats": (0.37e308, 0.74e308, 1.7e308),
    "beyond floats": (1e-300, 1e300, 1e-300),
    "beyond floats the other way": (1e300, 1.0, 1e-308),
    "denormal": (1.0, 5e-324, 1.0),
}


@pytest.mark.parametrize("values", IMPOSSIBLE.values(), ids=IMPOSSIBLE.keys())
def test_what_is_no_straight_track_is_flagged_and_zero(values: tuple[float, ...]) -> None:
    good = accelerations(np.array([300.0]), np.array([-450.0]), np.array([200.0]), 1.0)
    found = solve_track(np.concatenate([np.array(values)[:, None], good], axis=1), 1.0)
    np.testing.assert_array_equal(found.sound, [False, True])
    np.testing.assert_array_equal(found.state[:, 0], 0.0)
    np.testing.assert_allclose(found.state[:, 1], [300.0, -450.0, 200.0], rtol=1e-12)  # (r/vT)² is 10


@given(SEEDS)
def test_any_accelerations_give_finite_answers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = rng.choice([-1.0, 1.0, 1.0, 1.0], (3, 50)) * 10.0 ** rng.uniform(-320.0, 308.0, (3, 50))
    found = solve_track(values, 1.0)
    assert np.isfinite(found.state).all()
    assert (found.state[:, ~found.sound] == 0.0).all()
    assert (found.state[[0, 2]][:, found.sound] > 0.0).all()


def test_the_batch_does_not_matter(assert_batch_free: Callable[..., None]) -> None:
    values = np.random.default_rng(0).uniform(-0.5, 2.0, (3, 80))
    assert_batch_free(lambda a: solve_track(a, 2.0).state, values)
    assert_batch_free(lambda a: solve_track(a, 2.0).sound, values)


@pytest.mark.parametrize("period", [0.0, -1.0, np.nan, np.inf])
def test_an_impossible_period_is_refused(period: float) -> None:
    with pytest.raises(InputError, match=f"period = {period} is not possible: must be finite and above 0"):
        solve_track(np.ones((3, 1)), period)


@pytest.mark.parametrize("shape", [(2, 1), (3,), (4, 1)])
def test_another_number_of_accelerations_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match=r"accelerations of shape .* is not possible: must be"):
        solve_track(np.ones(shape), 1.0)


def test_lists_are_as_good_as_arrays() -> None:
    accelerations = [[1.0], [1.3], [1.0]]
    np.testing.assert_array_equal(
        solve_track(accelerations, 10.0).state, solve_track(np.array(accelerations), 10.0).state
    )
    with pytest.raises(InputError, match="accelerations is not possible: must be numbers in rows of equal length"):
        solve_track([[1.0], [1.0, 2.0], [1.0]], 10.0)
