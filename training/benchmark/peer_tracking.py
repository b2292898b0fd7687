"""What the hand-written peer knows of estimation: a FilterPy filter and the Cramér–Rao recursion, for one environment.

States are east, north and their rates, as in :class:`passloc_env.layout.StateLayout`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from filterpy.common import Q_discrete_white_noise
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from scipy.linalg import cholesky

from passloc_env import Scenario
from passloc_env.arrays import Array
from passloc_env.motion import ConstantAcceleration, ConstantVelocity, Motion
from passloc_env.sensors import Bearing, Doppler
from passloc_env.tracking import RangePrior, UnscentedKalman
from training.benchmark.peer_world import OwnShip, wrap

Move = Callable[[Array, float], Array]


def transition(period: float) -> Array:
    """``F (4, 4)`` of constant velocity over one period (s)."""
    matrix = np.eye(4)
    matrix[0, 2] = matrix[1, 3] = period
    return matrix


def accelerated(state: Array, period: float) -> Array:
    """East, north, their rates and accelerations one period later."""
    moved = state.copy()
    moved[:2] += period * state[2:4] + 0.5 * period * period * state[4:]
    moved[2:4] += period * state[4:]
    return moved


def process_noise(motion: Motion, period: float) -> Array:
    """``Q (4, 4)`` of a white acceleration held over each period (s), or ``(6, 6)`` of one that walks, by FilterPy."""
    assert isinstance(motion, (ConstantVelocity, ConstantAcceleration))
    order, variance = 1 + motion.order, motion.acceleration_noise**2
    noise: Array = Q_discrete_white_noise(order, period, variance, block_size=2, order_by_dim=False)
    return noise


def measurement_noise(scenario: Scenario) -> Array:
    """``R (m, m)``."""
    sigmas = [sensor.sigma for sensor in scenario.sensors if isinstance(sensor, (Bearing, Doppler))]
    return np.diag(np.square(sigmas))


def doppler_scale(scenario: Scenario) -> float:
    """Doppler shift per range rate, ``−f₀/c`` in Hz per m/s; 0 when none is heard."""
    for sensor in scenario.sensors:
        if isinstance(sensor, Doppler):
            return -float(sensor.carrier / sensor.propagation_speed)
    return 0.0


def prior_covariance(prior: RangePrior, bearing: float, across: float) -> Array:
    """Covariance ``(4, 4)``: ``range_sigma`` along a bearing, ``across`` (m) it, any velocity."""
    sine, cosine = math.sin(bearing), math.cos(bearing)
    axes = np.array([[sine, cosine], [cosine, -sine]])
    covariance = np.diag(np.square([0.0, 0.0, prior.velocity_sigma, prior.velocity_sigma]))
    covariance[:2, :2] = axes.T @ np.diag([prior.range_sigma**2, across**2]) @ axes
    return covariance


def build_filter(scenario: Scenario, move: Move | None = None, states: int = 4) -> Any:
    """FilterPy's unscented filter; call ``update(z, own=…, reference=…)`` with bearings relative to ``reference``.

    Bearings are taken from a reference near the emitter, so that none of them comes close to ±π and FilterPy's fast
    path for plain vectors, without mean and residual functions, is right.

    Args:
        scenario: what is heard, and how FilterPy is set.
        move: where a state ``(n,)`` is one period (s) later; by default straight on.
        states: n; the first four are east, north and their rates. Those that the tracker's motion does not have come
            without process noise.
    """
    tracker, period, shift = scenario.tracker, scenario.episode.period, doppler_scale(scenario)
    assert isinstance(tracker, UnscentedKalman)
    matrix = transition(period)

    def straight(state: Array, _: float) -> Array:
        return matrix @ state

    def measure(state: Array, own: OwnShip, reference: float) -> list[float]:
        east, north, v_east, v_north = state[:4].tolist()
        x, y = east - own.east, north - own.north
        bearing = wrap(math.atan2(x, y) - reference)
        if not shift:
            return [bearing]
        own_east, own_north = own.velocity
        return [bearing, shift * (x * (v_east - own_east) + y * (v_north - own_north)) / math.hypot(x, y)]

    points = MerweScaledSigmaPoints(states, tracker.alpha, tracker.beta, tracker.kappa, sqrt_method=robust_root)
    scalars = len(scenario.sensors)
    kalman = UnscentedKalmanFilter(states, scalars, period, measure, move or straight, points)
    kalman.Q, kalman.R = np.zeros((states, states)), measurement_noise(scenario)
    noise = process_noise(tracker.motion, period)
    kalman.Q[: len(noise), : len(noise)] = noise
    return kalman


def robust_root(covariance: Array) -> Array:
    """Upper triangular root ``(n, n)``; a covariance that rounding has made indefinite is repaired first."""
    try:
        root: Array = cholesky(covariance)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
        root = cholesky((vectors * np.maximum(values, 1e-10 * values[-1])) @ vectors.T)
    return root


class BoundRecursion:
    """The posterior Cramér–Rao bound (Tichavský, Muravchik & Nehorai 1998) and the Gram gain, in information form.

    Attributes:
        covariance: the bound ``(4, 4)``.
        gram_gain: ``ln det(G + P₀⁻¹)`` gained by the last measurement.
    """

    def __init__(self, scenario: Scenario) -> None:
        period = scenario.episode.period
        self._transition, self._backwards = transition(period), transition(-period)
        self._process_noise = process_noise(scenario.bound.motion, period)
        self._precision = np.linalg.inv(measurement_noise(scenario))

    def start(self, prior: Array) -> None:
        """Begin from the prior covariance at the truth ``(4, 4)``."""
        self.covariance: np.ndarray = prior
        self._gramian = np.linalg.inv(prior)
        self.gram_gain = 0.0

    def step(self, jacobian: Array) -> None:
        """One period later, after a measurement with ``H (m, 4)`` at the true geometry."""
        heard = jacobian.T @ self._precision @ jacobian
        predicted = self._transition @ self.covariance @ self._transition.T + self._process_noise
        self.covariance = np.linalg.inv(np.linalg.inv(predicted) + heard)
        before = self._backwards.T @ self._gramian @ self._backwards
        self._gramian = before + heard
        self.gram_gain = float(np.linalg.slogdet(self._gramian)[1] - np.linalg.slogdet(before)[1])
