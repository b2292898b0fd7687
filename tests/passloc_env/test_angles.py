"""Angles go round the circle, and compass angles go clockwise from north."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passloc_env.angles import bearing_of, direction, wrap, wrap_in_place

# Angles to 1e4 rad: float64 resolves 2e-12 rad there, which is what every tolerance below allows for.
ANGLES = st.floats(-1e4, 1e4)
ROUNDING = 1e-11


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (0.0, 0.0),
        (1.0, 1.0),
        (3.5, 3.5 - math.tau),
        (-3.5, math.tau - 3.5),
        (7.0, 7.0 - math.tau),
        (-50.0, -50 + 16 * math.pi),
    ],
)
def test_wrap_by_hand(angle: float, wrapped: float) -> None:
    assert wrap(angle) == pytest.approx(wrapped, abs=ROUNDING)


@given(ANGLES)
def test_wrap_is_the_same_angle_within_half_a_turn(angle: float) -> None:
    wrapped = wrap(angle)
    assert abs(wrapped) <= math.pi + ROUNDING
    assert math.remainder(wrapped - angle, math.tau) == pytest.approx(0.0, abs=ROUNDING)


@given(st.lists(ANGLES, min_size=1, max_size=20))
def test_wrap_in_place_has_the_bits_of_wrap(angles: list[float]) -> None:
    array = np.array(angles)
    expected = wrap(array)
    wrap_in_place(array)
    assert array.tobytes() == expected.tobytes()


@pytest.mark.parametrize(
    ("vector", "degrees"),
    [((0, 1), 0), ((1, 1), 45), ((1, 0), 90), ((1, -1), 135), ((0, -1), 180), ((-1, 0), -90), ((-1, 1), -45)],
)
def test_bearings_are_compass_bearings(vector: tuple[float, float], degrees: float) -> None:
    assert np.degrees(bearing_of(np.array(vector, float))) == pytest.approx(degrees)


@given(st.floats(-math.pi, math.pi))
def test_direction_is_the_unit_vector_of_a_bearing(bearing: float) -> None:
    towards = direction(bearing)
    assert np.hypot(*towards) == pytest.approx(1.0)
    assert math.remainder(bearing_of(towards) - bearing, math.tau) == pytest.approx(0.0, abs=ROUNDING)


def test_positive_rates_turn_to_starboard() -> None:
    before, after = direction(np.array([0.3, 0.3 + 1e-3])).T
    starboard = np.array([before[1], -before[0]])
    assert (after - before) @ starboard == pytest.approx(1e-3, rel=1e-6)


def test_bearing_ignores_height_and_keeps_the_batch() -> None:
    vectors = np.random.default_rng(0).normal(size=(3, 5, 7))
    np.testing.assert_array_equal(bearing_of(vectors), bearing_of(vectors[:2]))
    assert direction(np.zeros((5, 7))).shape == (2, 5, 7)
