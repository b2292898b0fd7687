"""Stone Soup's unscented filter on the same bearings and Doppler: the tracker alone, without an environment around it.

Importing this module imports Stone Soup, which only the ``dev`` extra installs.
"""

from __future__ import annotations

import datetime
import math
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.predictor.kalman import UnscentedKalmanPredictor
from stonesoup.types.array import CovarianceMatrix, StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import UnscentedKalmanUpdater

from passloc_env import Scenario
from passloc_env.arrays import Array
from passloc_env.tracking import RangePrior, UnscentedKalman
from training.benchmark.peer_tracking import (
    doppler_scale,
    measurement_noise,
    prior_covariance,
    process_noise,
    transition,
)
from training.benchmark.peer_world import wrap
from training.benchmark.recording import Look

_EPOCH = datetime.datetime(2000, 1, 1)


class BearingDopplerModel(NonLinearGaussianMeasurement):  # type: ignore[misc]
    """Compass bearing relative to ``reference``, and Doppler shift, heard from a moving own ship."""

    own: Any = Property(doc="the own ship when it listens")
    reference: float = Property(doc="bearing from which bearings are counted, rad")
    scale: float = Property(doc="shift per range rate, Hz per m/s")

    @property
    def ndim_meas(self) -> int:
        """Two scalars."""
        return 2

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        """Noise-free measurement ``(2, k)`` of states ``(4, k)``; Stone Soup adds the noise by its covariance."""
        east, north, v_east, v_north = np.asarray(state.state_vector, float)
        own_east, own_north = self.own.velocity
        x, y = east - self.own.east, north - self.own.north
        bearing = np.arctan2(x, y) - self.reference
        bearing -= math.tau * np.rint(bearing / math.tau)
        rate = (x * (v_east - own_east) + y * (v_north - own_north)) / np.hypot(x, y)
        return StateVectors([bearing, self.scale * rate])


class StoneSoupTracker:
    """Predictor and updater, and the belief between them.

    Args:
        scenario: a BearingDoppler scenario that the peer's ``check`` has accepted.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        tracker, period = scenario.tracker, scenario.episode.period
        assert isinstance(tracker, UnscentedKalman)
        spread = {"alpha": tracker.alpha, "beta": tracker.beta, "kappa": tracker.kappa}
        motion = LinearGaussianTimeInvariantTransitionModel(
            transition_matrix=transition(period),
            covariance_matrix=CovarianceMatrix(process_noise(tracker.motion, period)),
        )
        self._predictor = UnscentedKalmanPredictor(motion, **spread)
        self._updater = UnscentedKalmanUpdater(**spread)
        self._noise = CovarianceMatrix(measurement_noise(scenario))
        self._scale = doppler_scale(scenario)
        self._period = datetime.timedelta(seconds=period)

    def start(self, look: Look) -> None:
        """Begin a track from the first bearing."""
        prior = self.scenario.prior
        assert isinstance(prior, RangePrior)
        sigma = math.sqrt(self._noise[0, 0])
        guess = prior.range
        mean = [[guess * math.sin(look.bearing)], [guess * math.cos(look.bearing)], [0.0], [0.0]]
        covariance = prior_covariance(prior, look.bearing, guess * sigma)
        self._belief = GaussianState(StateVector(mean), CovarianceMatrix(covariance), timestamp=_EPOCH)

    def step(self, look: Look) -> None:
        """Predict and update."""
        time = self._belief.timestamp + self._period
        prediction = self._predictor.predict(self._belief, timestamp=time)
        east, north = prediction.mean[0, 0], prediction.mean[1, 0]
        reference = math.atan2(east - look.own.east, north - look.own.north)
        model = BearingDopplerModel(
            ndim_state=4,
            mapping=(0, 1),
            noise_covar=self._noise,
            own=look.own,
            reference=reference,
            scale=self._scale,
        )
        measurement = StateVector([wrap(look.bearing - reference), look.shift])
        detection = Detection(measurement, timestamp=time, measurement_model=model)
        self._belief = self._updater.update(SingleHypothesis(prediction, detection))

    @property
    def mean(self) -> Array:
        """``(4,)``."""
        return np.asarray(self._belief.mean, float)[:, 0]

    @property
    def covariance(self) -> Array:
        """``(4, 4)``."""
        return np.asarray(self._belief.covar, float)
