"""Distributions stay within their support and have the law they claim.

Seeds are fixed; each statistical test would have failed by chance with a probability of 1e-3 when they were chosen.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from passloc_env.distributions import Choice, Distribution, LogUniform, Uniform
from passloc_env.errors import ScenarioError

FALSE_ALARM = 1e-3
DRAWS = 20_000
LAST = np.nextafter(1.0, 0.0)
"""The largest uniform draw there is."""

FINITE = st.floats(-1e6, 1e6)
POSITIVE = st.floats(1e-6, 1e6)
DISTRIBUTIONS = st.one_of(
    st.builds(lambda a, b, s: Uniform(min(a, b), max(a, b), s), FINITE, FINITE, st.booleans()),
    st.builds(lambda a, b: LogUniform(min(a, b), max(a, b)), POSITIVE, POSITIVE),
    st.builds(lambda values: Choice(tuple(values)), st.lists(FINITE, min_size=1, max_size=5)),
)


@given(DISTRIBUTIONS, st.lists(st.floats(0.0, LAST), min_size=1, max_size=30))
def test_samples_lie_in_the_support(distribution: Distribution, draws: list[float]) -> None:
    values = distribution.sample(np.array([0.0, LAST, *draws]))
    low, high = distribution.support
    assert values.shape == (2 + len(draws),)
    assert (low <= values).all()
    assert (values <= high).all()


@given(DISTRIBUTIONS)
def test_support_is_tight(distribution: Distribution) -> None:
    values = distribution.sample(np.linspace(0.0, LAST, 4001))
    low, high = distribution.support
    # Neighbouring draws are 1/4000 apart; in the logarithm of 12 decades that is 0.7 %.
    assert values.min() == pytest.approx(low, rel=1e-2, abs=1e-3 * (high - low))
    assert values.max() == pytest.approx(high, rel=1e-2, abs=1e-3 * (high - low))


@pytest.mark.parametrize(
    ("distribution", "law"),
    [
        (Uniform(20e3, 60e3), stats.uniform(20e3, 40e3).cdf),
        (Uniform(-1.0, 3.0), stats.uniform(-1.0, 4.0).cdf),
        (Uniform(0.3, 2.0, True), lambda x: 0.5 + np.sign(x) * 0.5 * np.clip((np.abs(x) - 0.3) / 1.7, 0, 1)),
        (LogUniform(1e-4, 1e-1), stats.loguniform(1e-4, 1e-1).cdf),
    ],
    ids=["uniform", "uniform through zero", "uniform of either sign", "log-uniform"],
)
def test_continuous_law(distribution: Distribution, law: object) -> None:
    values = distribution.sample(np.random.default_rng(1).random(DRAWS))
    assert stats.kstest(values, law).pvalue > FALSE_ALARM


@pytest.mark.parametrize("values", [(-1.0, 1.0), (0.0, 1.0, 2.0), (5.0,)])
def test_choices_are_equally_likely(values: tuple[float, ...]) -> None:
    drawn = Choice(values).sample(np.random.default_rng(2).random(DRAWS))
    counts = [(drawn == value).sum() for value in values]
    assert sum(counts) == DRAWS
    assert stats.chisquare(counts).pvalue > FALSE_ALARM if len(values) > 1 else counts == [DRAWS]


@pytest.mark.parametrize(
    ("build", "field"),
    [
        (lambda: Uniform(2.0, 1.0), "high"),
        (lambda: LogUniform(0.0, 1.0), "low"),
        (lambda: LogUniform(2.0, 1.0), "high"),
        (lambda: Uniform(float("nan"), 1.0), "low"),
        (lambda: Uniform(0.0, float("inf")), "high"),
        (lambda: Uniform(True, 2.0), "low"),
        (lambda: Uniform(0.0, 1.0, either_sign=1), "either_sign"),
        (lambda: Choice(()), "values"),
        (lambda: Choice((1.0, "many")), "values"),
    ],
)
def test_impossible_limits_are_refused(build: object, field: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        build()
    assert caught.value.field == field
