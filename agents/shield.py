"""A shield: whatever a policy wants, the observer keeps a way out.

A learned policy weighs the danger of coming too close against what it learns there; a few times in a hundred it loses.
The shield lets an action through when, after it has been flown until the next decision, some heading still leads away
such that the emitter, as it is believed to move, never comes closer than ``min_range`` by so many standard deviations.
Only where no way out is left is the action replaced, by the heading that keeps the most clearance. The belief is all
that it knows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.policy import Policy
from passloc_env.angles import bearing_of, direction
from passloc_env.arrays import Array, IntArray, Number
from passloc_env.belief import Belief
from passloc_env.linalg import diagonal, inner, matvec, transpose
from passloc_env.platforms import PlanarPose, TurnLimitedPlatform
from passloc_env.randomisation import take
from passloc_env.sightline import distance


@dataclass(frozen=True)
class Shield:
    """Keeps turn-limited platforms away from the emitter, as far as the belief tells.

    Args:
        sigmas: standard deviations of the forecast range that must lie between it and ``min_range``.
        decisions: how far ahead a way out must stay open, in decisions.
        headings: how many ways out are looked at, spread evenly, the first one straight away from the emitter.
    """

    sigmas: float = 1.5
    decisions: int = 10
    headings: int = 12

    def guard(self, belief: Belief, actions: np.ndarray) -> np.ndarray:
        """The actions ``(N, a)``, replaced where they leave no way out; a new array."""
        guarded = np.array(actions, float)
        if belief.min_range > 0.0:
            # A belief may be beyond all sense; what it says about clearance is then no number, and nothing is replaced.
            with np.errstate(all="ignore"):
                self._guard_all(belief, guarded)
        return guarded

    def _guard_all(self, belief: Belief, actions: Array) -> None:
        """Replace the actions ``(N, a)`` of every turn-limited platform in place."""
        threat = _Threat.believed(belief, self.sigmas)
        column = 0
        for platform, pose in zip(belief.platforms, belief.poses, strict=True):
            if isinstance(platform, TurnLimitedPlatform) and isinstance(pose, PlanarPose):
                self._guard_one(_Helm.of(platform, pose, threat, belief.interval), actions[:, column])
            column += platform.controls

    def _guard_one(self, helm: _Helm, action: Array) -> None:
        """Replace one platform's actions ``(N,)`` in place."""
        worst = helm.clearance_at_worst((1 + self.decisions) * helm.interval)
        # What is not finite is for the environment to refuse.
        near = np.flatnonzero((worst < 0.0) & np.isfinite(action))
        if len(near):
            wanted = action[near]
            self._replace(helm.take(near), wanted)
            action[near] = wanted

    def _replace(self, helm: _Helm, action: Array) -> None:
        """The same, of environments whose emitter may come too close."""
        flown, clearance = helm.fly(helm.state, np.clip(action, -1.0, 1.0), 0)
        # Straight away is nearly always a way out: the other headings are looked at where it is none.
        straight = np.minimum(clearance, self._flee(helm, flown, 0.0, 1))
        doubtful = np.flatnonzero(straight < 0.0)
        if not len(doubtful):
            return
        helm, flown, clearance = helm.take(doubtful), flown[:, doubtful], clearance[doubtful]
        trapped = np.flatnonzero(np.minimum(clearance, self._ways_out(helm, flown, 1).max(axis=0)) < 0.0)
        if len(trapped):
            helm = helm.take(trapped)
            best = self._turns[np.argmax(self._ways_out(helm, helm.state, 0), axis=0)]
            action[doubtful[trapped]] = helm.action_away(helm.state, best)

    @property
    def _turns(self) -> Array:
        """The ways out ``(h,)``, each so far to starboard of straight away, rad."""
        return 2.0 * math.pi / self.headings * np.arange(self.headings, dtype=float)

    def _ways_out(self, helm: _Helm, state: Array, decision: int) -> Array:
        """The least clearance ``(h, N)`` on each way out; all of them are flown side by side."""
        environments = state.shape[1]
        columns = np.tile(np.arange(environments), self.headings)
        turns = np.repeat(self._turns, environments)
        return self._flee(helm.take(columns), state[:, columns], turns, decision).reshape(self.headings, environments)

    def _flee(self, helm: _Helm, state: Array, turn: Number, decision: int) -> Array:
        """The least clearance ``(N,)`` on a heading so far to starboard of straight away, flown from a decision on."""
        least = np.full(state.shape[1], np.inf)
        for later in range(decision, decision + self.decisions):
            state, clearance = helm.fly(state, helm.action_away(state, turn), later)
            least = np.minimum(least, clearance)
        return least


@dataclass
class _Threat:
    """The believed emitter, ``(N,)`` at the end of every axis.

    Attributes:
        position, velocity: ``(d, N)``; spread, drift, flow: the blocks of the covariance that tell how the position's
            grows, ``P(t) = spread + t (drift + driftᵀ) + t² flow``.
        reach: the range that must be kept, m; sigmas: the standard deviations beyond it.
    """

    position: Array
    velocity: Array
    spread: Array
    drift: Array
    flow: Array
    reach: float
    sigmas: float

    @classmethod
    def believed(cls, belief: Belief, sigmas: float) -> _Threat:
        """The emitter of a belief, going straight on."""
        place, going = belief.layout.position, belief.layout.velocity
        covariance = belief.covariance
        return cls(
            belief.mean[place],
            belief.mean[going],
            covariance[place, place],
            covariance[place, going],
            covariance[going, going],
            belief.min_range,
            sigmas,
        )

    def take(self, columns: IntArray) -> _Threat:
        """Some of the environments."""
        position, velocity = self.position[:, columns], self.velocity[:, columns]
        blocks = (block[..., columns] for block in (self.spread, self.drift, self.flow))
        spread, drift, flow = blocks
        return _Threat(position, velocity, spread, drift, flow, self.reach, self.sigmas)

    def largest_variance(self, time: float) -> Array:
        """A variance that the position does not exceed in any direction until a time ``(N,)``, m²."""
        trace = diagonal(self.spread).sum(axis=0) + time * time * diagonal(self.flow).sum(axis=0)
        largest: Array = trace + 2.0 * time * np.abs(diagonal(self.drift)).sum(axis=0)
        return largest

    def clearance(self, place: Array, time: float) -> Array:
        """By how much the range from ``place (d, N)``, less its deviations, exceeds what must be kept ``(N,)``, m."""
        offset = self.position + time * self.velocity - place
        away = distance(offset)
        covariance = self.spread + time * (self.drift + transpose(self.drift)) + time * time * self.flow
        towards = offset / away
        variance = inner(towards, matvec(covariance, towards))
        clearance: Array = away - self.sigmas * np.sqrt(np.maximum(variance, 0.0)) - self.reach
        return clearance


@dataclass
class _Helm:
    """One platform and what threatens it.

    Attributes:
        state: of the platform ``(6, N)``, as :meth:`TurnLimitedPlatform.start` builds it.
        towards: unit vector to the believed emitter ``(2, N)``.
    """

    platform: TurnLimitedPlatform
    threat: _Threat
    interval: float
    state: Array
    towards: Array

    @classmethod
    def of(cls, platform: TurnLimitedPlatform, pose: PlanarPose, threat: _Threat, interval: float) -> _Helm:
        """The helm of a platform at a pose."""
        offset = threat.position - pose.position
        state = np.concatenate([pose.position, [pose.heading, pose.turn_rate], direction(pose.heading)])
        return cls(platform, threat, interval, state, offset / distance(offset))

    def take(self, columns: IntArray) -> _Helm:
        """Some of the environments."""
        platform, threat = take(self.platform, columns), self.threat.take(columns)
        return _Helm(platform, threat, self.interval, self.state[:, columns], self.towards[:, columns])

    def fly(self, state: Array, action: Array, decision: int) -> tuple[Array, Array]:
        """The state after one decision and the clearance then; actions ``(N,)`` count from the present bearing."""
        moved = self.platform.move(state, self.platform.set_point(state, action[None], self.towards), self.interval)
        return moved, self.threat.clearance(moved[:2], (decision + 1) * self.interval)

    def clearance_at_worst(self, time: float) -> Array:
        """A clearance ``(N,)`` below which no course goes: both straight at each other for a time, s."""
        threat, speed = self.threat, self.platform.speed
        emitter = np.sqrt(inner(threat.velocity, threat.velocity))
        furthest = np.sqrt(np.maximum(threat.largest_variance(time), 0.0))
        offset = threat.position - self.state[:2]
        closest: Array = distance(offset) - (speed + emitter) * time - threat.sigmas * furthest - threat.reach
        return closest

    def action_away(self, state: Array, turn: Number) -> Array:
        """The action ``(N,)`` towards the heading that is so far to starboard of straight away, rad."""
        bearing = bearing_of(self.towards)
        return self.platform.action_towards(bearing + math.pi + turn, state[2], bearing, self.interval)


@dataclass(frozen=True)
class Shielded:
    """A policy behind a shield."""

    policy: Policy
    shield: Shield

    @property
    def name(self) -> str:
        """The policy's name, and that it is shielded."""
        return f"{self.policy.name}, shielded"

    @property
    def overrides(self) -> Mapping[str, Any]:
        """The policy's own."""
        return self.policy.overrides

    def act(self, observation: np.ndarray, belief: Belief, rng: np.random.Generator) -> np.ndarray:
        """The policy's actions where they leave a way out."""
        return self.shield.guard(belief, self.policy.act(observation, belief, rng))
