"""What fixed stations can see: ranks of the augmented pseudo-linear forms, and the corollaries that predict them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from passloc_env import observability
from passloc_env.angles import bearing_of, direction
from passloc_env.errors import InputError
from passloc_env.layout import StateLayout
from passloc_env.motion import ConstantAcceleration, ConstantVelocity, CoordinatedTurn, LinearMotion
from passloc_env.units import DEGREE, KILOMETRE

LIGHT, SOUND = 299_792_458.0, 1500.0
PLANAR, ACCELERATED = StateLayout(), StateLayout(order=2)
ORIGIN = np.zeros((1, 2))
ARRAYS = np.array([[0.0, 0.0], [1e3, 0.0]])
SEEDS = st.integers(0, 2**32 - 1)


def track(motion: LinearMotion, layout: StateLayout, start: np.ndarray, period: float, instants: int) -> np.ndarray:
    """Noise-free positions ``(K, 2, N)`` from a start ``(n, N)``."""
    transition, push = motion.transition(layout, period), motion.known_input(layout, period)
    state = np.asarray(start, float)
    positions = []
    for _ in range(instants):
        positions.append(state[layout.position])
        state = np.einsum("ijn,jn->in", np.broadcast_to(transition, (*transition.shape[:2], state.shape[1])), state)
        state = state if push is None else state + push
    return np.stack(positions)


def seen_from(stations: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Bearings ``(K, S, N)`` at stations ``(S, 2)`` of positions ``(K, 2, N)``."""
    return bearing_of(np.moveaxis(positions[:, None] - stations[:, :, None], 2, 0))


def report(
    bearings: np.ndarray, stations: np.ndarray, motion: LinearMotion, layout: StateLayout, period: float, speed: float
) -> observability.RankReport:
    """Rank of the augmented form with frequency at the first station, time counted in records."""
    duration = period * (len(bearings) - 1)
    rows = observability.augmented_pseudo_linear_rows(
        bearings, stations, layout, propagation_speed=speed, duration=duration
    )
    augmented = observability.augmented_layout(layout)
    transition = observability.augmented_transition(motion.transition(layout, period))
    scale = observability.record_scale(augmented, duration)
    return observability.rank_report(rows, transition, augmented, scale)


def accelerating(east: float, north: float) -> ConstantVelocity:
    return ConstantVelocity(known_acceleration=(east, north))


# Paper 000, sec. 4: motion and start (km, m/s). Its turn rates are counter-clockwise.
CASES: dict[str, tuple[LinearMotion, tuple[float, ...]]] = {
    "1a": (accelerating(2.5, 0.0), (120.0, 60.0, 100.0, -175.0)),
    "1b": (accelerating(-2.0, -1.0), (120.0, 60.0, 200.0, 100.0)),
    "2a": (CoordinatedTurn(turn_rate=-3.0 * DEGREE), (35.0, 60.0, 120.0, 160.0)),
    "2b": (CoordinatedTurn(turn_rate=-0.5 * DEGREE), (23.0, 0.0, 0.0, 200.0)),
    "a true circle": (CoordinatedTurn(turn_rate=-0.5 * DEGREE), (0.4 / DEGREE, 0.0, 0.0, 200.0)),
}


def case(name: str) -> tuple[LinearMotion, np.ndarray]:
    """Motion of a case of paper 000, and bearings ``(K, 1, 1)`` once a second for 300 s."""
    motion, start = CASES[name]
    state = np.array(start)[:, None] * np.array([KILOMETRE, KILOMETRE, 1.0, 1.0])[:, None]
    return motion, seen_from(ORIGIN, track(motion, PLANAR, state, 1.0, 301))


@pytest.mark.parametrize(("name", "rank"), [("1a", 5), ("1b", 3), ("2a", 5), ("2b", 5), ("a true circle", 4)])
def test_ranks_of_the_five_column_form(name: str, rank: int) -> None:
    motion, bearings = case(name)
    assert report(bearings, ORIGIN, motion, PLANAR, 1.0, LIGHT).rank == rank


def test_case_2b_is_observable_and_only_just() -> None:
    # v/ω is 22918 m and not 23000 m: the condition is 1.6e3 where that of 2a is 27. Two digits are what is claimed.
    motion, bearings = case("2b")
    (condition,) = report(bearings, ORIGIN, motion, PLANAR, 1.0, LIGHT).condition
    assert 1.55e3 < condition < 1.65e3
    motion, bearings = case("2a")
    (condition,) = report(bearings, ORIGIN, motion, PLANAR, 1.0, LIGHT).condition
    assert 26.0 < condition < 28.0


def test_condition_is_of_the_geometry_alone() -> None:
    # Twice as far and as fast, or in slow motion, it is the same picture; only rounding differs.
    motion, start = CASES["2b"]
    state = np.array(start)[:, None] * np.array([KILOMETRE, KILOMETRE, 1.0, 1.0])[:, None]
    slow = CoordinatedTurn(turn_rate=-0.25 * DEGREE)
    far = seen_from(ORIGIN, track(motion, PLANAR, 2.0 * state, 1.0, 301))
    late = seen_from(ORIGIN, track(slow, PLANAR, state * np.array([[1.0], [1.0], [0.5], [0.5]]), 2.0, 301))
    conditions = [
        report(case("2b")[1], ORIGIN, motion, PLANAR, 1.0, LIGHT).condition,
        report(far, ORIGIN, motion, PLANAR, 1.0, LIGHT).condition,
        report(late, ORIGIN, slow, PLANAR, 2.0, SOUND).condition,
    ]
    np.testing.assert_allclose(conditions[1:], [conditions[0]] * 2, rtol=1e-8)


def test_radial_acceleration_hides_the_range_along_the_line_of_sight() -> None:
    motion, bearings = case("1b")
    rows = observability.pseudo_linear_rows(bearings[:, 0], PLANAR, doppler=True)
    scale = observability.record_scale(PLANAR, 300.0)
    found = observability.rank_report(rows, motion.transition(PLANAR, 1.0), PLANAR, scale)
    assert found.rank == 3
    # Between east and north at 63.4°, so mostly east; the direction is null to rounding.
    assert found.weakest_name == ("east",)
    along = found.weakest[:, 0] / np.linalg.norm(found.weakest[:, 0])
    np.testing.assert_allclose(along, np.array([2.0, 1.0, 0.0, 0.0]) / np.sqrt(5.0), atol=1e-9)


def test_radial_acceleration_also_confuses_speed_with_the_constant() -> None:
    # With the constant as a state two directions are dark; the report names one of them or a mixture.
    motion, bearings = case("1b")
    found = report(bearings, ORIGIN, motion, PLANAR, 1.0, LIGHT)
    dark = np.array([[2.0, 1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 2.0, 1.0, np.sqrt(5.0)]])
    weakest = found.weakest[:, 0]
    coefficients = np.linalg.lstsq(dark.T, weakest, rcond=None)[0]
    np.testing.assert_allclose(dark.T @ coefficients, weakest, atol=1e-9 * np.abs(weakest).max())  # null to rounding


def dual_array_record(offset: float = 0.0) -> np.ndarray:
    """The track of paper 003, sec. 3, moved ``offset`` metres off the baseline: bearings ``(501, 2, 1)``, every 2 s."""
    time = 2.0 * np.arange(501)
    later = time - 500.0
    east = np.where(later <= 0.0, -5e3 + 0.02 * time**2, 20.0 * later - 0.02 * later**2)
    positions = np.stack([east, np.full(501, offset)], axis=1)[..., None]
    bearings = seen_from(ARRAYS, positions)
    if offset == 0.0:
        # At 500 s the track lies on the first array: there the bearing is the limit from before.
        bearings[250, 0] = bearings[249, 0]
    return bearings


BEFORE, AFTER, WHOLE = slice(0, 251), slice(251, 501), slice(0, 501)


@pytest.mark.parametrize(("part", "rank"), [(BEFORE, 5), (AFTER, 5), (WHOLE, 6)])
def test_ranks_of_the_seven_column_form_on_the_baseline(part: slice, rank: int) -> None:
    # The flip of the bearing at the first array tells speed from the constant, but never where the emitter is.
    found = report(dual_array_record()[part], ARRAYS, ConstantAcceleration(), ACCELERATED, 2.0, SOUND)
    assert found.rank == rank
    if rank == 6:
        assert found.weakest_name == ("east",)


@pytest.mark.parametrize("offset", [50.0, 1000.0])
@pytest.mark.parametrize("part", [BEFORE, AFTER, WHOLE])
def test_off_the_baseline_all_seven_columns_are_seen(part: slice, offset: float) -> None:
    found = report(dual_array_record(offset)[part], ARRAYS, ConstantAcceleration(), ACCELERATED, 2.0, SOUND)
    assert found.rank == 7
    assert found.condition < 110.0  # the worst of the six, 50 m off and after the origin, is 104


@given(SEEDS)
def test_rows_of_the_augmented_form_hold_at_the_truth(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stations = rng.uniform(-5e3, 5e3, (3, 2))
    state = rng.uniform(-1.0, 1.0, (6, 4)) * np.array([2e4, 2e4, 50.0, 50.0, 1.0, 1.0])[:, None]
    bearings = seen_from(stations, state[None, :2])
    rows = observability.augmented_pseudo_linear_rows(
        bearings, stations, ACCELERATED, propagation_speed=SOUND, duration=60.0, frequency_stations=(2, 0)
    )
    assert rows.shape == (1, 5, 7, 4)
    found = np.einsum("kmin,in->kmn", rows, np.concatenate([state, np.full((1, 4), SOUND)]))
    closing = np.einsum("sin,in->sn", np.moveaxis(direction(bearings[0]), 0, 1), state[2:4])
    # Terms reach 500 m/s, so rounding is below 1e-12 of a metre per second times a few.
    np.testing.assert_allclose(found[0, :3], 0.0, atol=1e-11)
    np.testing.assert_allclose(found[0, 3:], SOUND - closing[[2, 0]], rtol=1e-12)


def test_without_frequency_the_rows_are_homogeneous() -> None:
    # Bearings never tell the state and the constant from a multiple of both, however rich the geometry.
    bearings = dual_array_record(1000.0)
    layout = observability.augmented_layout(ACCELERATED)
    rows = observability.augmented_pseudo_linear_rows(
        bearings, ARRAYS, ACCELERATED, propagation_speed=SOUND, duration=1e3, frequency_stations=()
    )
    transition = observability.augmented_transition(ConstantAcceleration().transition(ACCELERATED, 2.0))
    scale = observability.record_scale(layout, 1e3)
    first_half = observability.rank_report(rows[BEFORE], transition, layout, scale)
    assert first_half.rank == 6
    # The dark direction is the true start (−5 km, 1 km, at rest, 0.04 m/s²) with its constant; null to rounding.
    truth = np.array([-5e3, 1e3, 0.0, 0.0, 0.04, 0.0, SOUND])
    ratio = first_half.weakest[:, 0] / scale / first_half.weakest[6, 0]
    np.testing.assert_allclose(ratio, truth / scale / SOUND, atol=1e-6)  # the constant is seen through 2/3 s in 1000 s


def nearly(spread: np.ndarray) -> bool:
    """Whether any record lies between blind and seeing, where the answer is a matter of digits and not of algebra."""
    return bool(((spread > 1e-10) & (spread < 0.02)).any())


def spread_of(directions: np.ndarray) -> np.ndarray:
    """How far lines ``(K, N)`` turn away from the first, ``sin`` of the angle."""
    return np.abs(np.sin(directions - directions[0])).max(axis=0)


@given(SEEDS, st.floats(0.5, 4.0))
def test_constant_acceleration_is_observable_iff_the_line_of_sight_turns(seed: int, period: float) -> None:
    rng = np.random.default_rng(seed)
    time = period * np.arange(60)[:, None, None]
    position, velocity, acceleration = (rng.uniform(-size, size, (2, 5)) for size in (2e4, 300.0, 3.0))
    free = position + velocity * time + 0.5 * acceleration * time**2
    toward = direction(rng.uniform(-np.pi, np.pi, 5))
    radial = toward * (free[:, :1] + 0.1)
    resting = np.broadcast_to(position, free.shape)
    positions = np.concatenate([free, radial, resting], axis=-1)
    bearings = seen_from(ORIGIN, positions)
    assume(not nearly(spread_of(bearings[:, 0])))

    predicted = observability.constant_acceleration_observable(bearings[:, 0])
    known = report(bearings, ORIGIN, ConstantVelocity(), PLANAR, period, LIGHT)
    np.testing.assert_array_equal(predicted, known.rank == 5)
    unknown = report(bearings, ORIGIN, ConstantAcceleration(), ACCELERATED, period, LIGHT)
    np.testing.assert_array_equal(predicted, unknown.rank == 7)
    assert not predicted[5:].any()
    assert predicted[:5].all()


@given(SEEDS, st.sampled_from([-1.0, 1.0]), st.floats(0.01, 0.1), st.floats(0.5, 4.0))
def test_coordinated_turn_is_observable_iff_it_does_not_circle_the_station(
    seed: int, side: float, rate: float, period: float
) -> None:
    rng = np.random.default_rng(seed)
    rate = side * rate
    motion = CoordinatedTurn(turn_rate=rate)
    position, velocity = rng.uniform(-2e4, 2e4, (2, 5)), rng.uniform(-300.0, 300.0, (2, 5))
    circling = rate * np.stack([position[1], -position[0]])
    start = np.concatenate([np.tile(position, 3), np.hstack([velocity, circling, 0.0 * velocity])])
    bearings = seen_from(ORIGIN, track(motion, PLANAR, start, period, 60))
    time = period * np.arange(60)[:, None]
    assume(not nearly(np.minimum(spread_of(bearings[:, 0]), spread_of(bearings[:, 0] - rate * time))))

    predicted = observability.coordinated_turn_observable(bearings[:, 0], rate, period)
    np.testing.assert_array_equal(predicted, report(bearings, ORIGIN, motion, PLANAR, period, LIGHT).rank == 5)
    np.testing.assert_array_equal(predicted, np.repeat([True, False, False], 5))


@given(SEEDS, st.floats(0.5, 4.0))
def test_two_arrays_see_everything_iff_the_emitter_ever_leaves_the_baseline(seed: int, period: float) -> None:
    rng = np.random.default_rng(seed)
    stations = rng.uniform(-5e3, 5e3, (2, 2))
    baseline = (stations[1] - stations[0])[:, None]
    assume(np.linalg.norm(baseline) > 1e3)
    time = period * np.arange(60)[:, None, None]
    position, velocity, acceleration = (rng.uniform(-size, size, (2, 5)) for size in (1e4, 50.0, 1.0))
    free = position + velocity * time + 0.5 * acceleration * time**2
    on_baseline = stations[0][:, None] + baseline * (free[:, :1] / 5e3)
    along = np.moveaxis(on_baseline, 1, 0) + 500.0 * direction(bearing_of(baseline) + 0.5 * np.pi)[:, None]
    bearings = seen_from(stations, np.concatenate([free, on_baseline, np.moveaxis(along, 0, 1)], axis=-1))
    assume(not nearly(np.abs(np.sin(bearings[:, 0] - bearings[:, 1])).max(axis=0)))

    predicted = observability.dual_array_observable(bearings[:, 0], bearings[:, 1])
    motion = ConstantAcceleration()
    np.testing.assert_array_equal(predicted, report(bearings, stations, motion, ACCELERATED, period, SOUND).rank == 7)
    assert not predicted[5:10].any()
    # Frequency is not needed: the two bearing rows see all six states by themselves, the constant being known.
    rows = observability.augmented_pseudo_linear_rows(
        bearings, stations, ACCELERATED, propagation_speed=SOUND, duration=1.0, frequency_stations=()
    )[:, :, :6]
    scale = observability.record_scale(ACCELERATED, 59 * period)
    alone = observability.rank_report(rows, motion.transition(ACCELERATED, period), ACCELERATED, scale)
    np.testing.assert_array_equal(predicted, alone.rank == 6)


def test_crossing_the_baseline_is_not_staying_on_it() -> None:
    north = np.linspace(-100.0, 100.0, 5)
    positions = np.stack([np.full(5, 3e3), north], axis=1)[..., None]
    bearings = seen_from(ARRAYS, positions)
    assert observability.dual_array_observable(bearings[:, 0], bearings[:, 1])
    assert not observability.dual_array_observable(*np.repeat(bearings[2:3], 5, axis=0).swapaxes(0, 1))


def test_corollaries_tell_the_cases_of_paper_000_apart() -> None:
    seen = {name: case(name)[1][:, 0] for name in CASES}
    assert observability.constant_acceleration_observable(seen["1a"])
    assert not observability.constant_acceleration_observable(seen["1b"])
    assert observability.coordinated_turn_observable(seen["2a"], -3.0 * DEGREE, 1.0)
    assert observability.coordinated_turn_observable(seen["2b"], -0.5 * DEGREE, 1.0)
    circle = seen["a true circle"]
    assert not observability.coordinated_turn_observable(circle, -0.5 * DEGREE, 1.0)
    # Case 2b strays from a circle by 3.6 mrad in 300 s, hardly more than the paper's sensor errs in one bearing.
    assert not observability.coordinated_turn_observable(seen["2b"], -0.5 * DEGREE, 1.0, tolerance=3.6e-3)
    assert observability.coordinated_turn_observable(seen["2b"], -0.5 * DEGREE, 1.0, tolerance=3.5e-3)


BEARINGS = np.array([[0.1, 0.2], [0.2, 0.3], [0.3, 0.5], [0.4, 0.7], [0.5, 0.9]])
SPOILT = np.where(BEARINGS == 0.3, np.nan, BEARINGS)


def augmented(**changes: object) -> np.ndarray:
    arguments: dict[str, object] = {
        "bearings": BEARINGS[:, None],
        "stations": ORIGIN,
        "layout": PLANAR,
        "propagation_speed": LIGHT,
        "duration": 3.0,
    }
    return observability.augmented_pseudo_linear_rows(**(arguments | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: augmented(duration=0.0), "duration = 0.0 is not possible: must be finite and above 0"),
        (lambda: augmented(propagation_speed=np.inf), "propagation_speed = inf is not possible"),
        (lambda: augmented(bearings=SPOILT[:, None]), "bearings = nan is not possible: must be finite"),
        (lambda: augmented(bearings=BEARINGS), r"bearings of shape \(5, 2\) is not possible: must be instants, stat"),
        (lambda: augmented(stations=ARRAYS), r"stations of shape \(2, 2\) is not possible: must be \(1, 2\)"),
        (lambda: augmented(stations=ORIGIN + np.nan), "stations = nan is not possible: must be finite"),
        (lambda: augmented(frequency_stations=(1,)), "frequency_stations = 1 is not possible: must be between 0 and 0"),
        (lambda: observability.record_scale(PLANAR, np.nan), "duration = nan is not possible"),
        (lambda: observability.constant_acceleration_observable(SPOILT), "bearings = nan is not possible"),
        (lambda: observability.constant_acceleration_observable(BEARINGS[0]), r"bearings of shape \(2,\)"),
        (lambda: observability.coordinated_turn_observable(BEARINGS, 0.1, 0.0), "period = 0.0 is not possible"),
        (lambda: observability.coordinated_turn_observable(BEARINGS, np.inf, 1.0), "turn_rate = inf is not possible"),
        (lambda: observability.dual_array_observable(BEARINGS, SPOILT), "second = nan is not possible"),
        (lambda: observability.dual_array_observable(BEARINGS, BEARINGS[:, :1]), r"must be \(5, 2\), as the first"),
        (lambda: observability.dual_array_observable([[0.1], [0.2]], BEARINGS), "first of 2 instants is not possible"),
        (
            lambda: observability.constant_acceleration_observable(BEARINGS[:4]),
            "4 instants is not possible: must be at",
        ),
        (lambda: observability.coordinated_turn_observable(BEARINGS[:4], 0.1, 1.0), "bearings of 4 instants is not"),
        (lambda: observability.coordinated_turn_observable(BEARINGS, np.zeros(3), 1.0), r"turn_rate of shape \(3,\)"),
        (lambda: observability.coordinated_turn_observable(BEARINGS, BEARINGS, 1.0), r"turn_rate of shape \(5, 2\)"),
        (
            lambda: observability.coordinated_turn_observable(BEARINGS, 0.1, np.ones(2)),
            r"period = \[1. 1.\] is not poss",
        ),
        (lambda: observability.constant_acceleration_observable([["a"] * 2] * 5), "bearings = .* must be real numbers"),
        (lambda: observability.constant_acceleration_observable([[1.0], [1.0, 2.0]]), "bearings is not possible: must"),
        (lambda: observability.pseudo_linear_rows(np.zeros(5), PLANAR), r"bearing of shape \(5,\) is not possible"),
        (lambda: observability.pseudo_linear_rows(SPOILT, PLANAR), "bearing = nan is not possible"),
        (lambda: observability.pseudo_linear_rows(BEARINGS, StateLayout(3)), "layout of 3 axes is not possible"),
        (lambda: augmented(layout=StateLayout(3)), "layout of 3 axes is not possible: must be planar"),
        (lambda: augmented(frequency_stations=(0.5,)), "frequency_stations = 0.5 is not possible"),
        (lambda: observability.augmented_transition(np.eye(4)[0]), r"transition of shape \(4,\) is not possible"),
        (lambda: observability.augmented_transition(np.eye(4)[:2]), r"transition of shape \(2, 4, 1\) is not possible"),
    ],
)
def test_bad_input_is_refused_in_one_line(call: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_lists_are_as_good_as_arrays() -> None:
    rows = augmented(bearings=BEARINGS[:, None].tolist(), stations=[[0, 0]])
    np.testing.assert_array_equal(rows, augmented())
    lists = BEARINGS.tolist()
    assert observability.dual_array_observable(lists, (0.5 * BEARINGS).tolist()).all()
    np.testing.assert_array_equal(
        observability.pseudo_linear_rows(lists, PLANAR), observability.pseudo_linear_rows(BEARINGS, PLANAR)
    )


def test_results_do_not_depend_on_the_batch(assert_batch_free: Callable[..., None]) -> None:
    bearings = np.random.default_rng(0).uniform(-3.0, 3.0, (9, 2, 50))
    assert_batch_free(lambda angles: augmented(bearings=angles, stations=ARRAYS), bearings)
    assert_batch_free(lambda a: observability.dual_array_observable(a[:, 0], a[:, 1], tolerance=1.5), bearings)
    assert_batch_free(lambda a: observability.constant_acceleration_observable(a[:, 0], tolerance=1.5), bearings)
    assert_batch_free(lambda a: observability.coordinated_turn_observable(a[:, 0], 0.1, 1.0, tolerance=1.5), bearings)
