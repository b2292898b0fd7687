"""What has happened in the episode of one environment: what a picture of it shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passloc_env.arrays import Array
from passloc_env.rendering.plane import Plane
from passloc_env.sensors import Bearing
from passloc_env.sightline import Scene
from passloc_env.simulation import Simulation


@dataclass(frozen=True)
class Instant:
    """The world of one environment after a sensor step, in the plane; metres, radians, seconds.

    Attributes:
        time: since the episode began.
        platforms: ``(p, 2)``; emitter, estimate: ``(2,)``.
        covariance: of the estimate ``(2, 2)``.
        bearings: where a bearing was taken, and what it was.
        error: of the estimate, relative to the range; bound: on the range, relative to it.
    """

    time: float
    platforms: Array
    emitter: Array
    estimate: Array
    covariance: Array
    bearings: list[tuple[Array, float]]
    error: float
    bound: float


class Recorder:
    """Keeps the running episode of one environment of a simulation.

    Attributes:
        instants: the first look, and every sensor step since.
    """

    def __init__(self, simulation: Simulation, column: int) -> None:
        self._simulation, self._column = simulation, column
        self.instants: list[Instant] = []
        self._steps = -1
        simulation.watchers.append(self._watch)

    def look(self) -> list[Instant]:
        """The episode up to now."""
        self._watch(self._simulation)
        return self.instants

    def _watch(self, simulation: Simulation) -> None:
        steps = int(simulation.step_count[self._column])
        if steps == self._steps and steps:
            return
        if steps <= self._steps or not self.instants:
            self.instants = []
            layout = simulation.models.truth.layout
            self._plane = Plane(simulation.truth[layout.position, self._column])
        self._steps = steps
        self.instants.append(self._instant(simulation))

    def _instant(self, simulation: Simulation) -> Instant:
        column, plane, outcome = self._column, self._plane, simulation.outcome
        layout, truth = simulation.models.tracker.layout, simulation.models.truth.layout
        position = layout.position
        return Instant(
            time=float(simulation.time[column]),
            platforms=np.array([plane.point(pose.position[:, column]) for pose in outcome.scene.poses]),
            emitter=plane.point(simulation.truth[truth.position, column]),
            estimate=plane.point(simulation.track.mean[position, column]),
            covariance=plane.spread(simulation.track.covariance[position, position, column]),
            bearings=self._bearings(simulation, outcome.scene),
            error=float(outcome.relative_range_error[column]),
            bound=float(outcome.range_sigma[column] / outcome.range[column]),
        )

    def _bearings(self, simulation: Simulation, scene: Scene) -> list[tuple[Array, float]]:
        suite, column = simulation.models.suite, self._column
        measurement, detected = simulation.measure(scene)
        heard = []
        for sensor, rows in zip(suite.sensors, suite.rows, strict=True):
            row = rows.start
            if isinstance(sensor, Bearing) and (detected is None or detected[row, column]):
                pose = scene.poses[sensor.platform].mounted(sensor.lever_arm)
                heard.append((self._plane.point(pose.position[:, column]), float(measurement[row, column])))
        return heard
