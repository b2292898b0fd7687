"""Weights by Bayes' rule in any range of likelihoods, and the moments of a mixture."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as some

from passloc_env.linalg import unsound
from passloc_env.models import ScenarioModels
from passloc_env.scenario import Scenario
from passloc_env.tracking.mixture import Members, MixtureTrack, moments

MODELS = ScenarioModels(Scenario(), []).tracker

finite = some.floats(-1e6, 1e6)


@given(some.lists(some.tuples(finite, finite, some.one_of(some.just(math.nan), finite)), min_size=1, max_size=6))
def test_weights_are_a_distribution_whatever_the_likelihoods(rows: list[tuple[float, float, float]]) -> None:
    """Log-likelihoods of any size, some of broken members: the weights sum to one and the moments are sound."""
    track = MixtureTrack(MODELS, 3, len(rows))
    rng = np.random.default_rng(len(rows))
    root = rng.standard_normal((4, 4, len(rows), 3))
    covariance = np.einsum("ikmn,jkmn->ijmn", root, root) + np.eye(4)[:, :, None, None]
    track.members = Members.of(
        1e3 * rng.standard_normal((4, len(rows), 3)), 0.5 * (covariance + covariance.swapaxes(0, 1))
    )
    likelihood = np.array(rows)
    whole = np.isfinite(likelihood).any(axis=0)
    with np.errstate(all="ignore"):
        track.weigh(likelihood)
    assert (track.weights[:, whole] >= 0.0).all()
    np.testing.assert_allclose(track.weights[:, whole].sum(axis=0), 1.0, atol=1e-14)
    assert (track.weights[:, whole][~np.isfinite(likelihood[:, whole])] == 0.0).all()
    np.testing.assert_array_equal(np.isfinite(track.nis), whole)
    np.testing.assert_array_equal(track.covariance, track.covariance.swapaxes(0, 1))
    assert not unsound(track.covariance[..., whole]).any()


def test_moments_of_a_mixture_by_sampling_free_formula() -> None:
    """``E[x xᵀ] − x̄ x̄ᵀ``, the other way to write them."""
    rng = np.random.default_rng(2)
    weights, mean = rng.dirichlet(np.ones(4), 5).T, rng.standard_normal((3, 4, 5))
    root = rng.standard_normal((3, 3, 4, 5))
    covariance = np.einsum("ikmn,jkmn->ijmn", root, root)
    centre, spread = moments(weights, mean, covariance)
    expected = np.einsum("mn,imn->in", weights, mean)
    second = np.einsum("mn,ijmn->ijn", weights, covariance + np.einsum("imn,jmn->ijmn", mean, mean))
    np.testing.assert_allclose(centre, expected, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(spread, second - np.einsum("in,jn->ijn", expected, expected), rtol=1e-10, atol=1e-12)
