"""How targets move, and how trackers believe they do.

A linear motion gives its transition ``F``, known input ``B u`` and process noise ``Q`` for a step; a nonlinear one
gives :meth:`Motion.propagate` alone and trackers go through sigma points. The same classes serve the truth and the
models, so that a matched tracker is matched to the last bit. Shapes end in ``1 | N``; units SI.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passloc_env.angles import sine_cosine, turned
from passloc_env.arrays import Array, Number, numbers, rows, zeros_for
from passloc_env.component import Component
from passloc_env.errors import ScenarioError
from passloc_env.fields import abstract, quantity, vector
from passloc_env.layout import StateLayout
from passloc_env.linalg import inner
from passloc_env.nuisance import Nuisance


@abstract
class Motion(Component):
    """Base of target motions."""

    order: int = 1
    linear: bool = True
    model: bool = True
    """Whether a tracker or bound can use it; a manoeuvre known only to the truth cannot be a model."""
    members: tuple[Motion, ...] = ()
    """The motions that it switches between, for one that is no motion of its own."""

    def check(self, dimension: int) -> None:
        """Raise ScenarioError when the motion does not fit a problem of this dimension."""

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """States of the motion beyond position and its derivatives."""
        return ()

    def layout(self, dimension: int) -> StateLayout:
        """The state this motion needs."""
        return StateLayout(dimension, self.order, tuple(nuisance.name for nuisance in self.nuisances))

    def propagate(self, state: Array, layout: StateLayout, period: float, time: Array) -> Array:
        """The noise-free state ``(n, …, N)`` one period (s) after ``time`` ``(N,)``; a new array."""
        raise AssertionError(f"{type(self).__name__} must define propagate")

    def noise_gain(self, layout: StateLayout, period: float) -> Array:
        """``Γ (n, w, 1|N)``: independent standard normals ``(w, N)`` drive the state through it."""
        raise AssertionError(f"{type(self).__name__} must define noise_gain")


@abstract
class LinearMotion(Motion):
    """Base of motions with a transition matrix."""

    def transition(self, layout: StateLayout, period: float) -> Array:
        """``F (n, n, 1|N)``."""
        raise AssertionError(f"{type(self).__name__} must define transition")

    def known_input(self, layout: StateLayout, period: float) -> Array | None:
        """``B u (n, 1|N)``, or None when there is none."""
        return None


def _taylor(layout: StateLayout, period: float) -> Array:
    """Identity plus the kinematic integrals ``T, T²/2`` between derivatives, ``(n, n, 1)``."""
    matrix = np.eye(layout.size)
    d = layout.dimension
    for step, factor in ((1, period), (2, 0.5 * period * period)):
        for row in range(layout.kinematic.stop - step * d):
            matrix[row, row + step * d] = factor
    return matrix[..., None]


def _drive(layout: StateLayout, columns: list[tuple[Number, ...]], size: int = 1) -> Array:
    """Noise gain whose columns repeat per axis: each tuple holds the gains of position, velocity, (acceleration)."""
    d = layout.dimension
    gain = zeros_for((layout.size, len(columns) * d, size), *(value for column in columns for value in column))
    for c, column in enumerate(columns):
        for derivative, value in enumerate(column):
            for axis in range(d):
                gain[derivative * d + axis, c * d + axis] = value
    return gain


def _absent(noise: Number) -> bool:
    """Whether a noise level is the number zero, so that its columns can be left out for every environment."""
    return isinstance(noise, float) and noise == 0.0


def _held_acceleration(sigma: Number, period: float) -> list[tuple[Number, ...]]:
    """The gain column of a white acceleration held over a step, none when there is no such noise."""
    return [] if _absent(sigma) else [(0.5 * period * period * sigma, period * sigma)]


def _batch_of(*values: Number) -> int:
    """1, or the number of environments when any value is given per environment."""
    return max(np.size(value) for value in values)


@dataclass(frozen=True, kw_only=True)
class ConstantVelocity(LinearMotion):
    """Nearly constant velocity: ``x⁺ = F x + B u + w``.

    ``acceleration_noise`` is a white acceleration held over each step (Q grows with T⁴); ``acceleration_density`` is
    the spectral density q of continuous white acceleration, ``q [[T³/3, T²/2], [T²/2, T]]`` per axis, which does not
    depend on how time is cut into steps (Bar-Shalom, *Estimation with Applications*, 6.2 and 6.3).
    """

    acceleration_noise: Number = quantity(
        "standard deviation of a step's white acceleration", 0.0, unit="m/s²", at_least=0
    )
    acceleration_density: Number = quantity("density of continuous white acceleration", 0.0, unit="m²/s³", at_least=0)
    known_acceleration: tuple[Number, ...] = vector("known constant acceleration by axis", (), unit="m/s²")

    def check(self, dimension: int) -> None:
        """A known acceleration has as many axes as the problem."""
        if len(self.known_acceleration) not in (0, dimension):
            raise ScenarioError(
                "known_acceleration", self.known_acceleration, f"must be empty or have {dimension} axes"
            )

    def transition(self, layout: StateLayout, period: float) -> Array:
        """``F (n, n, 1)``."""
        return _taylor(layout, period)

    def known_input(self, layout: StateLayout, period: float) -> Array | None:
        """``B u (n, 1|N)`` of the known acceleration."""
        if not self.known_acceleration:
            return None
        push = zeros_for((layout.size, _batch_of(*self.known_acceleration)), *self.known_acceleration)
        for axis, value in enumerate(self.known_acceleration):
            push[axis] = 0.5 * period * period * value
            push[layout.dimension + axis] = period * value
        return push

    def noise_gain(self, layout: StateLayout, period: float) -> Array:
        """``Γ (n, 0 … 3d, 1|N)``: held acceleration first, then the two Cholesky columns of the continuous noise."""
        columns = _held_acceleration(self.acceleration_noise, period)
        if not _absent(self.acceleration_density):
            root = np.sqrt(self.acceleration_density)
            columns.append((root * period**1.5 / np.sqrt(3.0), root * np.sqrt(3.0 * period) / 2.0))
            columns.append((0.0, root * np.sqrt(period) / 2.0))
        return _drive(layout, columns, _batch_of(self.acceleration_noise, self.acceleration_density))


@dataclass(frozen=True, kw_only=True)
class ConstantAcceleration(LinearMotion):
    """Nearly constant acceleration, with the acceleration as a state that walks randomly from step to step.

    ``Γ = (T²/2, T, 1)`` per axis (Bar-Shalom, *Estimation with Applications*, 6.3.3).
    """

    order = 2

    acceleration_noise: Number = quantity("random walk of the acceleration per step", 0.0, unit="m/s²", at_least=0)

    def transition(self, layout: StateLayout, period: float) -> Array:
        """``F (n, n, 1)``."""
        return _taylor(layout, period)

    def noise_gain(self, layout: StateLayout, period: float) -> Array:
        """``Γ (n, d, 1|N)``."""
        sigma = self.acceleration_noise
        columns = [(*held, sigma) for held in _held_acceleration(sigma, period)]
        return _drive(layout, columns, _batch_of(sigma))


@dataclass(frozen=True, kw_only=True)
class ReversingAcceleration(Motion):
    """Constant acceleration, held as a state, that changes sign at one instant; exact. Only the truth knows it."""

    order = 2
    model = False

    reversal: Number = quantity("when the acceleration changes sign", unit="s", above=0)

    def propagate(self, state: Array, layout: StateLayout, period: float, time: Array) -> Array:
        """The state ``(n, N)`` one period after ``time``: up to the reversal, and what is left of the step after."""
        before = np.minimum(np.maximum(self.reversal - time, 0.0), period)
        # A billionth of a step of slack: two ways to write one instant differ in their last bits.
        late = time + 1e-9 * period
        turns = (late < self.reversal) & (self.reversal <= late + period)
        moved = _accelerated(state, layout, before)
        moved[layout.acceleration] *= np.where(turns, -1.0, 1.0)
        return _accelerated(moved, layout, period - before)

    def noise_gain(self, layout: StateLayout, period: float) -> Array:
        """No process noise: ``(n, 0, 1)``."""
        return np.zeros((layout.size, 0, 1))


def _accelerated(state: Array, layout: StateLayout, time: Array) -> Array:
    """States ``(n, N)`` after ``time (N,)`` at constant acceleration; a new array."""
    moved = state.copy()
    push = state[layout.acceleration]
    moved[layout.position] += time * (state[layout.velocity] + (0.5 * time) * push)
    moved[layout.velocity] += time * push
    return moved


@dataclass(frozen=True, kw_only=True)
class CoordinatedTurn(LinearMotion):
    """A turn at a known rate about the vertical, exact for any period.

    The rate is a compass rate: positive turns to starboard, ``v̇ = ω (v_north, −v_east)``. Paper conventions with
    counter-clockwise rates negate it. A third axis keeps constant velocity.
    """

    turn_rate: Number = quantity("turn rate, positive to starboard", unit="rad/s")
    acceleration_noise: Number = quantity(
        "standard deviation of a step's white acceleration", 0.0, unit="m/s²", at_least=0
    )

    def transition(self, layout: StateLayout, period: float) -> Array:
        """``F (n, n, 1|N)``."""
        d = layout.dimension
        along, across, cosine, sine = _turn_coefficients(numbers(self.turn_rate), period)
        matrix = np.repeat(_taylor(layout, period), len(along), axis=-1)
        matrix[0, d], matrix[0, d + 1] = along, across
        matrix[1, d], matrix[1, d + 1] = -across, along
        matrix[d, d], matrix[d, d + 1] = cosine, sine
        matrix[d + 1, d], matrix[d + 1, d + 1] = -sine, cosine
        return matrix

    def noise_gain(self, layout: StateLayout, period: float) -> Array:
        """``Γ (n, d, 1|N)``."""
        columns = _held_acceleration(self.acceleration_noise, period)
        return _drive(layout, columns, _batch_of(self.acceleration_noise))


def _turn_coefficients(rate: Array, period: float) -> tuple[Array, Array, Array, Array]:
    """``sin(ωT)/ω, (1 − cos ωT)/ω, cos ωT, sin ωT``, smooth through ω = 0."""
    angle = rate * period
    half = 0.5 * angle
    chord = sinc(half)
    return period * sinc(angle), period * np.sin(half) * chord, np.cos(angle), np.sin(angle)


def sinc(x: Array) -> Array:
    """``sin(x)/x``, 1 at zero: the spherical Bessel function j₀."""
    return _sinc(x, np.sin(x))


def _sinc(x: Array, sine: Array) -> Array:
    still = x == 0.0
    return np.where(still, 1.0, sine / np.where(still, 1.0, x))


def spherical_j1(x: Array) -> Array:
    """``(sin x − x cos x)/x²``, the spherical Bessel function j₁, by its series where the formula cancels."""
    return _spherical_j1(x, np.sin(x), np.cos(x))


def _spherical_j1(x: Array, sine: Array, cosine: Array) -> Array:
    small = np.abs(x) < 0.05
    square = x * x
    tail = 1.0 - square * (1.0 / 28.0) * (1.0 - square * (1.0 / 54.0))
    series = x * (1.0 / 3.0) * (1.0 - square * 0.1 * tail)
    return np.where(small, series, (sine - x * cosine) / np.where(small, 1.0, square))


@dataclass(frozen=True, kw_only=True)
class UnknownTurn(Motion):
    """A coordinated turn whose rate is itself a state that walks randomly; nonlinear."""

    linear = False

    acceleration_noise: Number = quantity(
        "standard deviation of a step's white acceleration", 0.0, unit="m/s²", at_least=0
    )
    turn_rate_noise: Number = quantity("random walk of the turn rate per step", 0.0, unit="rad/s", at_least=0)
    turn_rate_sigma: Number = quantity("prior standard deviation of the turn rate", 0.02, unit="rad/s", above=0)

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The turn rate."""
        return (Nuisance("turn_rate", self.turn_rate_sigma, self.turn_rate_noise, unit="rad/s"),)

    def propagate(self, state: Array, layout: StateLayout, period: float, time: Array) -> Array:
        """The state ``(n, …, N)`` after turning at its own rate for one period."""
        d = layout.dimension
        along, across, cosine, sine = _turn_coefficients(state[layout.nuisance_row("turn_rate")], period)
        moved = state.copy()
        moved[layout.position] += period * state[layout.velocity]
        east, north = state[d], state[d + 1]
        moved[0] = state[0] + along * east + across * north
        moved[1] = state[1] - across * east + along * north
        moved[d] = cosine * east + sine * north
        moved[d + 1] = cosine * north - sine * east
        return moved

    def noise_gain(self, layout: StateLayout, period: float) -> Array:
        """``Γ (n, d, 1|N)`` of the white acceleration; the rate walks like every nuisance."""
        columns = _held_acceleration(self.acceleration_noise, period)
        return _drive(layout, columns, _batch_of(self.acceleration_noise))


@dataclass(frozen=True, kw_only=True)
class Manoeuvre(Motion):
    """Constant velocity broken by one manoeuvre: an acceleration along the track, or a turn, between two instants.

    Within each step the along-track acceleration ``a`` and turn rate ``ω`` are held at their mean over the step, and
    the step is exact: with ``x = ωT/2`` the displacement is
    ``T e^{i(ψ+x)} [(s + aT/2) j₀(x) + i (aT/2) j₁(x)]`` along the mid-step course. Only the truth knows it.
    """

    model = False

    start: Number = quantity("when the manoeuvre starts", unit="s", at_least=0)
    duration: Number = quantity("how long it lasts", unit="s", at_least=0)
    acceleration: Number = quantity("acceleration along the track", 0.0, unit="m/s²")
    turn_rate: Number = quantity("turn rate, positive to starboard", 0.0, unit="rad/s")
    kind: Number = quantity("0 none, 1 acceleration, 2 turn, 3 both", 3.0, at_least=0, at_most=3)

    def propagate(self, state: Array, layout: StateLayout, period: float, time: Array) -> Array:
        """The state ``(n, N)`` one period after ``time``."""
        overlap = np.minimum(time + period, self.start + self.duration) - np.maximum(time, self.start)
        return self._manoeuvred(state, layout, period, np.maximum(overlap, 0.0))

    def _manoeuvred(self, state: Array, layout: StateLayout, period: float, overlap: Array) -> Array:
        """States ``(n, N)`` after a step of which the manoeuvre takes ``overlap (N,)`` seconds."""
        gain = 0.5 * self.acceleration * ((self.kind - 2.0 * np.floor(0.5 * self.kind)) * overlap)
        half = 0.5 * self.turn_rate * (np.greater_equal(self.kind, 2.0) * overlap)

        d = layout.dimension
        velocity = state[d : d + 2]
        speed = np.maximum(np.sqrt(inner(velocity, velocity)), 1e-9)
        sine, cosine = sine_cosine(half)
        middle = turned(velocity * (1.0 / speed), sine, cosine)
        sideways = rows(middle[1], -middle[0])
        along, across = (speed + gain) * _sinc(half, sine), gain * _spherical_j1(half, sine, cosine)
        moved = state.copy()
        moved[:2] += period * (along * middle + across * sideways)
        moved[2:d] += period * state[d + 2 : 2 * d]
        moved[d : d + 2] = (speed + 2.0 * gain) * turned(middle, sine, cosine)
        return moved

    def noise_gain(self, layout: StateLayout, period: float) -> Array:
        """No process noise: ``(n, 0, 1)``."""
        return np.zeros((layout.size, 0, 1))
