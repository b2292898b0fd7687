"""A batch of worlds: act → move → measure → track → score, one method each.

:mod:`passloc_env.simulation` flies it; these methods say what is flown, and fly what cannot be compiled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from passloc_env.arrays import Array, BoolArray, IntArray, lasting, lasting_copy, zeros
from passloc_env.belief import Belief
from passloc_env.information import Information
from passloc_env.models import ScenarioModels
from passloc_env.noise import EpisodeNoise, Opening, StepNoise
from passloc_env.opening import first_truth, noise_sizes
from passloc_env.platforms import Platform, Pose
from passloc_env.randomisation import Randomisation, take
from passloc_env.rewards import Outcome
from passloc_env.scenario import Scenario
from passloc_env.sensor_suite import Arrival
from passloc_env.sightline import Scene, distance
from passloc_env.tracking.initialisation import FirstLook, Prior


class World:
    """What happens in a batch of worlds, each with its emitter, platforms, tracker, bound and clock; updated in place.

    Attributes:
        scenario: as the user wrote it.
        realised: the same with this episode's numbers, arrays ``(N,)`` where they are random.
        truth: true emitter state ``(n, N)``.
        platform_states: one array ``(rows, N)`` per platform.
        track: the tracker; information: the bound.
        step_count: sensor steps done in the episode ``(N,)``.
        reward, reward_terms: of the last decision, ``(N,)`` and by name.
        violated: whether the true range has been below ``min_range`` in the last decision ``(N,)``.
        breached: the same since the episode began.
        detected: which scalars ``(m, N)`` were measured in the last sensor step and came in time; None means all.
    """

    def __init__(self, scenario: Scenario, environments: int) -> None:
        self.scenario, self.environments = scenario, environments
        self._randomisation = Randomisation(scenario, environments)
        self.realised: Scenario = self._randomisation.realised
        self.models = self._build_models()
        self.noise = EpisodeNoise(noise_sizes(scenario, self.models, self._randomisation.size), environments)
        self.track = self.realised.tracker.build(self.models.tracker, environments)
        self.information = Information(self.models.bound.dynamics, environments)

        n = environments
        self.truth: Array = lasting((self.models.truth.layout.size, n))
        self.platform_states = [lasting_copy(platform.start(n)) for platform in self.realised.platforms]
        self._set_points: list[Array] = [np.zeros((p.set_points, n)) for p in self.realised.platforms]
        self.action: Array = np.zeros((scenario.action_size, n))
        self.step_count: IntArray = np.zeros(n, np.int64)
        self.reward: Array = np.zeros(n)
        self.reward_terms = {term.name: np.zeros(n) for term in scenario.reward}
        self.violated: BoolArray = np.zeros(n, bool)
        self.breached: BoolArray = np.zeros(n, bool)
        self.lost: BoolArray = np.zeros(n, bool)
        self.detected: BoolArray | None = None
        self._outcome: Outcome | None = None

    def advance(self, noise: StepNoise | None = None, before: StepNoise | None = None) -> None:
        """One sensor step, with its own noise and that of the step before unless others are given."""
        time, gained = self.time, self._catch_up(self.noise_at() if before is None else before)
        self.step_count += 1
        self.sense(time, self.noise_at() if noise is None else noise)
        if gained is not None:
            self.information.gram_gain += gained

    def _catch_up(self, noise: StepNoise) -> Array | None:
        """Take in what was measured at the present instant, under its noise, and comes late.

        Returns:
            Its Gram gain ``(N,)``; None where nothing can be late.
        """
        if not self.models.suite.may_be_late:
            return None
        scene = self.scene()
        measurement, late = self.measure(scene, noise, arrival="late")
        self.track.catch_up(measurement, self.reported_poses(scene.poses, noise), late)
        self._inform(scene, late, noise)
        return self.information.gram_gain.copy()

    def sense(self, time: Array, noise: StepNoise) -> None:
        """One sensor step from ``time (N,)``: move, measure, track, account, score."""
        for index, platform in enumerate(self.realised.platforms):
            moved = platform.move(self.platform_states[index], self._set_points[index], self.scenario.episode.period)
            self.platform_states[index][...] = moved
        self._move_emitter(time, noise)

        scene = self.scene()
        reported = self.reported_poses(scene.poses, noise)
        measurement, self.detected = self.measure(scene, noise)
        self.track.predict(time)
        self.track.update(measurement, reported, self.detected)
        self._restart_where_broken(measurement, reported)

        self.information.advance()
        self._inform(scene, self.detected, noise)
        self._score(scene)

    def noise_at(self, columns: IntArray | slice = slice(None)) -> StepNoise:
        """The noise of the sensor step that ends now, in some environments; that of the last one when time is over."""
        return self.noise.at(np.minimum(self.step_count, self.scenario.episode.steps), columns)

    def measure(
        self,
        scene: Scene,
        noise: StepNoise | None = None,
        time: Array | None = None,
        arrival: Arrival = "in time",
    ) -> tuple[Array, BoolArray | None]:
        """The noisy measurement ``(m, k)`` of a true scene, and what of it was detected and comes then (None: all).

        ``noise`` and ``time (k,)`` are those of the environments that the scene shows; all, as they are now, by
        default.
        """
        noise, time = self.noise_at() if noise is None else noise, self.time if time is None else time
        suite = self.models.suite
        measurement, inflation = suite.measure(scene), suite.inflation(noise.fault)
        measurement += suite.noise(noise.measurement if inflation is None else inflation * noise.measurement)
        suite.wrap(measurement)
        return measurement, suite.detected(scene, suite.chances(noise, time, arrival))

    def _move_emitter(self, time: Array, noise: StepNoise) -> None:
        """Where the emitter goes in one period, process noise included."""
        dynamics = self.models.truth.dynamics
        dynamics.advance(self.truth, time)
        dynamics.disturb(self.truth, noise.process)

    def _inform(self, scene: Scene, detected: BoolArray | None, noise: StepNoise) -> None:
        """Account for what the measurement tells at the true geometry; outliers tell as little as they are wide."""
        suite, scene = self.models.suite, self._in_bound_layout(scene)
        jacobian, inflation = suite.jacobian(scene), suite.inflation(noise.fault)
        self.information.absorb(jacobian if inflation is None else jacobian / inflation[:, None], suite, detected)

    def decide(self, action: Array, noise: StepNoise) -> None:
        """Turn an action into set-points, relative to the believed lines of sight."""
        np.minimum(np.maximum(action, -1.0), 1.0, out=self.action)
        emitter = self.track.mean[self.models.tracker.layout.position]
        first = 0
        reported = self.reported_poses(self.poses(), noise)
        for index, (platform, pose) in enumerate(zip(self.realised.platforms, reported, strict=True)):
            part = self.action[first : first + platform.controls]
            first += platform.controls
            if platform.controls:
                offset = emitter - pose.position
                towards = offset / distance(offset)
                self._set_points[index][...] = platform.set_point(self.platform_states[index], part, towards)
        self.reward[...] = 0.0
        self.violated[...] = False
        for total in self.reward_terms.values():
            total[...] = 0.0

    def _score(self, scene: Scene) -> None:
        """Add this step's reward terms to the decision's and keep the flags."""
        self.outcome = self.look(scene)
        for term in self.realised.reward:
            self.reward_terms[term.name] += term.score(self.outcome)
        self.violated |= self.outcome.violated

    def conclude(self) -> None:
        """Average the decision's reward over its sensor steps and raise the flags."""
        for term in self.realised.reward:
            total = self.reward_terms[term.name]
            total /= self.scenario.episode.decision_every
            self.reward += term.weight * total
        self.breached |= self.violated
        self.lost[...] = ~(self.outcome.relative_range_error <= self.scenario.episode.lost_error)

    @property
    def outcome(self) -> Outcome:
        """What the last sensor step came to."""
        if self._outcome is None:
            self._outcome = self.look(self.scene())
        return self._outcome

    @outcome.setter
    def outcome(self, outcome: Outcome | None) -> None:
        self._outcome = outcome

    def bound_scene(self) -> Scene:
        """The true scene in the state of the bound."""
        return self._in_bound_layout(self.scene())

    def _in_bound_layout(self, scene: Scene) -> Scene:
        layout = self.models.bound.layout
        if layout == scene.layout:
            return scene
        return Scene(layout.convert(scene.state, scene.layout), layout, scene.poses)

    def look(self, scene: Scene) -> Outcome:
        """What the true scene and the present belief come to."""
        return Outcome(
            scene=scene,
            own_ship=self.scenario.own_ship,
            commanded=self.scenario.commanded,
            mean=self.track.mean,
            covariance=self.track.covariance,
            layout=self.models.tracker.layout,
            information=self.information,
            action=self.action,
            min_range=self.scenario.episode.min_range,
            last=self.truncated,
        )

    @property
    def terminated(self) -> BoolArray:
        """Lost track or violated range, where the scenario ends episodes early ``(N,)``; a new array."""
        return (self.breached | self.lost) & self.scenario.episode.early_end

    @property
    def truncated(self) -> BoolArray:
        """Time is over ``(N,)``; a new array."""
        return self.step_count >= self.scenario.episode.steps

    @property
    def time(self) -> Array:
        """Seconds since each episode began ``(N,)``."""
        return np.multiply(self.step_count, self.scenario.episode.period)

    @property
    def belief(self) -> Belief:
        """What a policy may know; views of the live state."""
        return self.belief_at(self.time, self.noise_at())

    def belief_at(self, time: Array, noise: StepNoise) -> Belief:
        """What a policy may know at ``time (N,)``, given this instant's navigation errors."""
        episode = self.scenario.episode
        return Belief(
            time=time,
            time_left=episode.duration - time,
            interval=episode.interval,
            period=episode.period,
            mean=self.track.mean,
            covariance=self.track.covariance,
            layout=self.models.tracker.layout,
            poses=self.reported_poses(self.poses(), noise),
            platforms=self.realised.platforms,
            sensors=self.realised.sensors,
            motion=self.realised.forecast_motion,
            own_ship=self.scenario.own_ship,
            min_range=episode.min_range,
            last_action=self.action,
            components=self.track.components,
        )

    def poses(self) -> list[Pose]:
        """The true pose of every platform."""
        return _poses(self.realised.platforms, self.platform_states)

    def reported_poses(self, poses: list[Pose], noise: StepNoise) -> list[Pose]:
        """The pose that every platform reports, given the true ones and this instant's errors."""
        return self._reported(self.realised.platforms, self.platform_states, poses, noise)

    @staticmethod
    def _reported(
        platforms: Sequence[Platform], states: Sequence[Array], poses: Sequence[Pose], noise: StepNoise
    ) -> list[Pose]:
        """The poses that platforms report as they stand."""
        return [
            platform.reported_pose(state, pose, errors)
            for platform, state, pose, errors in zip(platforms, states, poses, noise.navigation, strict=True)
        ]

    def scene(self) -> Scene:
        """The true emitter seen from the true poses."""
        return Scene(self.truth, self.models.truth.layout, self.poses())

    def _evaluated(self, columns: IntArray) -> IntArray:
        """The environments that must be looked at for some to begin anew.

        Matrices that hold random numbers hold those of all environments: then all are evaluated, and some are kept.
        """
        return np.arange(self.environments) if self.models.volatile else columns

    def open(self, columns: IntArray, chance: Opening) -> None:
        """Put everything where the episode begins, take the first look, and build belief and bound from it.

        Args:
            columns: which environments begin anew.
            chance: what happens by chance in those that are evaluated.
        """
        evaluated, kept = self._evaluated(columns), columns if self.models.volatile else slice(None)
        self._randomisation.sample(columns, chance.uniforms[:, kept])
        self.rebuild_models()
        for values in (self.step_count, self.reward, self.violated, self.breached, self.lost):
            values[columns] = 0
        for total in self.reward_terms.values():
            total[columns] = 0.0
        self.action[:, columns] = 0.0

        platforms = [take(platform, evaluated) for platform in self.realised.platforms]
        prior: Prior = take(self.realised.prior, evaluated)
        truth = first_truth(self.realised, self.models, evaluated, chance.nuisances)
        states = [zeros(truth, (1, len(evaluated))) + platform.start(len(evaluated)) for platform in platforms]
        poses = _poses(platforms, states)
        reported = self._reported(platforms, states, poses, chance.first)
        begin = zeros(truth, (len(evaluated),))
        heard = self.measure(Scene(truth, self.models.truth.layout, poses), chance.first, begin)

        look = self._first_look(truth, heard, reported, chance.prior)
        mean, covariance = prior.start(look)
        self.track.start(columns, mean[:, kept], covariance[..., kept], look.pose.position[:, kept])
        layout = self.models.bound.layout
        seen = replace(look, layout=layout, nuisances=self.models.bound_nuisances)
        seen.truth = layout.convert(truth, self.models.truth.layout)
        self.information.start(columns, prior.at_truth(seen)[..., kept])

        self.truth[:, columns] = truth[:, kept]
        for index, state in enumerate(states):
            self.platform_states[index][:, columns] = state[:, kept]
            self._set_points[index][:, columns] = 0.0

    def _restart_where_broken(self, measurement: Array, reported: list[Pose]) -> None:
        """A tracker that went non-finite begins anew from the prior; the restart is counted as a repair."""
        if np.logical_and.reduce(np.isfinite(self.track.nis)):
            return
        columns = np.flatnonzero(~np.isfinite(self.track.nis))
        repairs = self.track.repairs[columns] + 1
        look = self._first_look(self.truth, (measurement, self.detected), reported, self.noise.prior)
        mean, covariance = self.realised.prior.start(look)
        self.track.start(columns, mean[:, columns], covariance[..., columns], look.pose.position[:, columns])
        self.track.repairs[columns] = repairs

    def _first_look(
        self, truth: Array, heard: tuple[Array, BoolArray | None], reported: list[Pose], normals: Array
    ) -> FirstLook:
        """What a tracker's prior is made from; ``heard`` is what :meth:`measure` says."""
        layout = self.models.tracker.layout
        return FirstLook(
            layout=layout,
            truth=layout.convert(truth, self.models.truth.layout),
            measurement=heard[0],
            detected=heard[1],
            suite=self.models.suite,
            poses=reported,
            normals=normals,
            nuisances=self.models.tracker_nuisances,
            carrier=self.realised.prior.carrier_platform(self.scenario.sensors),
        )

    def _build_models(self) -> ScenarioModels:
        return ScenarioModels(self.realised, self._randomisation.random)

    def rebuild_models(self) -> None:
        """Let matrices follow the numbers in force."""
        if self.models.volatile:
            self.models = self._build_models()
            self.track.models, self.information.dynamics = self.models.tracker, self.models.bound.dynamics

    def state_arrays(self) -> dict[str, np.ndarray]:
        """Every array that makes up the state of the batch, by name, batch axis last, live."""
        own = {
            "truth": self.truth,
            "action": self.action,
            "step_count": self.step_count,
            "reward": self.reward,
            "violated": self.violated,
            "breached": self.breached,
            "lost": self.lost,
        }
        arrays = {f"simulation.{name}": values for name, values in own.items()}
        for index, (state, set_point) in enumerate(zip(self.platform_states, self._set_points, strict=True)):
            arrays[f"platform.{index}"], arrays[f"set_point.{index}"] = state, set_point
        parts = {
            "scenario": self._randomisation.state_arrays(),
            "noise": self.noise.state_arrays(),
            "track": self.track.state_arrays(),
            "information": self.information.state_arrays(),
            "reward_terms": self.reward_terms,
        }
        for part, named in parts.items():
            arrays |= {f"{part}.{name}": values for name, values in named.items()}
        return arrays

    def restore(self, arrays: dict[str, np.ndarray], columns: IntArray | slice = slice(None)) -> None:
        """Put back columns of the state saved from :meth:`state_arrays`; models follow the restored numbers."""
        for name, live in self.state_arrays().items():
            live[..., columns] = arrays[name][..., columns]
        self.rebuild_models()
        self.outcome = None


def _poses(platforms: Sequence[Platform], states: Sequence[Array]) -> list[Pose]:
    return [platform.pose(state) for platform, state in zip(platforms, states, strict=True)]
