"""Intervals against known distributions and against SciPy."""

import numpy as np
import pytest
from scipy import stats

from training import resampling, statistics
from training.statistics import Asked, Bootstrap, Estimate, chi_square_band, rate, root_mean_square

REPETITIONS = 1000


def shrunk(estimate: Estimate, factor: float) -> Estimate:
    """The same estimate with an interval that is too narrow."""
    low, high = (estimate.value + factor * (limit - estimate.value) for limit in (estimate.low, estimate.high))
    return Estimate(estimate.value, low, high)


def coverage_is_95_percent(estimates: list[Estimate], truth: float) -> bool:
    """Whether the truth lies inside as often as it should.

    A percentile bootstrap of 150 samples covers 0.94 to 0.95. With 1000 repetitions the share scatters by 0.0075, so
    that ± 0.025 about 0.945 raises a false alarm once in a thousand seeds; the seed is fixed. Intervals four fifths as
    wide cover 0.88, eight standard deviations away.
    """
    inside = np.mean([estimate.low <= truth <= estimate.high for estimate in estimates])
    return abs(inside - 0.945) < 0.025


@pytest.mark.parametrize(
    ("draw", "statistic", "truth"),
    [
        (lambda rng, n: rng.normal(3.0, 2.0, n), np.mean, 3.0),
        (lambda rng, n: rng.exponential(1.0, n), np.mean, 1.0),
        (lambda rng, n: rng.exponential(1.0, n), np.median, np.log(2.0)),
        (lambda rng, n: rng.normal(0.0, 2.0, n), root_mean_square, 2.0),
    ],
    ids=["mean of normal", "mean of exponential", "median of exponential", "rms of normal"],
)
def test_bootstrap_covers_as_it_says(draw, statistic, truth):
    rng = np.random.default_rng(12)
    bootstrap = Bootstrap(150, resamples=400)
    estimates = [bootstrap.estimate(draw(rng, 150), statistic) for _ in range(REPETITIONS)]
    assert coverage_is_95_percent(estimates, truth)
    assert not coverage_is_95_percent([shrunk(estimate, 0.8) for estimate in estimates], truth)
    assert not coverage_is_95_percent([shrunk(estimate, 1.6) for estimate in estimates], truth)


def test_bootstrap_of_a_mean_is_the_normal_interval():
    """σ̂/√n times ± 1.96, to 5 %: 2000 resamples know a 2.5 % quantile to about 2.5 % of the half width."""
    values = np.random.default_rng(0).normal(0.0, 1.0, 2000)
    estimate = Bootstrap(2000).estimate(values)
    half = 1.96 * values.std() / np.sqrt(2000)
    assert estimate.value == values.mean()
    assert estimate.high - values.mean() == pytest.approx(half, rel=0.05)
    assert values.mean() - estimate.low == pytest.approx(half, rel=0.05)


def test_bootstrap_is_paired_and_repeatable():
    """The same episodes are drawn for everyone, so a constant advantage has an interval of no width."""
    rng = np.random.default_rng(1)
    hard = rng.normal(0.0, 10.0, 64)
    bootstrap = Bootstrap(64)
    one, other = bootstrap.estimate(hard), bootstrap.estimate(hard - 0.25)
    np.testing.assert_allclose([other.low + 0.25, other.high + 0.25], [one.low, one.high], rtol=0, atol=1e-12)
    advantage = bootstrap.estimate((hard - 0.25) - hard)
    np.testing.assert_allclose([advantage.low, advantage.value, advantage.high], -0.25, rtol=1e-12)
    assert Bootstrap(64).estimate(hard) == one


VALUES = {
    "spread": lambda rng, n: rng.lognormal(0.0, 2.0, n),
    "tied": lambda rng, n: rng.integers(3, size=n).astype(float),
    "constant": lambda rng, n: np.full(n, 0.1),
    "parted": lambda rng, n: np.where(rng.random(n) < 0.5, 1e150, rng.random(n)),
    "undefined": lambda rng, n: np.where(np.arange(n) == 0, np.nan, rng.random(n)),
}
STATISTICS = {"mean": np.mean, "median": np.median, "rms": root_mean_square}


@pytest.mark.parametrize("kind", VALUES)
@pytest.mark.parametrize("episodes", [1, 129, 8192, 8193, 20_000, 20_001])
def test_resamples_in_pieces_are_resamples_to_the_last_bit(episodes, kind, monkeypatch):
    """Against NumPy on whole resamples; in pieces of so few values that the largest come in many, and in one piece."""
    rng = np.random.default_rng(episodes)
    values, resamples = VALUES[kind](rng, episodes), 30
    drawn = values[np.random.default_rng(20_000).integers(episodes, size=(resamples, episodes))]
    expected = [
        Estimate(float(statistic(values, axis=0)), *map(float, np.percentile(statistic(drawn, axis=1), [2.5, 97.5])))
        for statistic in STATISTICS.values()
    ]
    asked = [Asked(lambda: values, statistic) for statistic in STATISTICS.values()]
    for piece in (128, 3000, resampling.PIECE):
        monkeypatch.setattr(resampling, "PIECE", piece)
        monkeypatch.setattr(statistics, "_DRAWN", min(piece, 8192))
        found = Bootstrap(episodes, resamples).estimates(asked)
        np.testing.assert_array_equal(
            [list(vars(each).values()) for each in found], [list(vars(each).values()) for each in expected]
        )


def test_any_statistic_of_large_resamples(monkeypatch):
    """Several columns to an episode, and one that needs the whole resample."""
    monkeypatch.setattr(resampling, "PIECE", 1000)
    pairs = np.random.default_rng(4).normal(size=(9000, 2))
    drawn = pairs[np.random.default_rng(20_000).integers(9000, size=(20, 9000))]

    def last(values, axis):
        return np.percentile(values[..., 0] * values[..., 1], 99, axis=axis)

    estimate = Bootstrap(9000, 20).estimate(pairs, last)
    assert (estimate.low, estimate.high) == tuple(np.percentile(last(drawn, 1), [2.5, 97.5]))


def test_what_cannot_be_held_at_once_is_resampled_alike(monkeypatch):
    """Statistics that share their draws come to what they come to alone, whoever draws with them."""
    columns = np.random.default_rng(5).normal(size=(4, 9000))
    asked = [Asked(lambda column=column: column) for column in columns]
    together = Bootstrap(9000, 20).estimates(asked)
    monkeypatch.setattr(statistics, "_HELD", 1)
    assert Bootstrap(9000, 20).estimates(asked) == together


@pytest.mark.parametrize("episodes", [1, 2, 7])
def test_bootstrap_of_few_episodes(episodes):
    values = np.arange(float(episodes))
    estimate = Bootstrap(episodes).estimate(values, np.median)
    assert values.min() <= estimate.low <= estimate.value <= estimate.high <= values.max()
    if episodes < 3:
        assert (estimate.low, estimate.high) == (values.min(), values.max())


@pytest.mark.parametrize("episodes", [1, 2, 10, 512, 100_000])
@pytest.mark.parametrize("share", [0.0, 0.013, 0.5, 0.9, 1.0])
def test_rate_is_wilsons(episodes, share):
    happened = round(share * episodes)
    estimate = rate(np.arange(episodes) < happened)
    expected = stats.binomtest(happened, episodes).proportion_ci(method="wilson")
    assert estimate.value == happened / episodes
    assert (estimate.low, estimate.high) == pytest.approx((expected.low, expected.high), rel=1e-9, abs=1e-12)
    assert 0.0 <= estimate.low <= estimate.value <= estimate.high <= 1.0
    assert estimate.low < estimate.high


@pytest.mark.parametrize("degrees", [16, 128, 2048, 400_000])
def test_chi_square_band(degrees):
    """Wilson and Hilferty's cube root against the exact quantiles, to 1 % from four episodes of four states on."""
    expected = stats.chi2.ppf([0.025, 0.975], degrees) / degrees
    assert chi_square_band(degrees) == pytest.approx(tuple(expected), rel=0.01)


def test_root_mean_square():
    values = np.array([[3.0, -4.0], [0.0, 0.0]])
    np.testing.assert_allclose(root_mean_square(values, axis=1), [np.sqrt(12.5), 0.0])
    np.testing.assert_allclose(root_mean_square(values), [np.sqrt(4.5), np.sqrt(8.0)])
