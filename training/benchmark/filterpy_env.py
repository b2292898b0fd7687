"""The peer: the same problem as passloc's own environment, one at a time, written by hand around FilterPy.

This is what a competent user writes: FilterPy's unscented filter, small NumPy matrices, plain floats for the rest. It
shares only scenario and spaces with :mod:`passloc_env`, so it serves twice: to compare speed, and as an independent
second opinion on every reward and observation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np

from passloc_env import Scenario
from passloc_env.arrays import Array
from passloc_env.belief import OBSERVATION_LIMIT
from passloc_env.motion import ConstantAcceleration
from passloc_env.platforms import TurnLimitedPlatform
from passloc_env.rewards import KeepOut
from passloc_env.scenarios import find
from passloc_env.spaces import action_space, observation_space
from passloc_env.tracking import RangePrior
from training.benchmark.peer_tracking import (
    BoundRecursion,
    accelerated,
    build_filter,
    doppler_scale,
    measurement_noise,
    prior_covariance,
)
from training.benchmark.peer_world import Draw, Emitter, OwnShip, check, draw, wrap


class FilterPyEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """One localisation problem around FilterPy's UKF: spaces, rewards and episode ends of ``LocalisationEnv``.

    ``reset(options={"episode": Draw(…)})`` plays a given episode instead of drawing one.

    Args:
        scenario: ``BearingDoppler``, ``BearingsOnly``, or another with the same kinds of components.

    Raises:
        ScenarioError: a scenario with components that the peer was not written for.
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(self, scenario: str | Mapping[str, Any] | Scenario = "BearingDoppler") -> None:
        self.scenario = find(scenario)
        check(self.scenario)
        self.observation_space, self.action_space = observation_space(self.scenario), action_space(self.scenario)
        own = self.scenario.platforms[0]
        assert isinstance(own, TurnLimitedPlatform)
        self._max_turn_rate = float(own.max_turn_rate)
        accelerates = isinstance(self.scenario.tracker.motion, ConstantAcceleration)
        self._states = 6 if accelerates else 4
        self._filter = build_filter(self.scenario, accelerated if accelerates else None, self._states)
        self._bound = BoundRecursion(self.scenario)
        self._sigmas: list[float] = np.sqrt(np.diag(measurement_noise(self.scenario))).tolist()
        self._shift = doppler_scale(self.scenario)
        self._weights = {term.name: term.weight for term in self.scenario.reward}
        self._margin = next(term.margin for term in self.scenario.reward if isinstance(term, KeepOut))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin a new episode; observation ``(f,)`` and info."""
        super().reset(seed=seed)
        self._draw: Draw = (options or {}).get("episode") or draw(self.scenario, self.np_random)
        self._emitter = Emitter(self._draw)
        self._own = OwnShip(self._draw, self._max_turn_rate)
        self._step_count, self._action, self._breached = 0, 0.0, False
        self._start_tracking()
        return self._observe(), {"reward_terms": dict.fromkeys(self._weights, 0.0), "violated": False}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One decision: ``action (1,)``, clipped to [-1, 1]."""
        self._action = min(1.0, max(-1.0, float(action[0])))
        mean = self._filter.x
        towards = math.atan2(mean[0] - self._own.east, mean[1] - self._own.north)
        self._own.set_point = wrap(towards + math.pi * self._action)

        episode = self.scenario.episode
        totals = dict.fromkeys(self._weights, 0.0)
        violated, error = False, math.inf
        for _ in range(episode.decision_every):
            distance, error, terms = self._advance()
            violated |= distance < episode.min_range
            for name, term in terms.items():
                totals[name] += term / episode.decision_every
        self._breached |= violated

        reward = sum(self._weights[name] * total for name, total in totals.items())
        lost = not error <= episode.lost_error
        terminated = episode.early_end and (self._breached or lost)
        truncated = self._step_count >= episode.steps
        return self._observe(), reward, terminated, truncated, {"reward_terms": totals, "violated": violated}

    def _start_tracking(self) -> None:
        """Filter and bound from the first bearing."""
        prior = self.scenario.prior
        assert isinstance(prior, RangePrior)
        true_bearing = math.atan2(self._emitter.east, self._emitter.north)
        bearing = true_bearing + self._sigmas[0] * float(self._draw.noise[0, 0])
        guess = prior.range
        self._filter.x = np.zeros(self._states)
        self._filter.x[:2] = guess * math.sin(bearing), guess * math.cos(bearing)
        self._filter.P = prior.acceleration_sigma**2 * np.eye(self._states)
        self._filter.P[:4, :4] = prior_covariance(prior, bearing, guess * self._sigmas[0])
        self._bound.start(prior_covariance(prior, true_bearing, self._draw.range * self._sigmas[0]))

    def _advance(self) -> tuple[float, float, dict[str, float]]:
        """One sensor step: true range (m), relative range error, reward terms."""
        period = self.scenario.episode.period
        self._own.move(period)
        self._emitter.move(self._step_count * period, period)
        self._step_count += 1

        x, y = self._emitter.east - self._own.east, self._emitter.north - self._own.north
        distance = max(math.hypot(x, y), 1e-3)
        own_east, own_north = self._own.velocity
        v_east, v_north = self._emitter.velocity
        v_east, v_north = v_east - own_east, v_north - own_north
        self._track(x, y, (x * v_east + y * v_north) / distance)
        self._bound.step(self._jacobian(x, y, v_east, v_north, distance))

        mean = self._filter.x
        error = math.hypot(mean[0] - self._emitter.east, mean[1] - self._emitter.north) / distance
        return distance, error, self._score(x / distance, y / distance, distance, error)

    def _track(self, x: float, y: float, range_rate: float) -> None:
        """Measure the emitter at ``(x, y)`` from the own ship, and let the filter predict and update."""
        noise = self._draw.noise[self._step_count].tolist()
        bearing = math.atan2(x, y) + self._sigmas[0] * noise[0]
        self._filter.predict()
        mean = self._filter.x
        reference = math.atan2(mean[0] - self._own.east, mean[1] - self._own.north)
        measurement = [wrap(bearing - reference)]
        if self._shift:
            measurement.append(self._shift * range_rate + self._sigmas[1] * noise[1])
        self._filter.update(np.array(measurement), own=self._own, reference=reference)

    def _jacobian(self, x: float, y: float, v_east: float, v_north: float, distance: float) -> Array:
        """``H (m, 4)`` at the truth, from relative position and velocity."""
        square = distance * distance
        rows = [[y / square, -x / square, 0.0, 0.0]]
        if self._shift:
            east, north = x / distance, y / distance
            rate = east * v_east + north * v_north
            scale = self._shift / distance
            position = [scale * (v_east - rate * east), scale * (v_north - rate * north)]
            rows.append([*position, self._shift * east, self._shift * north])
        return np.array(rows)

    def _score(self, east: float, north: float, distance: float, error: float) -> dict[str, float]:
        """The unweighted reward terms along the true line of sight ``(east, north)``."""
        bound = self._bound.covariance
        variance = east * east * bound[0, 0] + 2.0 * east * north * bound[0, 1] + north * north * bound[1, 1]
        keep_out = 0.0
        if self.scenario.episode.min_range:
            depth = (1.0 + self._margin - distance / self.scenario.episode.min_range) / self._margin
            keep_out = -min(1.0, max(0.0, depth))
        return {
            "range_bound": -math.log(math.sqrt(variance) / distance),
            "gram_gain": self._bound.gram_gain,
            "tracking_error": -min(error, 1.0),
            "keep_out": keep_out,
        }

    def _observe(self) -> np.ndarray:
        """The features ``(f,)`` of the belief, in the frame of its own line of sight."""
        scales, episode = self.scenario.observation, self.scenario.episode
        mean, own = self._filter.x, self._own
        x, y = mean[0] - own.east, mean[1] - own.north
        distance = max(math.hypot(x, y), 1e-3)
        axes = np.array([[x, y], [y, -x]]) / distance
        rotation = np.zeros((self._states, self._states))
        for first in range(0, self._states, 2):
            rotation[first : first + 2, first : first + 2] = axes
        covariance = rotation @ self._filter.P @ rotation.T
        sigma = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        correlation = covariance / np.outer(sigma, sigma)
        units = np.repeat([distance, scales.speed_scale, scales.acceleration_scale], 2)[: self._states]
        features = np.concatenate(
            [
                [math.log(distance / scales.range_scale)],
                axes @ own.velocity / scales.speed_scale,
                axes @ mean[2:4] / scales.speed_scale,
                np.log(sigma / units),
                correlation[np.tril_indices(self._states, -1)],
                [1.0 - self._step_count / episode.steps, self._action],
            ]
        )
        np.clip(features, -OBSERVATION_LIMIT, OBSERVATION_LIMIT, out=features)
        features[np.isnan(features)] = 0.0
        return features.astype(np.float32)
