"""Pulses recorded from the simulated satellites, and trackers run over them again beat by beat."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from gymnasium.utils.seeding import np_random

from passloc_env.angles import wrap
from passloc_env.arrays import Array
from passloc_env.frames import course
from passloc_env.metrics import nees
from passloc_env.models import ScenarioModels
from passloc_env.noise import NavigationErrors
from passloc_env.platforms import Pose
from passloc_env.randomisation import Randomisation
from passloc_env.scenario import Scenario
from passloc_env.simulation import Simulation
from passloc_env.tracking.tracker import Models, Track
from training.papers.monte_carlo import last_instant
from training.statistics import root_mean_square


@dataclass
class Errors:
    """Errors over time of a batch of runs: position in m, speed in m/s, course in rad, each ``(K, N)``."""

    time: Array
    position: Array
    speed: Array
    course: Array
    nees: Array

    def rms(self, name: str) -> Array:
        """Root mean square over the runs ``(K,)``."""
        return root_mean_square(getattr(self, name), axis=1)

    def at(self, time: float) -> int:
        """The last instant not after a time, s."""
        return last_instant(self.time, time)

    def settles(self, name: str, level: float) -> float:
        """Time from which the RMS stays at or below a level, s; infinite when it never does."""
        above = np.flatnonzero(self.rms(name) > level)
        if not above.size:
            return float(self.time[0])
        return float(self.time[above[-1] + 1]) if above[-1] + 1 < len(self.time) else float("inf")


@dataclass
class Record:
    """A batch of runs, pulse by pulse.

    Attributes:
        scenario: with one pulse per step.
        measurements: ``(K, m, N)``.
        attitudes: white attitude errors of each platform, as standard normals ``(K, p, 3, N)``.
        constants: constant ones ``(p, 3, N)``.
        truth: true states at the start ``(6, N)``; the emitter flies straight on.
        mean, covariance: of the first belief.
        tracked: errors of the tracker inside the simulation.
        bound: root of the trace of the bound's position block at every kept instant ``(K',)``, m, RMS over the runs.
    """

    scenario: Scenario
    measurements: Array
    attitudes: Array
    constants: Array
    truth: Array
    mean: Array
    covariance: Array
    tracked: Errors
    bound: Array


class _Judge:
    """Collects errors while a tracker runs."""

    def __init__(self, truth: Array) -> None:
        self._truth = truth
        self._rows: list[tuple[float, Array, Array, Array, Array]] = []

    def judge(self, time: float, track: Track) -> None:
        position, velocity = self._truth[:3] + time * self._truth[3:], self._truth[3:]
        offset, speed = track.mean[:3] - position, np.linalg.norm(velocity, axis=0)
        astray = wrap(course(track.mean[:3], track.mean[3:6]) - course(position, velocity))
        error = np.concatenate([offset, track.mean[3:6] - velocity])
        surprise = nees(error, track.covariance[:6, :6])
        swift = np.linalg.norm(track.mean[3:6], axis=0)
        self._rows.append((time, np.linalg.norm(offset, axis=0), np.abs(swift - speed), np.abs(astray), surprise))

    def errors(self) -> Errors:
        time, *histories = zip(*self._rows, strict=True)
        return Errors(np.array(time), *(np.stack(history) for history in histories))


def record(scenario: Scenario, runs: int, seed: int, every: int) -> Record:
    """Fly the satellites and keep every pulse; errors of the tracker inside at every so many pulses.

    All runs are one simulation, for a record of pulses is looked at as a whole.
    """
    simulation = Simulation(scenario.override({"episode.early_end": False}), runs)
    simulation.reset(np.arange(runs), [np_random(seed + index)[0] for index in range(runs)])
    mean, covariance, truth = simulation.track.mean.copy(), simulation.track.covariance.copy(), simulation.truth.copy()
    judge = _Judge(truth[:6])
    platforms = len(scenario.platforms)
    measurements = np.empty((scenario.episode.steps, simulation.models.suite.size, runs))
    attitudes = np.zeros((scenario.episode.steps, platforms, 3, runs))
    bounds: list[float] = []

    def watch(simulation: Simulation) -> None:
        step = int(simulation.step_count[0])
        measurements[step - 1] = simulation.measure(simulation.scene())[0]
        for platform, errors in enumerate(simulation.noise.navigation(simulation.step_count)):
            if len(errors.fresh):
                attitudes[step - 1, platform] = errors.fresh
        if step % every == 0:
            judge.judge(step * scenario.episode.period, simulation.track)
            variance = np.einsum("iin->n", simulation.information.bound[:3, :3])
            bounds.append(float(np.sqrt(variance.mean())))

    simulation.watchers.append(watch)
    neutral = np.zeros((scenario.action_size, runs))
    for _ in range(scenario.episode.steps // scenario.episode.decision_every):
        simulation.step(neutral)
    constants = np.zeros((platforms, 3, runs))
    for platform, errors in enumerate(simulation.noise.navigation(simulation.step_count)):
        if len(errors.constant):
            constants[platform] = errors.constant
    return Record(
        scenario, measurements, attitudes, constants, truth[:6], mean, covariance, judge.errors(), np.array(bounds)
    )


@dataclass(frozen=True)
class Looks:
    """What a beat is boiled down to: values at some instants.

    Attributes:
        times: ``(B,)``, s.
        measurements: ``(B, m, N)``.
        attitudes: ``(B, p, 3, N)``.
        variance: of a value, in units of a pulse's.
    """

    times: Array
    measurements: Array
    attitudes: Array
    variance: float


def track_looks(pulses: Record, looks: Looks, every: int = 1) -> Errors:
    """Run the scenario's tracker over other looks at the same pulses."""
    scenario = _with_variance(pulses.scenario, looks.variance)
    runs = pulses.truth.shape[1]
    models = _models_by_period(scenario)
    track = scenario.tracker.build(models(scenario.episode.period), runs)
    track.start(np.arange(runs), pulses.mean, pulses.covariance)
    judge, before = _Judge(pulses.truth), 0.0
    for number, (time, measurement, attitude) in enumerate(
        zip(looks.times, looks.measurements, looks.attitudes, strict=True), 1
    ):
        track.models = models(time - before)
        track.predict(np.full(runs, before))
        track.update(measurement, _reported_poses(pulses, time, attitude))
        before = time
        if number % every == 0:
            judge.judge(time, track)
    return judge.errors()


def _with_variance(scenario: Scenario, variance: float) -> Scenario:
    changes = {f"sensors.{i}.sigma": sensor.sigma * variance**0.5 for i, sensor in enumerate(scenario.sensors)}  # type: ignore[attr-defined]
    return scenario.override(changes)


def _models_by_period(scenario: Scenario) -> Callable[[float], Models]:
    """The tracker's models for a time between looks, built once for each."""
    known: dict[int, Models] = {}

    def models(period: float) -> Models:
        nanoseconds = round(1e9 * period)
        if nanoseconds not in known:
            changed = scenario.override({"episode.period": nanoseconds / 1e9})
            known[nanoseconds] = ScenarioModels(Randomisation(changed, 1).realised, ()).tracker
        return known[nanoseconds]

    return models


def _reported_poses(pulses: Record, time: float, attitudes: Array) -> list[Pose]:
    """What the satellites believe about themselves, their attitude read as often as the pulses came."""
    poses = []
    for platform, constant, fresh in zip(pulses.scenario.platforms, pulses.constants, attitudes, strict=True):
        start = platform.start(constant.shape[1])
        state = platform.move(start, np.zeros((platform.set_points, constant.shape[1])), time)
        errors = NavigationErrors(constant[: platform.constant_errors], fresh[: platform.fresh_errors])
        poses.append(platform.reported_pose(state, platform.pose(state), errors))
    return poses
