"""What the closest point to rays is made of; that it is the closest is tested with the cross fixes."""

import math

import numpy as np
import pytest

from passloc_env.tracking import rays
from passloc_env.tracking.cross_fix import positive_range_fix
from passloc_env.tracking.rays import Rays, Symmetric, crossing


def scene(seed: int, count: int, size: int) -> Rays:
    """Rays from anywhere to anywhere, and a pull."""
    rng = np.random.default_rng(seed)
    stations = rng.normal(size=(2, count, size))
    stations -= stations.mean(axis=1, keepdims=True)
    bearings = rng.uniform(-math.pi, math.pi, (count, size))
    return Rays.from_stations(stations, bearings, rng.normal(size=(2, size)), rng.uniform(0.0, 1.0, size))


@pytest.mark.parametrize("rank", [1, 2])
def test_solve_is_the_pseudo_inverse(rank: int) -> None:
    """Against NumPy's, for condition numbers to about 1e4: 1e-10 is far above their rounding."""
    rng = np.random.default_rng(rank)
    root = rng.normal(size=(500, 2, rank))
    matrix, right = root @ root.swapaxes(1, 2), rng.normal(size=(2, 500))
    found = Symmetric(matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 1])
    good = found.regular if rank == 2 else ~found.regular
    assert good.mean() > 0.99
    expected = np.einsum("nij,jn->in", np.linalg.pinv(matrix, rcond=1e-10), right)
    error = np.abs(found.solve(right) - expected) / (1.0 + np.abs(expected))
    assert np.median(error) < 1e-14
    assert error[:, found.determinant > 1e-3 * np.square(found.xx + found.yy) if rank == 2 else good].max() < 1e-10
    np.testing.assert_array_equal(found.full(), np.moveaxis(matrix, 0, -1))


def test_slope_and_normal_are_derivatives_of_the_cost() -> None:
    """Central differences of a piecewise quadratic, away from its seams, err by rounding over the step: 1e-9."""
    problem, h = scene(0, 4, 300), 1e-6
    point = np.random.default_rng(1).normal(size=(2, 300))
    seen = problem.seen(point)
    behind = seen.along <= 0.0
    slope, normal = problem.slope(point, seen, behind), problem.normal(behind).full()
    smooth = np.abs(seen.along).min(axis=0) > 10.0 * h
    assert smooth.mean() > 0.95
    for axis in range(2):
        ends = [point + sign * h * np.eye(2)[axis, :, None] for sign in (1.0, -1.0)]
        costs = [problem.cost(end, problem.seen(end)) for end in ends]
        slopes = [problem.slope(end, problem.seen(end), behind) for end in ends]
        np.testing.assert_allclose(((costs[0] - costs[1]) / (4.0 * h) - slope[axis])[smooth], 0.0, atol=1e-8)
        np.testing.assert_allclose((slopes[0] - slopes[1]) / (2.0 * h), normal[axis], atol=1e-8)


@pytest.mark.parametrize("count", [1, 3, 8])
def test_lowest_point_of_a_step(count: int) -> None:
    """No point of a fine division of the step has a lower cost; steps twice as long as Newton's need cutting."""
    problem = scene(count, count, 400)
    start = np.random.default_rng(2).normal(size=(2, 400))
    seen = problem.seen(start)
    behind = seen.along <= 0.0
    step = 2.0 * problem.normal(behind).solve(problem.slope(start, seen, behind))
    found = rays._lowest(problem, start, step)
    lowest = problem.cost(found, problem.seen(found))
    for share in np.linspace(0.0, 1.0, 201):
        point = start - share * step
        assert (lowest <= problem.cost(point, problem.seen(point)) + 1e-12).all()
    along = ((start - found) * step).sum(axis=0) / np.square(step).sum(axis=0)
    np.testing.assert_allclose(found, start - along * step, atol=1e-12)
    assert ((along >= 0.0) & (along <= 1.0 + 1e-12)).all()
    assert (along < 1.0).mean() > 0.9


def test_lines_parallel_but_for_rounding_cross_at_the_foot_of_the_centroid() -> None:
    """Within a microradian lines count as parallel: the point of least norm, to the square of their angle."""
    stations = np.array([[[1.0], [2.0], [-3.0]], [[5.0], [-4.0], [-1.0]]])
    bearings = 0.6 + np.array([[0.0], [7e-7], [-7e-7]])
    free = np.zeros((2, 1)), np.zeros(1)
    found = crossing(Rays.from_stations(stations, bearings, *free))
    normals = np.column_stack([np.cos(bearings[:, 0]), -np.sin(bearings[:, 0])])
    offsets = (normals * stations[..., 0].T).sum(axis=1)
    expected = np.linalg.lstsq(normals, offsets, rcond=1e-3)[0]
    assert np.hypot(*expected) > 1e-8
    np.testing.assert_allclose(found[:, 0], expected, atol=1e-11)


@pytest.mark.parametrize("weight", [1e-300, 1e-30, 1e-15, 1e-13, 1e-6, 1.0])
@pytest.mark.parametrize("bearing", [0.0, 0.7, -2.1])
def test_however_weak_a_pull_chooses_among_parallel_rays(weight: float, bearing: float) -> None:
    """Two parallel rays say nothing of how far; the point abreast of the pull's centre is the only minimum.

    Across the rays, at −1 and 1 beside a centre at 5, the minimum lies at ``5 w/(2 + w)``.
    """
    ahead = np.array([[np.sin(bearing)], [np.cos(bearing)]])
    aside = np.array([[np.cos(bearing)], [-np.sin(bearing)]])
    stations = np.stack([-aside, aside], axis=1)
    centre = 40.0 * ahead + 5.0 * aside
    fix = positive_range_fix(stations, np.full((2, 1), bearing), (centre, np.array([weight])))
    expected = 40.0 * ahead + 5.0 * weight / (2.0 + weight) * aside
    np.testing.assert_allclose(fix.position, expected, atol=1e-12)
    assert fix.active.all()


@pytest.mark.parametrize("weight", [1e6, 1e155, 1e300])
def test_however_strong_a_pull_the_fix_is_a_number(weight: float) -> None:
    """It is the centre, but for the rays' share ``1/w``; a determinant of 1e310 would be none."""
    stations, bearings = np.array([[[0.0], [1.0]], [[0.0], [0.0]]]), np.array([[0.3], [-0.3]])
    centre = np.array([[4.0], [3.0]])
    fix = positive_range_fix(stations, bearings, (centre, np.array([weight])))
    np.testing.assert_allclose(fix.position, centre, atol=20.0 / weight + 1e-14)
    assert np.isfinite(fix.residual).all()
