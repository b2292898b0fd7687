"""Cross fixes against SciPy, brute force and grids; and where geometry says nothing.

Bearings err by up to ±45°, as in the paper, unless said otherwise. Fixes that two exact methods find differ by
rounding times the condition of nearly parallel lines: 1e-9 of the distances involved leaves room for both.
"""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import nnls

from passloc_env.angles import bearing_of, direction, turned, wrap
from passloc_env.errors import InputError
from passloc_env.tracking import cross_fix
from passloc_env.tracking.cross_fix import (
    determined,
    least_squares,
    maximum_likelihood,
    positive_range_fix,
    positive_range_least_squares,
    tangent_least_squares,
)

ESTIMATORS = [tangent_least_squares, least_squares, positive_range_least_squares, maximum_likelihood]
SEEDS = st.integers(0, 2**32 - 1)
WIDE = math.pi / 4

Problem = tuple[np.ndarray, np.ndarray]


def problem(seed: int, count: int, size: int, noise: float = WIDE) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stations, bearings and targets in the unit square; errors uniform within ± noise."""
    rng = np.random.default_rng(seed)
    stations, target = rng.uniform(size=(2, count, size)), rng.uniform(size=(2, size))
    bearings = bearing_of(target[:, None] - stations) + rng.uniform(-noise, noise, (count, size))
    return stations, bearings, target


def anywhere(seed: int, count: int, size: int) -> Problem:
    """Bearings that know of no target."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(2, count, size)), rng.uniform(-math.pi, math.pi, (count, size))


def on_a_lattice(seed: int, count: int, size: int) -> Problem:
    """Full of ties, parallel lines and stations in one place: whole coordinates, bearings in steps of 45°."""
    rng = np.random.default_rng(seed)
    return rng.integers(-2, 3, (2, count, size)).astype(float), rng.integers(-4, 5, (count, size)) * (math.pi / 4)


def squared_distances(stations: np.ndarray, bearings: np.ndarray, point: np.ndarray) -> np.ndarray:
    """To the rays, ``(M, N)``: from the point to the closest of the points ``p + r u`` with ``r ≥ 0``."""
    offset, u = point[:, None] - stations, direction(bearings)
    foot = np.maximum((offset * u).sum(axis=0), 0.0) * u
    return np.square(offset - foot).sum(axis=0)


def squared_residuals(stations: np.ndarray, bearings: np.ndarray, point: np.ndarray) -> np.ndarray:
    """What maximum likelihood minimises, ``(N,)``."""
    return np.square(wrap(bearings - bearing_of(point[:, None] - stations))).sum(axis=0)


def assert_close(found: np.ndarray, expected: np.ndarray, tolerance: float = 1e-9) -> None:
    """Points within a share of their distance from the origin, or of one."""
    error = np.hypot(*(found - expected)) / (1.0 + np.hypot(*expected))
    assert error.max() < tolerance


def by_nnls(stations: np.ndarray, bearings: np.ndarray, pull: tuple[np.ndarray, float] | None = None) -> np.ndarray:
    """Eq. 12 of one column as it stands, by SciPy: the point ``(2,)`` as a difference of two non-negative ones."""
    count = len(bearings)
    u = direction(bearings)
    matrix, right = np.zeros((2 * count + 2, 4 + count)), np.zeros(2 * count + 2)
    for k in range(count):
        block = slice(2 * k, 2 * k + 2)
        matrix[block, :4] = np.hstack([np.eye(2), -np.eye(2)])
        matrix[block, 4 + k] = -u[:, k]
        right[block] = stations[:, k]
    if pull is not None:
        matrix[-2:, :4] = math.sqrt(pull[1]) * np.hstack([np.eye(2), -np.eye(2)])
        right[-2:] = math.sqrt(pull[1]) * pull[0]
    solution = nnls(matrix, right)[0]
    return solution[:2] - solution[2:4]


def by_brute_force(stations: np.ndarray, bearings: np.ndarray) -> np.ndarray:
    """Least sum of squared distances ``(N,)`` over the solutions of all ``2^M`` sets of rays taken as lines."""
    u = np.moveaxis(direction(bearings), -1, 0)
    along = u[:, :, None] * u[:, None]
    places = np.moveaxis(stations, -1, 0)
    least = np.full(len(u), np.inf)
    for lines in itertools.product((0.0, 1.0), repeat=len(bearings)):
        projections = np.eye(2)[..., None] - np.array(lines) * along
        right = np.einsum("nijk,njk->ni", projections, places)
        point = np.einsum("nij,nj->in", np.linalg.pinv(projections.sum(axis=-1), rcond=1e-10), right)
        least = np.minimum(least, squared_distances(stations, bearings, point).sum(axis=0))
    return least


@pytest.mark.parametrize("draw", [lambda *size: problem(*size)[:2], anywhere], ids=["square", "anywhere"])
@pytest.mark.parametrize("count", range(2, 9))
def test_positive_ranges_are_non_negative_least_squares(count: int, draw: Callable[..., Problem]) -> None:
    stations, bearings = draw(count, count, 200)
    expected = np.array([by_nnls(stations[..., i], bearings[:, i]) for i in range(200)]).T
    assert_close(positive_range_least_squares(stations, bearings), expected)


@pytest.mark.parametrize("draw", [lambda *size: problem(*size)[:2], anywhere, on_a_lattice])
@pytest.mark.parametrize("count", range(2, 7))
def test_no_set_of_rays_does_better(count: int, draw: Callable[..., Problem]) -> None:
    """Also where many points are best: there costs are compared, to rounding."""
    stations, bearings = draw(10 + count, count, 2000)
    fix = positive_range_fix(stations, bearings)
    np.testing.assert_allclose(fix.residual, by_brute_force(stations, bearings), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("seed", [4, 26, 42, 46, 63, 64, 86, 87])
def test_full_steps_going_in_circles(seed: int) -> None:
    """Each of these has columns in which the unguarded iteration never ends."""
    rng = np.random.default_rng(seed)
    stations, bearings = rng.normal(size=(2, 3, 2000)), rng.integers(0, 8, (3, 2000)) * np.pi / 4
    fix = positive_range_fix(stations, bearings)
    np.testing.assert_allclose(fix.residual, by_brute_force(stations, bearings), rtol=1e-9, atol=1e-12)


@given(SEEDS, st.integers(1, 6), st.booleans())
def test_fix_is_what_it_says(seed: int, count: int, pulled: bool) -> None:
    """Residual, information and active set follow from the position; tolerances are rounding."""
    stations, bearings = anywhere(seed, count + 1, 20)
    rng = np.random.default_rng(seed)
    centre, weight = rng.normal(size=(2, 20)), rng.uniform(0.1, 3.0, 20) * pulled
    fix = positive_range_fix(stations, bearings, (centre, weight) if pulled else None)
    offset, u = fix.position[:, None] - stations, direction(bearings)
    along = (u * offset).sum(axis=0)
    assert (fix.active == (along > 0.0))[np.abs(along) > 1e-9].all()
    distances = squared_distances(stations, bearings, fix.position).sum(axis=0)
    expected = distances + weight * np.square(fix.position - centre).sum(axis=0)
    np.testing.assert_allclose(fix.residual, expected, rtol=1e-9, atol=1e-12)
    information = np.eye(2)[..., None] * (count + 1 + weight) - (u[:, None] * u[None] * fix.active).sum(axis=2)
    np.testing.assert_allclose(fix.information, information, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_pull(count: int) -> None:
    stations, bearings = anywhere(count, count, 100)
    centre, weight = np.random.default_rng(0).normal(size=(2, 100)), np.geomspace(1e-3, 1e3, 100)
    columns = range(100)
    expected = [by_nnls(stations[..., i], bearings[:, i], (centre[:, i], weight[i])) for i in columns]
    assert_close(positive_range_fix(stations, bearings, (centre, weight)).position, np.array(expected).T)


def test_pull_without_weight_and_with_all_of_it() -> None:
    stations, bearings, target = problem(0, 3, 200)
    free = positive_range_fix(stations, bearings, (target, np.zeros(200))).position
    np.testing.assert_array_equal(free, positive_range_least_squares(stations, bearings))
    # Rays of weight one against 1e12 move it by no more than their distance over that.
    assert_close(positive_range_fix(stations, bearings, (target, np.full(200, 1e12))).position, target, 1e-11)


def test_likelihood_is_flat_at_its_maximum() -> None:
    """Where the fix is neither a station nor far out, which is so in most columns, the gradient is zero.

    The climb ends with a step below 1e-9 rad. Central differences over 1e-5 of the range err by about 1e-9 rad.
    """
    stations, bearings, _ = problem(1, 3, 2000)
    fix = maximum_likelihood(stations, bearings)
    size = np.sqrt(stations.var(axis=1).sum(axis=0))
    closest = np.hypot(*(fix[:, None] - stations)).min(axis=0)
    inside = (closest > 1e-3 * size) & (closest < 500.0 * size)
    assert inside.mean() > 0.7
    h = 1e-5 * closest
    for axis in np.eye(2)[..., None]:
        ends = [squared_residuals(stations, bearings, fix + sign * h * axis) for sign in (1.0, -1.0)]
        assert np.abs((ends[0] - ends[1]) / 2e-5)[inside].max() < 1e-6


@pytest.mark.parametrize(("noise", "count"), [(WIDE, 3), (WIDE, 6), (0.1, 2), (0.1, 4)])
def test_no_likelihood_of_a_grid_is_larger(noise: float, count: int) -> None:
    """Nor of points close around the stations, where it jumps. At a station the limit counts: that is ours to take."""
    stations, bearings, _ = problem(2, count, 60, noise)
    fix = maximum_likelihood(stations, bearings)
    ours = squared_residuals(stations, bearings, fix)
    at_station = np.abs(fix[:, None] - stations).max(axis=0) < 1e-9
    beside = squared_residuals(stations, bearings, fix + 1e-7 * direction((bearings * at_station).sum(axis=0)))
    ours = np.where(at_station.any(axis=0), beside, ours)
    line = np.linspace(-1.0, 2.0, 150)
    x, y = np.meshgrid(line, line)
    around = np.linspace(-math.pi, math.pi, 181)
    for i in range(60):
        near = (stations[..., i, None] + 1e-3 * direction(around)[:, None]).reshape(2, -1)
        grid = np.hstack([np.stack([x.ravel(), y.ravel()]), near])
        # Going 1e-7 away from a station costs 1e-6 at most, as any bearing changes by that over ranges above 0.1.
        assert ours[i] <= squared_residuals(stations[..., i, None], bearings[:, i, None], grid).min() + 1e-5


def test_likelihood_without_a_maximum() -> None:
    """Diverging bearings: the fix goes far out, in the mean direction."""
    stations = np.array([[[-1.0], [1.0]], [[0.0], [0.0]]])
    far = maximum_likelihood(stations, np.array([[-0.2], [0.4]]))
    np.testing.assert_allclose(far, 1e3 * direction(np.array([0.1])), rtol=1e-12)
    # So it is where they meet, but 10 000 times as far away as the stations are.
    far = maximum_likelihood(stations, np.array([[1e-4], [-1e-4]]))
    np.testing.assert_allclose(far, [[0.0], [1e3]], rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("function", ESTIMATORS)
@pytest.mark.parametrize("count", [2, 3, 6])
def test_exact_bearings_give_the_target(function: Callable[..., np.ndarray], count: int) -> None:
    """To rounding times the condition: two sight lines of these meet at a thousandth of a radian."""
    stations, bearings, target = problem(3, count, 500, noise=0.0)
    assert_close(function(stations, bearings), target)


@pytest.mark.parametrize("function", [*ESTIMATORS, determined, lambda *given: positive_range_fix(*given).information])
@pytest.mark.parametrize("draw", [lambda *size: problem(*size)[:2], on_a_lattice], ids=["square", "lattice"])
def test_batch_size_changes_no_bit(
    function: Callable[..., np.ndarray], draw: Callable[..., Problem], assert_batch_free: Callable[..., None]
) -> None:
    assert_batch_free(function, *draw(4, 3, 300))
    for seed in range(5, 10):
        assert_batch_free(function, *draw(seed, 20, 40))


@pytest.mark.parametrize("angle", [-3.0, -math.pi / 2, 0.7, math.pi - 0.01, math.pi])
@pytest.mark.parametrize("function", ESTIMATORS[1:])
def test_turning_the_world_turns_the_fix(function: Callable[..., np.ndarray], angle: float) -> None:
    """With bearings wrapped, so that some pass the branch cut; and slopes do care (see below).

    A climb ends within 1e-9 rad of its minimum; where sight lines nearly agree that is 1e-6 of the distance.
    """
    stations, bearings, _ = problem(6, 3, 500)
    sine, cosine = math.sin(angle), math.cos(angle)
    rotated = function(turned(stations, sine, cosine), wrap(bearings + angle))
    assert_close(rotated, turned(function(stations, bearings), sine, cosine), 1e-6)


def test_slopes_depend_on_where_north_is() -> None:
    stations, bearings, _ = problem(6, 3, 500)
    fix = tangent_least_squares(stations, bearings)
    rotated = tangent_least_squares(turned(stations, 1.0, 0.0), bearings + math.pi / 2)
    assert np.median(np.hypot(*(rotated - turned(fix, 1.0, 0.0)))) > 0.05


@pytest.mark.parametrize("function", ESTIMATORS)
def test_moving_and_scaling_the_world(function: Callable[..., np.ndarray]) -> None:
    """Coordinates of 1e6 carry their places to 1e-10, and likelihoods end as above: 1e-6 of the distance."""
    stations, bearings, _ = problem(7, 4, 500, noise=0.3)
    fix = function(stations, bearings)
    assert_close(function(1e3 * stations, bearings) / 1e3, fix, 1e-6)
    assert_close(function(stations + 1e6, bearings) - 1e6, fix, 1e-6)


PARALLEL = {
    "same way": ([0.0, 0.0, 0.0], [-1.0, 4.0, 0.0], 4.0),
    "towards each other": ([0.0, math.pi, 0.0], [-3.0, 5.0, -2.0], 0.0),
    "the gap off the centroid": ([0.0, math.pi, math.pi], [1.0, 2.0, 6.0], 2.0),
    "away from each other": ([math.pi, 0.0, 0.0], [-3.0, 1.0, 2.0], 0.0),
}
"""Bearings, stations along the common line, and where along it the positive-range fix must be.

Abreast of the foremost station; at the centroid, which all have ahead; as close to the centroid as the gap between two
stations allows; and where rays point away from each other and no place is ahead of all, at the best compromise: behind
all three at 0, the mean of −3, 1 and 2.
"""


@pytest.mark.parametrize("case", PARALLEL)
@pytest.mark.parametrize("turn", [0.0, 0.3, math.pi / 2, 2.5, math.pi])
def test_parallel_bearings(case: str, turn: float) -> None:
    """Never NaN, flagged, and the best point closest to the centroid; to rounding."""
    bearings, along, expected = PARALLEL[case]
    across = np.array([1.0, -3.0, 2.0])
    u, n = direction(np.array(turn)), direction(np.array(turn + math.pi / 2))
    stations = (u[:, None] * along + n[:, None] * across)[..., None]
    given = np.array(bearings)[:, None] + turn
    assert not determined(stations, given).any()
    centroid = stations.mean(axis=1)
    for function in (tangent_least_squares, least_squares):
        np.testing.assert_allclose(function(stations, given), centroid, atol=1e-12)
    for function in (positive_range_least_squares, maximum_likelihood):
        np.testing.assert_allclose(function(stations, given), expected * u[:, None], atol=1e-12)


@pytest.mark.parametrize("place", [0.0, 0.1, 1e6 / 3.0])
@pytest.mark.parametrize("bearings", [[0.3, 0.3, 0.3], [0.1, 2.0, -1.0], [0.0, math.pi, 0.0]])
def test_stations_in_one_place(place: float, bearings: list[float]) -> None:
    """That place, and not determined; the mean of three equal numbers may be off by a bit."""
    stations, given = np.full((2, 3, 1), place), np.array(bearings)[:, None]
    assert not determined(stations, given).any()
    for function in ESTIMATORS:
        np.testing.assert_allclose(function(stations, given), place, rtol=1e-15, atol=1e-15)


@pytest.mark.parametrize("function", ESTIMATORS)
@pytest.mark.parametrize("draw", [on_a_lattice, lambda *size: problem(*size, noise=1e-7)[:2]])
def test_never_nan(function: Callable[..., np.ndarray], draw: Callable[..., Problem]) -> None:
    for count in (2, 3, 5):
        assert np.isfinite(function(*draw(8, count, 5000))).all()


def test_determined() -> None:
    """Lines a microradian apart are parallel, whichever way they point; twice ten times that they are not."""
    stations = np.array([[[0.0], [1.0]], [[0.0], [0.0]]])
    for spread, expected in ((0.0, False), (1e-6, False), (1e-5, True), (math.pi + 1e-6, False), (1.0, True)):
        assert determined(stations, np.array([[0.4], [0.4 + spread]])) == expected
    assert not determined(stations[:, :1], np.array([[0.4]])).any()
    assert determined(*problem(0, 3, 1000)[:2]).all()


def test_nearly_parallel_lines_keep_their_digits() -> None:
    """At 1e-5 rad the normal equations alone would keep six digits; 1e-9 shows that the second step works."""
    stations = np.array([[[-1.0], [1.0]], [[0.0], [0.0]]])
    angle = 1e-5
    bearings = np.array([[0.7 + angle], [0.7 - angle]])
    # The crossing of two lines, by hand: ranges from the law of sines.
    distance = 2.0 * math.sin(math.pi / 2 + 0.7 - angle) / math.sin(2.0 * angle)
    expected = stations[:, 0] + distance * direction(bearings[0])
    for function in (least_squares, positive_range_least_squares):
        assert_close(function(stations, bearings), expected)


@pytest.mark.parametrize("north", [0.0, -0.0, math.pi, -math.pi])
def test_slope_along_north(north: float) -> None:
    """A finite fix, within 1e-6 of the crossing for two stations, and the same for north and south."""
    stations = np.array([[[0.5], [-1.0]], [[2.0], [0.0]]])
    fix = tangent_least_squares(stations, np.array([[north], [math.pi / 4]]))
    assert_close(fix, np.array([[0.5], [1.5]]), 2e-6)
    # Steeper than any slope, and parallel: slopes that differ must not make them cross.
    almost = tangent_least_squares(stations, np.array([[north], [north + 1.5e-6]]))
    np.testing.assert_allclose(almost, [[-0.25], [1.0]], rtol=1e-12)
    three = np.array([[[0.5], [-1.0], [0.0]], [[2.0], [0.0], [1.0]]])
    reference = tangent_least_squares(three, np.array([[0.0], [0.0], [1.0]]))
    assert np.isfinite(reference).all()
    np.testing.assert_array_equal(tangent_least_squares(three, np.array([[0.0], [north], [1.0]])), reference)


def test_no_columns() -> None:
    for function in ESTIMATORS:
        assert function(np.zeros((2, 3, 0)), np.zeros((3, 0))).shape == (2, 0)


STATIONS, BEARINGS = np.arange(6.0).reshape(2, 3, 1), np.zeros((3, 1))
RAGGED = "bearings is not possible: must be numbers in rows of equal length"
BAD = {
    "three rows": (
        np.zeros((3, 3, 1)),
        BEARINGS,
        "stations of shape (3, 3, 1) is not possible: must be (2, M, N) with M ≥ 2",
    ),
    "no batch": (np.zeros((2, 3)), BEARINGS, "stations of shape (2, 3) is not possible: must be (2, M, N) with M ≥ 2"),
    "one station": (
        np.zeros((2, 1, 4)),
        np.zeros((1, 4)),
        "stations of shape (2, 1, 4) is not possible: must be (2, M, N) with M ≥ 2",
    ),
    "a bearing missing": (STATIONS, BEARINGS[:2], "bearings of shape (2, 1) is not possible: must be (3, 1)"),
    "a place unknown": (STATIONS * np.nan, BEARINGS, "stations = nan is not possible: must be finite"),
    "places in words": ("here", BEARINGS, "stations = 'here' is not possible: must be real numbers"),
    "ragged bearings": (
        STATIONS,
        [[0.0], [0.0, 1.0]],
        RAGGED,
    ),
    "no bearing": (STATIONS, BEARINGS + np.inf, "bearings = inf is not possible: must be finite"),
}


@pytest.mark.parametrize("function", [*ESTIMATORS, positive_range_fix, determined])
@pytest.mark.parametrize("case", BAD)
def test_bad_input(function: Callable[..., object], case: str) -> None:
    stations, bearings, message = BAD[case]
    if function is determined and case == "one station":
        assert not determined(stations, bearings).any()
        return
    with pytest.raises(InputError) as caught:
        function(stations, bearings)
    assert str(caught.value).replace("M ≥ 1", "M ≥ 2") == message


@pytest.mark.parametrize(
    ("centre", "weight", "message"),
    [
        (np.zeros((2, 2)), np.ones(1), "the pull's centre of shape (2, 2) is not possible: must be (2, 1)"),
        (np.zeros((2, 1)), np.ones(2), "the pull's weight of shape (2,) is not possible: must be (1,)"),
        (np.zeros((2, 1)), np.array([np.nan]), "the pull's weight = nan is not possible: must be finite"),
        (np.zeros((2, 1)), np.array([-1.0]), "the pull's weight = -1.0 is not possible: must not be negative"),
    ],
)
def test_bad_pull(centre: np.ndarray, weight: np.ndarray, message: str) -> None:
    with pytest.raises(InputError) as caught:
        cross_fix.positive_range_fix(STATIONS, BEARINGS, (centre, weight))
    assert str(caught.value) == message


def test_a_pull_without_a_weight_is_refused() -> None:
    with pytest.raises(InputError, match=r"pull = .* is not possible: must be \(centre, weight\)"):
        positive_range_fix(STATIONS, BEARINGS, (np.zeros((2, 1)),))  # type: ignore[arg-type]
