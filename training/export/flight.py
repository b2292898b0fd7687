"""One episode from its first look to its end, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from agents import Policy
from passloc_env.arrays import Array, BoolArray
from passloc_env.layout import StateLayout
from passloc_env.nuisance import units_of
from passloc_env.platforms import Pose
from passloc_env.scenario import Scenario
from passloc_env.sensor_suite import SensorSuite
from passloc_env.sightline import Scene
from passloc_env.simulation import Simulation
from training.episodes import watch


@dataclass(frozen=True)
class Flight:
    """An episode at its T = steps + 1 instants, the first look among them; the last axis of every array is time.

    Attributes:
        scenario: with the numbers of this episode, arrays ``(1,)`` where they are random.
        policy, seed: who flew it, and the seed of the episode.
        time: seconds since the episode began ``(T,)``.
        truth: true emitter state ``(n, T)``, its rows named by ``truth_layout``, in ``truth_units``.
        poses: of each platform, batched over time: where it was.
        reported: the same as the platform believed, which is what the tracker was told.
        suite: the sensors of this episode.
        measurement: ``(m, T)``, NaN where nothing was detected; the scalars of sensor i are ``suite.rows[i]``.
        detected: ``(m, T)``.
        mean, covariance: of the track, ``(n, T)`` and ``(n, n, T)``, its rows named by ``track_layout``.
        range: from the own ship to the emitter ``(T,)``, m.
        relative_range_error: position error over range ``(T,)``.
        range_bound: Cramér–Rao bound on the range along the path flown, a standard deviation ``(T,)``, m.
        nees: normalised estimation error squared over the states that truth and track share ``(T,)``.
    """

    scenario: Scenario
    policy: str
    seed: int
    time: Array
    truth_layout: StateLayout
    truth_units: tuple[str, ...]
    truth: Array
    poses: list[Pose]
    reported: list[Pose]
    suite: SensorSuite
    measurement: Array
    detected: BoolArray
    track_layout: StateLayout
    track_units: tuple[str, ...]
    mean: Array
    covariance: Array
    range: Array
    relative_range_error: Array
    range_bound: Array
    nees: Array

    @property
    def scene(self) -> Scene:
        """The true emitter seen from the true poses, batched over time."""
        return Scene(self.truth, self.truth_layout, self.poses)


def fly(scenario: Scenario, policy: Policy, seed: int) -> Flight:
    """Fly one episode as the judges do: what is exported is what is judged under the same seed.

    The policy's own overrides are applied, and the episode lasts its whole time, whether or not the track is lost or
    the keep-out violated.
    """
    (log,), _ = watch(_Log, scenario, policy, 1, seed)
    return log.flight(policy.name, seed)


class _Log:
    """Watches the only environment of a simulation, from the first look on."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._arrays: dict[str, list[np.ndarray]] = {}
        self._poses: list[list[Pose]] = []
        self._reported: list[list[Pose]] = []
        simulation.watchers.append(self._watch)
        self._watch(simulation)

    def _watch(self, simulation: Simulation) -> None:
        outcome = simulation.outcome
        poses = outcome.scene.poses
        measurement, detected = simulation.measure(outcome.scene)
        if detected is None:
            detected = np.ones(measurement.shape, bool)
        now: dict[str, np.ndarray] = {
            "time": simulation.time,
            "truth": simulation.truth,
            "measurement": np.where(detected, measurement, np.nan),
            "detected": detected,
            "mean": simulation.track.mean,
            "covariance": simulation.track.covariance,
            "range": outcome.range,
            "relative_range_error": outcome.relative_range_error,
            "range_bound": outcome.range_sigma,
            "nees": outcome.nees,
        }
        for name, values in now.items():
            self._arrays.setdefault(name, []).append(values.copy())
        self._poses.append(_kept(poses))
        self._reported.append(_kept(simulation.reported_poses(poses, simulation.noise_at())))

    def flight(self, policy: str, seed: int) -> Flight:
        """The episode up to now."""
        models = self._simulation.models
        truth, track = models.truth.layout, models.tracker.layout
        return Flight(
            scenario=self._simulation.realised,
            policy=policy,
            seed=seed,
            truth_layout=truth,
            truth_units=truth.units(units_of(models.truth_nuisances)),
            poses=_over_time(self._poses),
            reported=_over_time(self._reported),
            suite=models.suite,
            track_layout=track,
            track_units=track.units(units_of(models.tracker_nuisances)),
            **{name: np.concatenate(values, axis=-1) for name, values in self._arrays.items()},
        )


def _kept(poses: list[Pose]) -> list[Pose]:
    """Copies of poses, whose own arrays the simulation goes on writing into."""
    return [type(pose).join([pose]) for pose in poses]


def _over_time(history: list[list[Pose]]) -> list[Pose]:
    """One pose per platform, batched over time, from a list of poses per instant."""
    return [type(poses[0]).join(list(poses)) for poses in zip(*history, strict=True)]
