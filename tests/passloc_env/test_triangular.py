"""Triangular roots against NumPy's QR and Cholesky decompositions, and where rounding has the last word."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passloc_env import linalg, triangular

SEEDS = st.integers(0, 2**32 - 1)
SIZES = st.integers(1, 7)
EPSILON = np.finfo(float).eps


def columns(seed: int, n: int, count: int, size: int = 5) -> np.ndarray:
    """``(n, count, size)`` whose rows differ in scale as metres and radians do."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, count, size)) * 10.0 ** rng.uniform(-6, 6, (n, 1, 1))


def root_by_qr(matrix: np.ndarray) -> np.ndarray:
    """``Rᵀ`` of NumPy's QR decomposition of one ``Aᵀ``, its diagonal made positive."""
    upper = np.linalg.qr(matrix.T, mode="r")
    return (upper * np.copysign(1.0, np.diag(upper))[:, None]).T


@given(SEEDS, SIZES, st.integers(0, 8))
def test_triangularise_is_the_qr_decomposition(seed: int, n: int, more: int) -> None:
    """Each row to 1e-13 of its length, times the condition of the rows scaled to one (Golub & Van Loan, 5.2)."""
    matrix = columns(seed, n, n + more)
    found = triangular.triangularise(matrix)
    assert (linalg.diagonal(found) > 0.0).all()
    for column in range(matrix.shape[-1]):
        one = matrix[..., column]
        lengths = np.sqrt((one**2).sum(axis=1, keepdims=True))
        expected = root_by_qr(one)
        tolerance = 1e-13 * max(1.0, np.linalg.cond(one / lengths) / 100.0)
        np.testing.assert_allclose(found[..., column] / lengths, expected / lengths, rtol=0, atol=tolerance)
        np.testing.assert_array_equal(np.triu(found[..., column], 1), 0.0)


@given(SEEDS, SIZES, st.integers(0, 9), st.booleans())
def test_triangularise_keeps_the_square(seed: int, n: int, count: int, gap: bool) -> None:
    """``L Lᵀ = A Aᵀ`` also for too few columns, rows of zeros, and rows that repeat each other."""
    matrix = columns(seed, n, count)
    if gap and count:
        matrix[seed % n] = 0.0
        matrix[-1] = matrix[0]
    kept = matrix.copy()
    found = triangular.triangularise(matrix)
    np.testing.assert_array_equal(matrix, kept)
    lengths = np.sqrt((matrix**2).sum(axis=1)) + 1e-100
    scale = lengths[:, None] * lengths[None]
    gram = np.einsum("ikN,jkN->ijN", matrix, matrix)
    np.testing.assert_allclose(np.einsum("ikN,jkN->ijN", found, found) / scale, gram / scale, rtol=0, atol=1e-14)
    assert (linalg.diagonal(found) >= 0.0).all()


def test_triangularise_takes_axes_in_between_and_leaves_nan_where_it_is() -> None:
    matrix = columns(0, 3, 5, 8)
    expected = triangular.triangularise(matrix)
    folded = triangular.triangularise(matrix.reshape(3, 5, 2, 4))
    np.testing.assert_array_equal(folded.reshape(3, 3, 8), expected)
    matrix[1, 2, 3] = np.nan
    broken = triangular.triangularise(matrix)
    assert np.isnan(broken[1:, 1, 3]).all()
    healthy = np.arange(8) != 3
    np.testing.assert_array_equal(broken[..., healthy], expected[..., healthy])


@given(SEEDS, SIZES)
def test_lower_gram(seed: int, n: int) -> None:
    lower = np.moveaxis(np.tril(np.moveaxis(columns(seed, n, n), -1, 0)), 0, -1)
    found = triangular.lower_gram(lower)
    scale = np.sqrt(linalg.diagonal(found))
    expected = np.einsum("ikN,jkN->ijN", lower, lower)
    np.testing.assert_allclose((found - expected) / scale[:, None] / scale, 0.0, atol=1e-14)
    np.testing.assert_array_equal(found, found.swapaxes(0, 1))


def lower_root(seed: int, n: int, size: int = 5) -> np.ndarray:
    """Lower triangular ``(n, n, size)`` with a positive diagonal, of condition numbers to about 1e3."""
    root = np.random.default_rng(seed).normal(size=(size, n, n))
    return np.moveaxis(np.linalg.cholesky(root @ root.swapaxes(1, 2) + 0.1 * n * np.eye(n)), 0, -1).copy()


@given(SEEDS, SIZES, st.integers(0, 3))
def test_rotate_in_is_the_qr_decomposition(seed: int, n: int, before: int) -> None:
    """The leading column is NumPy's, the square of the others is what is left, and a root stays triangular."""
    rng, size = np.random.default_rng(seed), 5
    others = np.concatenate([rng.normal(size=(1 + before, n, size)), lower_root(seed, n)])
    leading = np.concatenate([rng.uniform(0.5, 2.0, (1, size)), rng.normal(size=(before, size)), np.zeros((n, size))])
    whole = np.concatenate([leading[:, None], others], axis=1)
    triangular.rotate_in(leading, others)
    root, rest = others[1 + before :], others[1:]
    np.testing.assert_array_equal(np.triu(np.moveaxis(root, -1, 0), 1), 0.0)
    assert (linalg.diagonal(root) > 0.0).all()
    for column in range(size):
        expected = root_by_qr(whole[..., column])
        np.testing.assert_allclose(leading[:, column], expected[:, 0], rtol=0, atol=1e-12)
        square, left = rest[..., column] @ rest[..., column].T, expected[1:, 1:] @ expected[1:, 1:].T
        np.testing.assert_allclose(square, left, rtol=0, atol=1e-12 * max(1.0, np.abs(left).max()))


def test_rotate_in_keeps_the_digits_of_what_is_hardly_left() -> None:
    """Noise twelve orders below what it measures: the variance left is the textbook's ``P R/(P + R)`` to rounding.

    ``P − P²/(P + R)`` is zero in double precision, or worse.
    """
    prior, noise = 1e6, 1e-6
    leading, others = np.array([[noise], [0.0]]), np.array([[[prior]], [[prior]]])
    triangular.rotate_in(leading, others)
    assert others[1, 0, 0] == pytest.approx(prior * noise / np.hypot(prior, noise), rel=4 * EPSILON)
    assert prior**2 - prior**4 / (prior**2 + noise**2) == 0.0


@given(SEEDS, SIZES, st.floats(0.0, 0.99))
def test_downdate(seed: int, n: int, reach: float) -> None:
    """Against NumPy's factor of the difference, whose condition is what the removed share leaves."""
    lower = lower_root(seed, n)
    share = np.random.default_rng(seed + 1).normal(size=(n, 5))
    share *= reach / np.sqrt((share**2).sum(axis=0))
    vector = np.einsum("ikN,kN->iN", lower, share)
    difference = np.einsum("ikN,jkN->ijN", lower, lower) - vector[:, None] * vector
    assert not triangular.downdate(lower, vector).any()
    expected = np.linalg.cholesky(np.moveaxis(difference, -1, 0))
    np.testing.assert_allclose(np.moveaxis(lower, -1, 0), expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@given(SEEDS, SIZES, st.floats(1.0001, 1e3))
def test_downdate_by_too_much_is_cut_and_told(seed: int, n: int, reach: float) -> None:
    """What is left is the covariance without the vector's direction, in the covariance's own metric."""
    lower, where = lower_root(seed, n), np.arange(5) == 2
    before, direction = lower.copy(), np.random.default_rng(seed).normal(size=n)
    direction /= np.linalg.norm(direction)
    vector = np.einsum("ikN,k->iN", lower, reach * direction) * where
    np.testing.assert_array_equal(triangular.downdate(lower, vector), where)
    assert (linalg.diagonal(lower) > 0.0).all()
    left = np.linalg.solve(before[..., 2], lower[..., 2])
    np.testing.assert_allclose(left @ left.T, np.eye(n) - np.outer(direction, direction), rtol=0, atol=1e-10)
    np.testing.assert_allclose(lower[..., ~where], before[..., ~where], rtol=1e-14)


SQUARE, WIDE = lower_root(0, 5, 300), columns(1, 5, 12, 300)


def rotated(leading: np.ndarray, others: np.ndarray) -> np.ndarray:
    triangular.rotate_in(leading, others)
    return np.concatenate([leading[:, None], others], axis=1)


def downdated(lower: np.ndarray, vector: np.ndarray) -> np.ndarray:
    triangular.downdate(lower, vector)
    return lower


@pytest.mark.parametrize(
    ("function", "arrays"),
    [
        pytest.param(triangular.triangularise, [WIDE], id="triangularise"),
        pytest.param(triangular.lower_gram, [SQUARE], id="lower_gram"),
        pytest.param(rotated, [np.abs(WIDE[:, 0]), WIDE[:, 1:]], id="rotate_in"),
        pytest.param(downdated, [SQUARE, 0.1 * SQUARE[:, 0]], id="downdate"),
    ],
)
def test_bits_do_not_depend_on_the_batch(
    function: Callable[..., np.ndarray], arrays: list[np.ndarray], assert_batch_free: Callable[..., None]
) -> None:
    assert_batch_free(function, *arrays)
