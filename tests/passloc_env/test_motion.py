"""Motions against the differential equations that they solve."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.special import spherical_jn

from passloc_env.angles import bearing_of, direction
from passloc_env.distributions import Uniform
from passloc_env.errors import ScenarioError
from passloc_env.layout import StateLayout
from passloc_env.motion import (
    ConstantAcceleration,
    ConstantVelocity,
    CoordinatedTurn,
    LinearMotion,
    Manoeuvre,
    Motion,
    ReversingAcceleration,
    UnknownTurn,
    sinc,
    spherical_j1,
)

PERIOD = 0.7
RATES = np.array([-0.05, 0.0, 1e-9, 0.3, 2.0])
# Matrix entries are of order one and computed in closed form: a few ulp apart from expm.
CLOSE = {"rtol": 1e-12, "atol": 1e-13}


def generator(layout: StateLayout, turn_rate: float = 0.0) -> np.ndarray:
    """The matrix A of ``ẋ = A x``: derivatives feed each other, and a turn to starboard couples the velocities."""
    matrix = np.zeros((layout.size, layout.size))
    for row in range(layout.kinematic.stop - layout.dimension):
        matrix[row, row + layout.dimension] = 1.0
    east, north = layout.velocity.start, layout.velocity.start + 1
    matrix[east, north], matrix[north, east] = turn_rate, -turn_rate
    return matrix


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("motion", [ConstantVelocity(), ConstantAcceleration()], ids=["CV", "CA"])
def test_transition_is_the_matrix_exponential(motion: LinearMotion, dimension: int) -> None:
    layout = motion.layout(dimension).with_nuisance(("carrier_offset",))
    expected = expm(generator(layout) * PERIOD)
    np.testing.assert_allclose(motion.transition(layout, PERIOD)[..., 0], expected, **CLOSE)


@pytest.mark.parametrize("dimension", [2, 3])
def test_turn_is_the_matrix_exponential(dimension: int) -> None:
    layout = StateLayout(dimension, 1, ("carrier_offset",))
    found = _with_rates(RATES).transition(layout, PERIOD)
    for column, rate in enumerate(RATES):
        np.testing.assert_allclose(found[..., column], expm(generator(layout, rate) * PERIOD), **CLOSE)


def _with_rates(rates: np.ndarray) -> CoordinatedTurn:
    """A realised turn, as the simulation makes it: one rate per environment."""
    motion = CoordinatedTurn(turn_rate=0.0)
    object.__setattr__(motion, "turn_rate", rates)
    return motion


@pytest.mark.parametrize("motion", [CoordinatedTurn(turn_rate=0.3), UnknownTurn()], ids=["known", "unknown"])
def test_positive_rates_turn_to_starboard(motion: Motion) -> None:
    layout = motion.layout(2)
    northbound = np.array([0.0, 0.0, 0.0, 10.0, 0.3])[: layout.size, None]
    if isinstance(motion, LinearMotion):
        moved = motion.transition(layout, 1.0)[..., 0] @ northbound
    else:
        moved = motion.propagate(northbound, layout, 1.0, np.zeros(1))
    assert bearing_of(moved[layout.velocity]) == pytest.approx(0.3)
    assert bearing_of(moved[layout.position]) == pytest.approx(0.15)


@pytest.mark.parametrize("dimension", [2, 3])
def test_unknown_turn_moves_like_the_known_one(dimension: int) -> None:
    motion, rng = UnknownTurn(), np.random.default_rng(0)
    layout = motion.layout(dimension).with_nuisance(("carrier_offset",))
    state = rng.normal(size=(layout.size, 4, len(RATES)))
    state[layout.nuisance_row("turn_rate")] = RATES
    before = state.copy()
    moved = motion.propagate(state, layout, PERIOD, np.zeros(len(RATES)))
    matrices = _with_rates(RATES).transition(layout, PERIOD)
    np.testing.assert_allclose(moved, np.einsum("ijN,jkN->ikN", matrices, state), **CLOSE)
    np.testing.assert_array_equal(state, before)


def test_known_acceleration_is_integrated() -> None:
    motion = ConstantVelocity(known_acceleration=(2.5, -1.0))
    layout = motion.layout(2)
    # The acceleration as two more states that stay as they are.
    augmented = np.zeros((6, 6))
    augmented[:4, :4], augmented[2, 4], augmented[3, 5] = generator(layout), 1.0, 1.0
    push = motion.known_input(layout, PERIOD)
    assert push is not None
    np.testing.assert_allclose(push[:, 0], expm(augmented * PERIOD)[:4, 4:] @ [2.5, -1.0], **CLOSE)
    assert ConstantVelocity().known_input(layout, PERIOD) is None


@pytest.mark.parametrize("axes", [(1.0,), (1.0, 2.0, 3.0)])
def test_known_acceleration_has_the_axes_of_the_problem(axes: tuple[float, ...]) -> None:
    with pytest.raises(ScenarioError, match="known_acceleration"):
        ConstantVelocity(known_acceleration=axes).check(2)


def integrate(state: np.ndarray, acceleration: float, turn_rate: float, duration: float) -> np.ndarray:
    """A planar state after ``duration`` seconds of along-track acceleration and turn."""

    def rates(_: float, y: np.ndarray) -> list[float]:
        east, north = y[2:]
        along = acceleration / math.hypot(east, north)
        return [east, north, along * east + turn_rate * north, along * north - turn_rate * east]

    return solve_ivp(rates, (0.0, duration), state, method="DOP853", rtol=1e-12, atol=1e-9).y[:, -1]


STATE = np.array([1e3, -2e3, 120.0, -90.0])
ACCELERATION, TURN_RATE = -1.5, 0.04
# Distances reach kilometres and the integrator is good to 1e-12 of them and of the speed.
INTEGRATED = {"rtol": 1e-9, "atol": 1e-6}


@pytest.mark.parametrize(
    ("kind", "accelerates", "turns"), [(0, 0, 0), (1, 1, 0), (2, 0, 1), (3, 1, 1)], ids=["none", "a", "turn", "both"]
)
@pytest.mark.parametrize(
    ("time", "share"),
    [(0.0, 0.0), (8.0, 0.5), (10.0, 1.0), (14.0, 1.0), (28.0, 0.25), (29.0, 0.0)],
    ids=["before", "starts within", "first", "amid", "ends within", "after"],
)
def test_manoeuvre_step(kind: int, accelerates: int, turns: int, time: float, share: float) -> None:
    """Accelerations and rates are held at their mean over the step, so the overlap scales them."""
    motion = Manoeuvre(start=10.0, duration=19.0, acceleration=ACCELERATION, turn_rate=TURN_RATE, kind=kind)
    moved = motion.propagate(STATE[:, None], motion.layout(2), 4.0, np.array([time]))
    expected = integrate(STATE, ACCELERATION * accelerates * share, TURN_RATE * turns * share, 4.0)
    np.testing.assert_allclose(moved[:, 0], expected, **INTEGRATED)


def test_environments_of_a_batch_manoeuvre_on_their_own() -> None:
    """Several in one step, some of them amid their manoeuvre, each as it would alone."""
    size, rng = 12, np.random.default_rng(1)
    numbers: dict[str, np.ndarray] = {
        "start": rng.uniform(0, 10, size),
        "duration": rng.uniform(0, 10, size),
        "acceleration": rng.uniform(-2, 2, size),
        "turn_rate": rng.uniform(-0.1, 0.1, size),
        "kind": np.arange(size) % 4.0,
    }
    batch = Manoeuvre(start=0.0, duration=0.0)
    for name, values in numbers.items():
        object.__setattr__(batch, name, values)
    states, time = STATE[:, None] + rng.normal(size=(4, size)), rng.uniform(0, 15, size)
    moved = batch.propagate(states, StateLayout(), 2.0, time)
    for column in range(size):
        alone = Manoeuvre(**{name: float(values[column]) for name, values in numbers.items()})
        expected = alone.propagate(states[:, [column]], StateLayout(), 2.0, time[[column]])
        assert moved[:, column].tobytes() == expected[:, 0].tobytes()


def test_manoeuvre_within_one_step() -> None:
    motion = Manoeuvre(start=1.0, duration=1.5, acceleration=ACCELERATION, turn_rate=TURN_RATE)
    moved = motion.propagate(STATE[:, None], motion.layout(2), 6.0, np.zeros(1))
    np.testing.assert_allclose(moved[:, 0], integrate(STATE, ACCELERATION / 4, TURN_RATE / 4, 6.0), **INTEGRATED)


@given(st.floats(0, 30), st.floats(0, 30), st.floats(-1, 1), st.floats(-0.2, 0.2))
def test_manoeuvre_changes_course_and_speed_by_the_whole_amount(
    start: float, duration: float, acceleration: float, turn_rate: float
) -> None:
    """However the manoeuvre falls between the steps, its total is kept."""
    motion = Manoeuvre(start=start, duration=duration, acceleration=acceleration, turn_rate=turn_rate)
    state, layout = STATE[:, None], motion.layout(2)
    for step in range(20):
        state = motion.propagate(state, layout, 3.0, np.array([3.0 * step]))
    speed = math.hypot(*STATE[2:]) + acceleration * duration
    course = bearing_of(STATE[2:]) + turn_rate * duration
    np.testing.assert_allclose(state[2:, 0], speed * direction(course), rtol=1e-9, atol=1e-9)


def test_manoeuvre_on_the_grid_is_exact() -> None:
    motion = Manoeuvre(start=10.0, duration=20.0, acceleration=ACCELERATION, turn_rate=TURN_RATE)
    state, layout = STATE[:, None], motion.layout(2)
    for step in range(20):
        state = motion.propagate(state, layout, 2.0, np.array([2.0 * step]))
    straight = STATE + 10 * np.pad(STATE[2:], (0, 2))
    turned = integrate(straight, ACCELERATION, TURN_RATE, 20.0)
    np.testing.assert_allclose(state[:, 0], turned + 10 * np.pad(turned[2:], (0, 2)), **INTEGRATED)


def test_manoeuvre_keeps_the_third_axis_and_the_nuisances() -> None:
    motion = Manoeuvre(start=0.0, duration=10.0, acceleration=1.0, turn_rate=0.1)
    layout = motion.layout(3).with_nuisance(("carrier_offset",))
    state = np.arange(1.0, 1.0 + layout.size)[:, None]
    moved = motion.propagate(state, layout, 2.0, np.zeros(1))
    flat = motion.propagate(state[[0, 1, 3, 4]], StateLayout(2), 2.0, np.zeros(1))
    np.testing.assert_array_equal(moved[[0, 1, 3, 4]], flat)
    np.testing.assert_array_equal(moved[[2, 5, 6]], [state[2] + 2.0 * state[5], state[5], state[6]])


def test_manoeuvre_at_rest_stays_finite() -> None:
    motion = Manoeuvre(start=0.0, duration=1.0, turn_rate=1.0)
    moved = motion.propagate(np.zeros((4, 2)), motion.layout(2), 1.0, np.zeros(2))
    # A speed of 1e-9 m/s stands in for none.
    np.testing.assert_allclose(moved, 0.0, atol=1e-8)


MANOEUVRING = Manoeuvre(start=3.0, duration=20.0, acceleration=1.0, turn_rate=0.1)


@pytest.mark.parametrize(
    "motion",
    [UnknownTurn(), MANOEUVRING, ReversingAcceleration(reversal=1.2)],
    ids=["unknown turn", "manoeuvre", "reversal"],
)
def test_bits_do_not_depend_on_the_batch(motion: Motion, assert_batch_free: Callable[..., None]) -> None:
    layout, rng = motion.layout(2), np.random.default_rng(0)
    states, times = rng.normal(size=(layout.size, 300)), rng.uniform(0, 30, 300)
    assert_batch_free(lambda x, t: motion.propagate(x, layout, PERIOD, t), states, times)


@given(st.floats(-10, 10).filter(lambda x: x == 0.0 or abs(x) > 1e-100))  # SciPy's own j₁ is NaN for smaller ones
def test_bessel_functions(x: float) -> None:
    at = np.array([x])
    # The closed form of j₁ cancels four digits at |x| = 0.05, where the series takes over.
    assert sinc(at)[0] == pytest.approx(spherical_jn(0, x), abs=1e-14)
    assert spherical_j1(at)[0] == pytest.approx(math.copysign(1, x) * spherical_jn(1, abs(x)), abs=1e-13)


def test_manoeuvre_is_no_model_and_has_no_noise() -> None:
    assert not MANOEUVRING.model
    assert MANOEUVRING.noise_gain(StateLayout(), 1.0).shape == (4, 0, 1)


LATE = 3.5
"""The instant at which the step begins in the tests of a reversal."""


def reversed_by_integration(state: np.ndarray, layout: StateLayout, reversal: float, end: float) -> np.ndarray:
    """A state ``(n,)`` at 3.5 s, integrated up to the reversal and, with the acceleration turned round, after it."""
    at, now = state.copy(), LATE
    for until, flips in ((min(max(reversal, LATE), end), LATE < reversal <= end), (end, False)):
        matrix = generator(layout)
        solved = solve_ivp(lambda _, x, a=matrix: a @ x, (now, until), at, rtol=1e-11, atol=1e-11)
        at, now = solved.y[:, -1], until
        if flips:
            at[layout.acceleration] *= -1.0
    return at


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("reversal", [1e-3, 3.4, LATE, 3.6, 3.9, LATE + PERIOD, 4.3, 100.0])
def test_reversal_before_at_the_edges_of_inside_and_after_a_step(dimension: int, reversal: float) -> None:
    """At its end edge a step turns the acceleration round without having felt it; the next one does not turn again."""
    motion = ReversingAcceleration(reversal=reversal)
    layout = motion.layout(dimension).with_nuisance(("carrier_offset",))
    state = np.random.default_rng(2).normal(size=(layout.size, 1))
    kept = state.copy()
    moved = motion.propagate(state, layout, PERIOD, np.array([LATE]))
    expected = reversed_by_integration(state[:, 0], layout, reversal, LATE + PERIOD)
    np.testing.assert_allclose(moved[:, 0], expected, atol=1e-9)  # what the integration is good for
    turned = LATE < reversal <= LATE + PERIOD
    np.testing.assert_array_equal(moved[layout.acceleration], (-1.0 if turned else 1.0) * state[layout.acceleration])
    np.testing.assert_array_equal(moved[layout.nuisances], state[layout.nuisances])
    np.testing.assert_array_equal(state, kept)


@pytest.mark.parametrize("period", [0.01, 0.1, 0.3, 0.7, 1.0, 2.0])
def test_the_acceleration_turns_round_once_wherever_the_reversal_falls(period: float) -> None:
    """On the clock of an episode, ``step · period``: at every instant of it, as one would write it, and in between.

    Against the closed form of the whole way; 150 steps of positions up to 10⁴ leave rounding of 1e-9.
    """
    steps = 150
    reversal = np.concatenate([np.round(period * np.arange(1, steps), 6), period * (0.37 + np.arange(steps - 1))])
    motion = ReversingAcceleration(reversal=1.0)
    object.__setattr__(motion, "reversal", reversal)
    layout = motion.layout(2)
    start = np.array([10.0, -20.0, 3.0, 1.0, 0.5, -0.2])[:, None] * np.ones(len(reversal))
    state = start.copy()
    for step in range(steps):
        state = motion.propagate(state, layout, period, np.full(len(reversal), step * period))
    place, speed, push = start[:2], start[2:4], start[4:]
    rest = steps * period - reversal
    turning = speed + push * reversal
    expected = place + speed * reversal + 0.5 * push * reversal**2 + turning * rest - 0.5 * push * rest**2
    np.testing.assert_array_equal(state[4:], -push)
    np.testing.assert_allclose(state[2:4], turning - push * rest, atol=1e-9)
    np.testing.assert_allclose(state[:2], expected, rtol=1e-10, atol=1e-9)


def test_environments_reverse_on_their_own() -> None:
    """Reversal and clock differ from column to column; each column is what it is alone."""
    reversal, time = np.array([0.1, 1.0, 1.2, 1.69, 5.0, 2.0]), np.array([0.0, 1.0, 1.0, 1.0, 1.0, 3.0])
    motion = ReversingAcceleration(reversal=1.0)
    object.__setattr__(motion, "reversal", reversal)
    layout = motion.layout(2)
    state = np.random.default_rng(3).normal(size=(layout.size, 6))
    moved = motion.propagate(state, layout, PERIOD, time)
    for column in range(6):
        alone = ReversingAcceleration(reversal=float(reversal[column]))
        part = slice(column, column + 1)
        np.testing.assert_array_equal(moved[:, part], alone.propagate(state[:, part], layout, PERIOD, time[part]))


def test_a_reversal_is_no_model_and_has_no_noise() -> None:
    motion = ReversingAcceleration(reversal=1.0)
    assert not motion.model
    assert motion.layout(2) == StateLayout(2, 2)
    assert motion.noise_gain(motion.layout(2), PERIOD).shape == (6, 0, 1)


@pytest.mark.parametrize("reversal", [0.0, -1.0, Uniform(low=0.0, high=2.0)])
def test_a_reversal_comes_after_the_start(reversal: object, refusal: Callable[..., ScenarioError]) -> None:
    """At the very start there is nothing yet to turn round: no step would do it."""
    assert refusal(lambda: ReversingAcceleration(reversal=reversal)).field == "reversal"
