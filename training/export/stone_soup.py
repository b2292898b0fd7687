"""A flight as Stone Soup's own objects, for its metrics, plotters and filters.

Importing this module imports Stone Soup. States keep the order of their rows, position block before velocity block,
and SI units; :func:`position_mapping` and :func:`velocity_mapping` tell Stone Soup where to look. The one thing that is
turned over is the bearing: ours is clockwise from north, Stone Soup's counter-clockwise from east.
"""

from __future__ import annotations

import math
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.models.measurement import MeasurementModel
from stonesoup.models.measurement.nonlinear import Cartesian2DToBearing, NonLinearGaussianMeasurement
from stonesoup.platform.base import PathBasedPlatform
from stonesoup.types.angle import Bearing as StoneSoupBearing
from stonesoup.types.array import CovarianceMatrix, StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track

from passloc_env.arrays import Array
from passloc_env.layout import StateLayout
from passloc_env.platforms import Pose
from passloc_env.sensors import Bearing, Sensor
from passloc_env.sightline import Scene
from training.export.flight import Flight


def position_mapping(layout: StateLayout) -> tuple[int, ...]:
    """The rows of the position in a state of this layout."""
    return tuple(range(layout.size))[layout.position]


def velocity_mapping(layout: StateLayout) -> tuple[int, ...]:
    """The rows of the velocity in a state of this layout."""
    return tuple(range(layout.size))[layout.velocity]


def ground_truth(flight: Flight, epoch: datetime) -> GroundTruthPath:
    """The emitter's path, in the rows of the track, so that the two compare row by row.

    What the track does not believe in is left out; what it alone believes in is zero.

    Args:
        flight: what was flown.
        epoch: when the episode began; instants are rounded to microseconds.
    """
    truth = flight.track_layout.convert(flight.truth, flight.truth_layout)
    return _path(truth, _instants(flight, epoch))


def platforms(flight: Flight, epoch: datetime) -> list[PathBasedPlatform]:
    """The true paths of the platforms, position and velocity; each ``path`` is whole, and ``move`` follows it."""
    times = _instants(flight, epoch)
    built = []
    for pose in flight.poses:
        layout = StateLayout(len(pose.position))
        built.append(
            PathBasedPlatform(
                path=_path(np.concatenate([pose.position, pose.velocity]), times),
                position_mapping=position_mapping(layout),
                velocity_mapping=velocity_mapping(layout),
            )
        )
    return built


def track(flight: Flight, epoch: datetime) -> Track:
    """What our tracker believed, from its prior on.

    Where states of very different size stand beside each other, such as an orbit's metres and an attitude's radians,
    scale them before a Mahalanobis measure of Stone Soup: its pseudo-inverse drops what is below 1e-15 of the largest.
    """
    states = [
        GaussianState(StateVector(mean), CovarianceMatrix(covariance), timestamp=time)
        for mean, covariance, time in zip(
            flight.mean.T, np.moveaxis(flight.covariance, -1, 0), _instants(flight, epoch), strict=True
        )
    ]
    return Track(states)


def detections(flight: Flight, epoch: datetime) -> list[tuple[datetime, set[Detection]]]:
    """What was heard, as a detector of Stone Soup yields it: each instant with a detection per sensor that heard.

    Each detection names its sensor in the metadata, by index and kind, and carries the model of its measurement, for
    states in the rows of the track, seen from where the platform reported to be. A bearing is given as Stone Soup
    counts it, ``π/2 − θ``, with its own model; Stone Soup has none for the other sensors alone, so these bring ours, in
    :class:`SensorModel`. The first instant is what our prior was made from.
    """
    heard = []
    for instant, time in enumerate(_instants(flight, epoch)):
        poses = [_at(pose, instant) for pose in flight.reported]
        now = set()
        for index, (sensor, rows) in enumerate(zip(flight.suite.sensors, flight.suite.rows, strict=True)):
            if flight.detected[rows, instant].all():
                vector, model = _measured(sensor, flight.measurement[rows, instant], flight.track_layout, poses)
                metadata = {"sensor": index, "kind": type(sensor).__name__}
                now.add(Detection(vector, timestamp=time, measurement_model=model, metadata=metadata))
        heard.append((time, now))
    return heard


class SensorModel(NonLinearGaussianMeasurement):  # type: ignore[misc]
    """A sensor of ours as a measurement model of Stone Soup; its angles are compared around the circle."""

    sensor: Sensor = Property(doc="the sensor")
    layout: StateLayout = Property(doc="the rows of a state")
    poses: list[Pose] = Property(doc="of every platform when it listens, for one environment")

    @property
    def ndim_meas(self) -> int:
        """Number of scalars."""
        return self.sensor.size

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        """The measurement ``(m, k)`` of states ``(n, k)``, noise-free unless noise is given or asked for."""
        measured = StateVectors(self.sensor.measure(self._scene(state))[..., 0])
        if noise is True:
            measured = measured + self.rvs(num_samples=measured.shape[1], **kwargs)
        elif noise is not False and noise is not None:
            measured = measured + noise
        if not any(self.sensor.angular):
            return measured
        return np.array([[StoneSoupBearing(0.0) if angle else 0.0] for angle in self.sensor.angular]) + measured

    def jacobian(self, state: Any, **kwargs: Any) -> Array:
        """``(m, n)`` at a state ``(n, 1)``."""
        derivative: Array = self.sensor.jacobian(self._scene(state))[:, :, 0, 0]
        return derivative

    def _scene(self, state: Any) -> Scene:
        """The states as middle axis, one environment."""
        return Scene(np.asarray(state.state_vector, float)[..., None], self.layout, self.poses)


def _measured(
    sensor: Sensor, value: Array, layout: StateLayout, poses: list[Pose]
) -> tuple[StateVector, MeasurementModel]:
    """A measurement ``(m,)`` as Stone Soup counts it, and its model."""
    noise = CovarianceMatrix(sensor.noise_covariance()[..., 0])
    if isinstance(sensor, Bearing):
        place = poses[sensor.platform].mounted(sensor.lever_arm).position
        bearing = Cartesian2DToBearing(
            ndim_state=layout.size,
            mapping=position_mapping(layout)[:2],
            noise_covar=noise,
            translation_offset=StateVector(place[:2, 0]),
        )
        return StateVector([StoneSoupBearing(math.pi / 2.0 - value[0])]), bearing
    model = SensorModel(
        ndim_state=layout.size,
        mapping=tuple(range(layout.size)),
        noise_covar=noise,
        sensor=sensor,
        layout=layout,
        poses=poses,
    )
    angles = zip(sensor.angular, value, strict=True)
    return StateVector([StoneSoupBearing(scalar) if angle else scalar for angle, scalar in angles]), model


def _path(states: Array, times: list[datetime]) -> GroundTruthPath:
    return GroundTruthPath(
        [GroundTruthState(StateVector(state), timestamp=time) for state, time in zip(states.T, times, strict=True)]
    )


def _instants(flight: Flight, epoch: datetime) -> list[datetime]:
    return [epoch + timedelta(seconds=float(time)) for time in flight.time]


def _at(pose: Pose, instant: int) -> Pose:
    """A pose batched over time at one instant, for one environment."""
    one = slice(instant, instant + 1)
    names = ("position", "velocity", "acceleration", "attitude", "attitude_rate")
    return Pose(*(getattr(pose, name)[..., one] for name in names))
