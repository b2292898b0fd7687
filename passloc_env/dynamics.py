"""A motion made ready to be run: matrices built once for one layout and one period."""

from __future__ import annotations

import copy

import numpy as np

from passloc_env.arrays import Array, zeros_for
from passloc_env.layout import StateLayout
from passloc_env.linalg import LinearMap, matmul, matvec, row_gram, spaced
from passloc_env.motion import LinearMotion, Motion
from passloc_env.nuisance import Nuisance


class Dynamics:
    """The step of a motion, with nuisance states that walk randomly beside it.

    Args:
        motion: a realised motion (numbers or arrays ``(N,)``, no distributions).
        layout: the state it runs on: the motion's own rows, then nuisances.
        period: seconds per step.
        nuisances: the nuisance states of the layout.
        dense: matrices differ between environments in ways their zeros do not show.

    Raises:
        TypeError: from :attr:`transition` and :meth:`spread` when the motion is not linear.
    """

    def __init__(
        self,
        motion: Motion,
        layout: StateLayout,
        period: float,
        nuisances: tuple[Nuisance, ...] = (),
        dense: bool = False,
    ) -> None:
        self.motion, self.layout, self.period, self._dense = motion, layout, period, dense
        self._map: LinearMap | None = None
        self._input: Array | None = None
        if isinstance(motion, LinearMotion):
            self._map = LinearMap(motion.transition(layout, period), dense=dense)
            self._input = motion.known_input(layout, period)
        self._driven_by(_with_walks(motion.noise_gain(layout, period), layout, nuisances))

    def _driven_by(self, gain: Array) -> None:
        """Take ``Γ (n, w, 1|N)`` as the gain of the process noise."""
        self.noise_size = gain.shape[1]
        self._drive = LinearMap(gain, dense=self._dense)
        self.process_noise: Array = row_gram(gain)

    @property
    def linear(self) -> bool:
        """Whether the motion has a transition matrix."""
        return self._map is not None

    @property
    def noise_gain(self) -> Array:
        """``Γ (n, w, 1|N)``, which drives the state by ``w`` standard normals: ``Γ Γᵀ`` is the process noise."""
        return self._drive.matrix

    @property
    def transition(self) -> LinearMap:
        """The transition matrix ``F``, ready to be applied; TypeError when the motion has none."""
        if self._map is None:
            raise TypeError(f"{type(self.motion).__name__} is not linear: it has no transition matrix")
        return self._map

    def repeated(self, steps: int) -> Dynamics:
        """Some steps as one: ``F^k``, with the input and the noise of all of them; TypeError when not linear."""
        transition, push, gain = self.transition.matrix, self._input, self._drive.matrix
        matrix, pushed, gains = transition, push, [gain]
        for _ in range(steps - 1):
            gains.append(matmul(transition, gains[-1]))
            matrix = matmul(transition, matrix)
            if push is not None and pushed is not None:
                pushed = matvec(transition, pushed) + push
        longer = copy.copy(self)
        longer.period = steps * self.period
        longer._map, longer._input = LinearMap(matrix, dense=self._dense), pushed
        batch = max(one.shape[-1] for one in gains)
        longer._driven_by(np.concatenate([np.broadcast_to(g, (*g.shape[:2], batch)) for g in gains], axis=1))
        return longer

    def advance(self, state: Array, time: Array) -> None:
        """Move states ``(n, …, N)`` from ``time (N,)`` by one noise-free period, in place."""
        if self._map is None:
            state[...] = self.motion.propagate(state, self.layout, self.period, time)
            return
        self._map.apply(state)
        if self._input is not None:
            state += spaced(self._input, state.ndim)

    def mean(self, states: Array, time: Array) -> Array:
        """The noise-free states ``(n, …, N)`` one period after ``time (N,)``; a new array."""
        if self._map is None:
            return self.motion.propagate(states, self.layout, self.period, time)
        moved = self._map(states)
        if self._input is not None:
            moved += spaced(self._input, moved.ndim)
        return moved

    def spread(self, covariance: Array) -> None:
        """``P ← F P Fᵀ + Q`` for ``(n, n, …, N)``, in place."""
        self.transition.congruence(covariance)
        if self.noise_size:
            covariance += spaced(self.process_noise, covariance.ndim)

    def disturb(self, state: Array, normals: Array) -> None:
        """Add process noise to ``state (n, N)`` in place, from standard normals ``(w, N)``."""
        if self.noise_size:
            state += self._drive(normals)


def _with_walks(gain: Array, layout: StateLayout, nuisances: tuple[Nuisance, ...]) -> Array:
    """The noise gain with one column per walking nuisance appended."""
    columns = [gain]
    for nuisance in nuisances:
        if isinstance(nuisance.walk, float) and nuisance.walk == 0.0:
            continue
        column = zeros_for((layout.size, 1, np.size(nuisance.walk)), nuisance.walk)
        column[layout.nuisance_row(nuisance.name), 0] = nuisance.walk
        columns.append(column)
    batch = max(column.shape[-1] for column in columns)
    return np.concatenate([np.broadcast_to(c, (*c.shape[:2], batch)) for c in columns], axis=1)
