"""Small-matrix algebra: equal to NumPy's, bit-equal for every batch size, symmetric to the last bit.

Sums and products are tested on whole numbers, where float64 is exact and no tolerance is needed.
"""

from collections.abc import Callable

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st

from passloc_env import linalg

N = 300
SEEDS = st.integers(0, 2**32 - 1)
SIZES = st.integers(1, 7)


def whole_numbers(seed: int, *shape: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(-9, 10, shape).astype(float)


def positive_definite(seed: int, n: int, size: int = 5) -> np.ndarray:
    """Matrices ``(n, n, size)`` of condition numbers to about 1e3: an error of 1e-10 is no rounding."""
    root = np.random.default_rng(seed).normal(size=(size, n, n))
    return np.moveaxis(root @ root.swapaxes(1, 2) + 0.1 * n * np.eye(n), 0, -1).copy()


def batch_first(matrices: np.ndarray) -> np.ndarray:
    return np.moveaxis(matrices, -1, 0)


@given(SEEDS, st.integers(1, 40))
def test_tree_sum(seed: int, count: int) -> None:
    terms = whole_numbers(seed, count, 3)
    np.testing.assert_array_equal(linalg.tree_sum(terms.copy()), terms.sum(axis=0))


@given(SEEDS, SIZES, SIZES, SIZES)
def test_products(seed: int, m: int, k: int, n: int) -> None:
    a, b, x = (whole_numbers(seed + i, *shape) for i, shape in enumerate([(m, k, 2, 5), (k, n, 2, 5), (k, 2, 5)]))
    np.testing.assert_array_equal(linalg.matmul(a, b), np.einsum("mk...,kn...->mn...", a, b))
    np.testing.assert_array_equal(linalg.matvec(a, x), np.einsum("mk...,k...->m...", a, x))
    np.testing.assert_array_equal(linalg.inner(x, b[:, 0]), np.einsum("k...,k...->...", x, b[:, 0]))
    np.testing.assert_array_equal(linalg.row_gram(a), np.einsum("mk...,nk...->mn...", a, a))


@given(SEEDS, SIZES, SIZES)
def test_row_gram_is_symmetric_to_the_last_bit(seed: int, n: int, w: int) -> None:
    gram = linalg.row_gram(np.random.default_rng(seed).normal(size=(n, w, 9)))
    np.testing.assert_array_equal(gram, gram.swapaxes(0, 1))


def test_row_gram_of_no_columns_is_zero() -> None:
    np.testing.assert_array_equal(linalg.row_gram(np.ones((3, 0, 4))), np.zeros((3, 3, 4)))


def test_diagonal_is_a_writable_view() -> None:
    matrix = whole_numbers(0, 3, 3, 4)
    linalg.diagonal(matrix)[...] = 7.0
    np.testing.assert_array_equal(np.einsum("iik->ik", matrix), 7.0)


@given(SEEDS, SIZES)
def test_cholesky_and_its_uses(seed: int, n: int) -> None:
    matrix = positive_definite(seed, n)
    lower, sound = linalg.cholesky(matrix)
    first = batch_first(matrix)
    assert sound
    assert not linalg.unsound(matrix).any()
    np.testing.assert_allclose(batch_first(lower), np.linalg.cholesky(first), rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(linalg.log_determinant(lower), np.linalg.slogdet(first)[1], rtol=1e-10, atol=1e-10)
    inverse = linalg.inverse_from_factor(lower)
    np.testing.assert_allclose(batch_first(inverse), np.linalg.inv(first), rtol=1e-10, atol=1e-10)
    np.testing.assert_array_equal(inverse, inverse.swapaxes(0, 1))


@given(SEEDS, SIZES, SIZES)
def test_solve_lower(seed: int, n: int, k: int) -> None:
    lower = linalg.cholesky(positive_definite(seed, n)).lower
    right = np.random.default_rng(seed).normal(size=(n, k, 5))
    expected = [
        scipy.linalg.solve_triangular(a, b, lower=True)
        for a, b in zip(batch_first(lower), batch_first(right), strict=True)
    ]
    solved = linalg.solve_lower(lower, right)
    assert solved is right
    np.testing.assert_allclose(batch_first(solved), expected, rtol=1e-10, atol=1e-10)


SINGULAR = np.ones((3, 3))
INDEFINITE = np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
NEGATIVE = np.diag([1.0, -1.0, 1.0])


@pytest.mark.parametrize("broken", [SINGULAR, INDEFINITE], ids=["singular", "indefinite"])
def test_cholesky_reports_what_it_cannot_factor(broken: np.ndarray) -> None:
    lower, sound = linalg.cholesky(np.stack([np.eye(3), broken], axis=-1))
    assert not sound
    assert np.isfinite(lower).all()
    np.testing.assert_array_equal(lower[..., 0], np.eye(3))


@given(SEEDS, SIZES)
def test_cholesky_above_is_cholesky_where_its_floors_hold(seed: int, n: int) -> None:
    """Adding R to a positive definite matrix leaves every pivot above R's."""
    noise, matrix = positive_definite(seed, n), positive_definite(seed + 1, n)
    floors = np.square(linalg.diagonal(linalg.cholesky(noise).lower))
    expected = linalg.cholesky(matrix + noise).lower
    found = linalg.cholesky_above(matrix + noise, floors)
    for row in range(n):
        np.testing.assert_allclose(found[row, : row + 1], expected[row, : row + 1], rtol=1e-10, atol=1e-10)


def test_cholesky_above_puts_its_floors_in_the_place_of_rounding() -> None:
    matrix = np.array([[4.0, 2.0], [2.0, 0.5]])[..., None]
    lower = linalg.cholesky_above(matrix, np.array([[1.0], [0.25]]))
    np.testing.assert_array_equal(lower[[0, 1, 1], [0, 0, 1], 0], [2.0, 1.0, 0.5])


@given(SEEDS, st.floats(0.1, 10.0))
def test_cholesky_of_a_multiple(seed: int, scale: float) -> None:
    matrix = positive_definite(seed, 4)
    scaled = linalg.cholesky(matrix, scale)
    assert scaled.sound
    np.testing.assert_allclose(scaled.lower, np.sqrt(scale) * linalg.cholesky(matrix).lower, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("broken", [SINGULAR, INDEFINITE, NEGATIVE, np.full((3, 3), np.nan)])
def test_unsound_points_at_the_broken_one(broken: np.ndarray) -> None:
    batch = positive_definite(3, 3)
    batch[..., 2] = broken
    np.testing.assert_array_equal(linalg.unsound(batch), [False, False, True, False, False])


@given(SEEDS, st.integers(2, 6))
def test_nearest_positive_definite(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-3, 5, n)
    lopsided = rng.normal(size=(n, n))
    matrix = np.diag(scale) @ (np.eye(n) + lopsided + lopsided.T) @ np.diag(scale)
    repaired = linalg.nearest_positive_definite(matrix[..., None])

    assert linalg.cholesky(repaired).sound
    # A product by the scales rounds each half once more, hence not bit for bit.
    np.testing.assert_allclose(repaired, repaired.swapaxes(0, 1), rtol=1e-14)

    unit = np.sqrt(np.abs(np.diag(matrix)))
    values, vectors = np.linalg.eigh(matrix / unit[:, None] / unit)
    raised = (vectors * np.maximum(values, 1e-10 * max(values[-1], 1.0))) @ vectors.T
    np.testing.assert_allclose(
        repaired[..., 0] / unit[:, None] / unit, raised, rtol=1e-9, atol=1e-12 * np.abs(values).max()
    )


@given(SEEDS, st.integers(1, 6))
def test_nearest_positive_definite_leaves_the_sound_alone(seed: int, n: int) -> None:
    matrix = positive_definite(seed, n)
    np.testing.assert_allclose(linalg.nearest_positive_definite(matrix), matrix, rtol=1e-10, atol=1e-10)


def sparse(seed: int, rows: int, columns: int, size: int) -> np.ndarray:
    """Whole-number matrices ``(rows, columns, size)``, half their entries zero, sometimes with a unit diagonal."""
    rng = np.random.default_rng(seed)
    matrix = whole_numbers(seed, rows, columns, size) * (rng.random((rows, columns, 1)) < 0.5)
    if seed % 2:
        linalg.diagonal(matrix[: min(rows, columns), : min(rows, columns)])[...] = 1.0
    return matrix


@given(SEEDS, SIZES, SIZES, st.sampled_from([1, 4]), st.booleans())
def test_linear_map_is_its_matrix(seed: int, rows: int, columns: int, size: int, dense: bool) -> None:
    matrix = sparse(seed, rows, columns, size)
    mapped = linalg.LinearMap(matrix, dense=dense)
    full = np.broadcast_to(matrix, (rows, columns, 4))
    vectors, batches = whole_numbers(seed, columns, 4), whole_numbers(seed, columns, 3, 4)
    np.testing.assert_array_equal(mapped(vectors), np.einsum("ijN,jN->iN", full, vectors))
    np.testing.assert_array_equal(mapped(batches), np.einsum("ijN,jkN->ikN", full, batches))


@given(SEEDS, SIZES, st.sampled_from([1, 4]), st.booleans())
def test_square_maps_work_in_place(seed: int, n: int, size: int, dense: bool) -> None:
    matrix = sparse(seed, n, n, size)
    mapped, full = linalg.LinearMap(matrix, dense=dense), np.broadcast_to(matrix, (n, n, 4))
    vectors, covariance = whole_numbers(seed, n, 4), whole_numbers(seed, n, n, 2, 4)
    covariance += covariance.swapaxes(0, 1)
    moved, spread = np.einsum("ijN,jN->iN", full, vectors), np.einsum("iaN,abkN,jbN->ijkN", full, covariance, full)
    mapped.apply(vectors)
    mapped.congruence(covariance)
    np.testing.assert_array_equal(vectors, moved)
    np.testing.assert_array_equal(covariance, spread)


def test_congruence_is_symmetric_to_the_last_bit() -> None:
    rng = np.random.default_rng(1)
    covariance = positive_definite(1, 5, 50)
    linalg.LinearMap(rng.normal(size=(5, 5, 50))).congruence(covariance)
    np.testing.assert_array_equal(covariance, covariance.swapaxes(0, 1))


@pytest.mark.parametrize("shape", [(1, 3), (3, 1), (2, 2)])
def test_linear_map_with_a_single_entry(shape: tuple[int, int]) -> None:
    matrix = np.zeros(shape)
    matrix[0, 0] = 2.0
    vectors = whole_numbers(0, shape[1], 4)
    np.testing.assert_array_equal(linalg.LinearMap(matrix)(vectors), matrix @ vectors)


def test_linear_map_takes_a_plain_matrix_and_leaves_its_argument_alone() -> None:
    matrix, vectors = np.array([[1.0, 2.0], [0.0, 1.0]]), np.ones((2, 3))
    np.testing.assert_array_equal(linalg.LinearMap(matrix)(vectors), [[3.0] * 3, [1.0] * 3])
    np.testing.assert_array_equal(vectors, 1.0)


RNG = np.random.default_rng(0)
SPD = positive_definite(0, 6, N)
ROWS = RNG.normal(size=(6, 13, N))
VECTORS = RNG.normal(size=(6, N))
LOWER = linalg.cholesky(SPD).lower
PER_ENV = RNG.normal(size=(6, 6, N))
SHARED = RNG.normal(size=(6, 6, 1))


@pytest.mark.parametrize(
    ("function", "arrays"),
    [
        pytest.param(linalg.tree_sum, [ROWS], id="tree_sum"),
        pytest.param(linalg.inner, [VECTORS, VECTORS], id="inner"),
        pytest.param(linalg.matvec, [SPD, VECTORS], id="matvec"),
        pytest.param(linalg.matmul, [SPD, ROWS], id="matmul"),
        pytest.param(linalg.row_gram, [ROWS], id="row_gram"),
        pytest.param(lambda a: linalg.cholesky(a).lower, [SPD], id="cholesky"),
        pytest.param(linalg.solve_lower, [LOWER, ROWS], id="solve_lower"),
        pytest.param(linalg.log_determinant, [LOWER], id="log_determinant"),
        pytest.param(linalg.inverse_from_factor, [LOWER], id="inverse_from_factor"),
        pytest.param(linalg.nearest_positive_definite, [SPD], id="nearest_positive_definite"),
        pytest.param(lambda a, x: linalg.LinearMap(a, dense=True)(x), [PER_ENV, ROWS], id="map per environment"),
        pytest.param(lambda a, x: linalg.LinearMap(a)(x), [SHARED, VECTORS], id="shared map"),
        pytest.param(lambda a, p: linalg.LinearMap(a).congruence(p) or p, [SHARED, SPD], id="congruence"),
        pytest.param(linalg.cholesky_above, [SPD, np.full((6, N), 0.1)], id="cholesky_above"),
    ],
)
def test_bits_do_not_depend_on_the_batch(
    function: Callable[..., np.ndarray], arrays: list[np.ndarray], assert_batch_free: Callable[..., None]
) -> None:
    assert_batch_free(function, *arrays)


@pytest.mark.parametrize("copies", [(), (2,)])
@pytest.mark.parametrize("size", [1, 5])
def test_congruence_of_a_single_run_with_entries_of_its_own(size: int, copies: tuple[int, ...]) -> None:
    """The short cut for maps that change the leading rows alone, with a different entry in each."""
    rng = np.random.default_rng(4)
    matrix = np.eye(5)
    matrix[0, 2], matrix[1, 3] = 0.7, -1.9
    root = rng.normal(size=(5, 5, *copies, size))
    symmetric = np.einsum("ik...,jk...->ij...", root, root)
    symmetric = 0.5 * (symmetric + symmetric.swapaxes(0, 1))
    expected = np.einsum("ik,kl...,jl->ij...", matrix, symmetric, matrix)
    linalg.LinearMap(matrix).congruence(symmetric)
    np.testing.assert_allclose(symmetric, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(symmetric, symmetric.swapaxes(0, 1))
