"""How a bank cuts its prior, against scipy's truncated normal and against the prior's own moments."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some
from scipy import stats

from passloc_env.arrays import Array
from passloc_env.dynamics import Dynamics
from passloc_env.linalg import unsound
from passloc_env.motion import ConstantVelocity, Motion, UnknownTurn
from passloc_env.scenarios import SCENARIOS
from passloc_env.sensor_suite import SensorSuite
from passloc_env.sensors import Bearing
from passloc_env.simulation import Simulation
from passloc_env.tracking import RangeBank
from passloc_env.tracking.mixture import MixtureTrack
from passloc_env.tracking.tracker import Models

ORIGIN = np.array([2e3, -1e3])


def started(bank: RangeBank, mean: Array, covariance: Array, origin: Array | None = ORIGIN) -> MixtureTrack:
    """A bank begun in one environment from a prior ``(n,)``, ``(n, n)``."""
    dimension = (len(mean) - len(bank.motion.nuisances)) // 2
    layout = bank.motion.layout(dimension)
    dynamics = Dynamics(bank.motion, layout, 1.0, bank.motion.nuisances)
    track = bank.build(Models(layout, dynamics, SensorSuite((Bearing(sigma=3e-3),))), 1)
    track.start(np.array([0]), mean[:, None], covariance[..., None], None if origin is None else origin[:, None])
    return track


def prior(range_: float, sigma: float, bearing: float = 0.7, across: float = 3e-3) -> tuple[Array, Array]:
    """Range and bearing from :data:`ORIGIN`, and velocities."""
    u = np.array([np.sin(bearing), np.cos(bearing)])
    t = np.array([u[1], -u[0]])
    covariance = np.diag([0.0, 0.0, 100.0**2, 80.0**2])
    covariance[:2, :2] = sigma**2 * np.outer(u, u) + (across * range_) ** 2 * np.outer(t, t)
    return np.array([*(ORIGIN + range_ * u), 30.0, -20.0]), covariance


def polar(track: MixtureTrack, bearing: float = 0.7) -> tuple[Array, Array, Array]:
    """Each member's mean range, its standard deviation, and that across the line of sight."""
    u = np.array([np.sin(bearing), np.cos(bearing)])
    t = np.array([u[1], -u[0]])
    means, covariances = track.members.mean[:2, :, 0], track.members.covariance[:2, :2, :, 0]
    along, across = (np.sqrt(np.einsum("i,ijm,j->m", axis, covariances, axis)) for axis in (u, t))
    return u @ (means - ORIGIN[:, None]), along, across


def ends(bank: RangeBank, range_: float, sigma: float) -> Array:
    """Where the stretches end, as the documentation says."""
    furthest = range_ + bank.reach * sigma
    return np.geomspace(max(bank.nearest * furthest, range_ - bank.reach * sigma), furthest, bank.members + 1)


@pytest.mark.parametrize("bank", [RangeBank(), RangeBank(members=8, reach=2.0), RangeBank(members=2, nearest=0.4)])
@pytest.mark.parametrize(("range_", "sigma"), [(40e3, 15e3), (5e3, 2e3), (30e3, 1e3), (600.0, 4e3)])
def test_members_are_truncated_normals(bank: RangeBank, range_: float, sigma: float) -> None:
    """Weight, mean and spread of each stretch by scipy; its difference of two numbers near one leaves 1e-9."""
    track = started(bank, *prior(range_, sigma))
    cuts = (ends(bank, range_, sigma) - range_) / sigma
    ranges, along, across = polar(track)
    mass = np.diff(stats.norm.cdf(cuts))
    np.testing.assert_allclose(track.weights[:, 0], mass / mass.sum(), rtol=1e-9)
    parts = [stats.truncnorm(low, high, loc=range_, scale=sigma) for low, high in itertools.pairwise(cuts)]
    np.testing.assert_allclose(ranges, [part.mean() for part in parts], rtol=1e-9)
    np.testing.assert_allclose(along, [part.std() for part in parts], rtol=1e-6)
    # Every member sees the same angle, and has the prior's velocity.
    np.testing.assert_allclose(across / ranges, 3e-3, rtol=1e-6)
    np.testing.assert_allclose(track.members.mean[2:, :, 0], np.array([[30.0], [-20.0]]) * np.ones(bank.members))
    np.testing.assert_allclose(track.members.covariance[2:, 2:, :, 0].T, [np.diag([1e4, 6400.0])] * bank.members)


def test_members_have_one_small_coefficient_of_variation() -> None:
    """A fifth of the prior's at most: that of a uniform stretch, ``(ρ − 1) / (ρ + 1) · 2/√12``, is never exceeded."""
    bank, (range_, sigma) = RangeBank(), (40e3, 15e3)
    ranges, along, _ = polar(started(bank, *prior(range_, sigma)))
    ratio = (1.0 / bank.nearest) ** (1.0 / bank.members)
    uniform = (ratio - 1.0) / (ratio + 1.0) * 2.0 / np.sqrt(12.0)
    assert (along / ranges <= 1.01 * uniform).all()
    assert uniform < 0.4 * sigma / range_


@pytest.mark.parametrize(("range_", "sigma"), [(40e3, 10e3), (30e3, 1e3), (200e3, 5e3)])
def test_mixture_has_the_moments_of_its_prior(range_: float, sigma: float) -> None:
    """The tails beyond three standard deviations hold 2.7 % of the variance, and that is all that is lost."""
    mean, covariance = prior(range_, sigma)
    track = started(RangeBank(), mean, covariance)
    truncated = stats.truncnorm(-3.0, 3.0).var()
    scale = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((track.mean[:, 0] - mean) / scale, 0.0, atol=1e-6)
    u = np.array([np.sin(0.7), np.cos(0.7)])
    found = u @ track.covariance[:2, :2, 0] @ u
    assert found == pytest.approx(truncated * sigma**2, rel=1e-6)
    np.testing.assert_allclose(track.covariance[2:, :, 0], covariance[2:], rtol=1e-12, atol=1e-6)


def test_correlated_states_go_along() -> None:
    """What is correlated with the range (a velocity) moves with it as regression says."""
    mean, covariance = prior(30e3, 5e3)
    u = np.array([np.sin(0.7), np.cos(0.7)])
    covariance[:2, 2] = covariance[2, :2] = 0.6 * 5e3 * 100.0 * u
    track = started(RangeBank(), mean, covariance)
    ranges, along, _ = polar(track)
    slope = 0.6 * 100.0 / 5e3
    np.testing.assert_allclose(track.members.mean[2, :, 0], 30.0 + slope * (ranges - 30e3), rtol=1e-9)
    expected = 1e4 * (1.0 - 0.36) + (slope * along) ** 2
    np.testing.assert_allclose(track.members.covariance[2, 2, :, 0], expected, rtol=1e-6)


@given(
    range_=some.floats(1.0, 1e6),
    share=some.floats(1e-8, 20.0),
    across=some.floats(1e-6, 0.3),
    members=some.integers(1, 12),
    reach=some.floats(0.1, 6.0),
    nearest=some.floats(1e-3, 0.5),
)
def test_any_prior_can_be_cut(
    range_: float, share: float, across: float, members: int, reach: float, nearest: float
) -> None:
    """Weights are a distribution, ranges rise within what is covered, covariances are sound."""
    bank = RangeBank(members=members, reach=reach, nearest=nearest)
    track = started(bank, *prior(range_, share * range_, across=across))
    assert track.weights.sum() == pytest.approx(1.0, abs=1e-12)
    assert (track.weights >= 0.0).all()
    ranges, _, _ = polar(track)
    if members > 1:
        assert (np.diff(ranges) >= 0.0).all()
        assert ranges[0] > 0.0
    np.testing.assert_array_equal(track.members.covariance, track.members.covariance.swapaxes(0, 1))
    assert np.isfinite(track.members.covariance).all()
    assert np.isfinite(track.covariance).all()
    if share > 1e-5:
        assert not unsound(track.members.covariance).any()


@pytest.mark.parametrize("motion", [ConstantVelocity(), UnknownTurn()], ids=["2-D", "with a turn rate"])
def test_further_states_keep_their_prior(motion: Motion) -> None:
    mean, covariance = prior(40e3, 15e3)
    extra = len(motion.nuisances)
    mean = np.concatenate([mean, np.zeros(extra)])
    covariance = np.pad(covariance, ((0, extra), (0, extra))) + np.diag([0.0] * 4 + [0.02**2] * extra)
    track = started(RangeBank(motion=motion), mean, covariance)
    for row in range(4, 4 + extra):
        np.testing.assert_allclose(track.members.covariance[row, row], 0.02**2, rtol=1e-12)
        np.testing.assert_array_equal(track.members.mean[row], 0.0)


def test_three_axes() -> None:
    """An isotropic prior far away keeps its mean and nearly its covariance; None is the origin of coordinates."""
    mean, sigma = np.array([6e5, -3e5, 2e5, 1.0, 2.0, 3.0]), 5e3
    covariance = np.diag([sigma**2] * 3 + [100.0] * 3)
    track = started(RangeBank(), mean, covariance, None)
    same = started(RangeBank(), mean, covariance, np.zeros(3))
    np.testing.assert_array_equal(track.members.mean, same.members.mean)
    scale = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((track.mean[:, 0] - mean) / scale, 0.0, atol=1e-6)
    # Tails cut along the range, and the angular spread that grows with it, (1 + σ²/r²), across.
    np.testing.assert_allclose(track.covariance[..., 0] / np.outer(scale, scale), np.eye(6), atol=0.03)


def test_on_top_of_the_emitter_nothing_breaks() -> None:
    mean = np.array([*ORIGIN, 0.0, 0.0])
    track = started(RangeBank(), mean, np.diag([1e6, 1e6, 1e2, 1e2]))
    assert np.isfinite(track.mean).all()
    assert not unsound(track.members.covariance).any()


@pytest.mark.parametrize("carrier", [0, 1])
def test_the_origin_is_where_the_prior_was_made(carrier: int, begin: Callable[..., Simulation]) -> None:
    """Members lie on the line from the platform that carries the prior's sensor, wherever that is."""
    station = {"type": "FixedStation", "position": [7e3, -12e3]}
    scenario = SCENARIOS["BearingsOnly"].override({"tracker": {"type": "RangeBank"}})
    if carrier:
        data = scenario.to_dict()
        data["platforms"].append(station)
        data["sensors"].append({"type": "Bearing", "sigma": 3e-3, "platform": 1})
        data["prior"]["sensor"] = 1
        scenario = type(scenario).from_dict(data)
    simulation = begin(scenario, 4)
    own = simulation.poses()[carrier].position
    away = simulation.track.components["means"][:2] - own[:, None]
    bearings = np.arctan2(away[0], away[1])
    np.testing.assert_allclose(np.unwrap(bearings, axis=0) - bearings[:1], 0.0, atol=1e-9)
    assert (np.diff(np.hypot(*away), axis=0) > 0.0).all()
