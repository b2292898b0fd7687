"""Any FilterPy filter as the tracker inside, one Python object per environment: for small batches and comparison."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from passloc_env.arrays import Array, BoolArray, IntArray
from passloc_env.errors import ScenarioError
from passloc_env.fields import option, part, quantity
from passloc_env.motion import ConstantVelocity, Motion
from passloc_env.platforms import Pose
from passloc_env.sightline import Scene
from passloc_env.tracking.gating import gate_of, gate_probability
from passloc_env.tracking.tracker import Models, Track, Tracker
from passloc_env.tracking.unscented import check_spread


@dataclass(frozen=True, kw_only=True)
class FilterPyTracker(Tracker):
    """A FilterPy filter per environment; FilterPy is imported when the tracker is built.

    Angles need no special functions in the filter: measurement and measurement function are unwrapped around the
    predicted measurement before the filter sees them. What is not used of a measurement is to the filter what it
    expects of every state, and so tells it nothing. To use another filter, derive a component and override
    :meth:`create`; it must have ``x``, ``P``, ``Q``, ``predict()`` and ``update(z, R=…)``, and for a gate the
    innovation ``y`` and its covariance ``S`` of the last update too: an update with what they show to be too unlikely
    is taken back and made again without.
    """

    motion: Motion = part(Motion, "how it believes the emitter moves", ConstantVelocity())
    filter: str = option(
        "FilterPy class",
        "UnscentedKalmanFilter",
        ("UnscentedKalmanFilter", "CubatureKalmanFilter", "ExtendedKalmanFilter"),
    )
    alpha: float = quantity("spread of the sigma points (unscented)", 1.0, above=0, plain=True)
    beta: float = quantity("weight of the centre in the covariance (unscented)", 2.0, plain=True)
    kappa: float = quantity("secondary spread (unscented)", 0.0, plain=True)
    gate: float = gate_probability()

    def create(self, states: int, scalars: int, period: float, calls: FilterCalls) -> Any:
        """A fresh filter for ``states`` states and ``scalars`` measured scalars.

        Args:
            states: n.
            scalars: m.
            period: seconds per step.
            calls: ``transition(x, dt)``, ``measure(x)`` and ``jacobian(x)`` of the environment at this step.
        """
        from filterpy import kalman

        if self.filter == "UnscentedKalmanFilter":
            check_spread(self.alpha, self.kappa, states)
            points = kalman.MerweScaledSigmaPoints(states, self.alpha, self.beta, self.kappa)
            return kalman.UnscentedKalmanFilter(states, scalars, period, calls.measure, calls.transition, points)
        if self.filter == "CubatureKalmanFilter":
            return _cubature(kalman, states, scalars, period, calls)
        return _extended(kalman, states, scalars, calls)

    def build(self, models: Models, environments: int) -> FilterPyTrack:
        """The running filters; ScenarioError when there is a gate, but a filter does not say what it expects."""
        return FilterPyTrack(self, models, environments)


@dataclass
class FilterCalls:
    """The models of one environment as plain functions of vectors."""

    transition: Callable[[Array, float], Array]
    measure: Callable[[Array], Array]
    jacobian: Callable[[Array], Array]
    transition_matrix: Array | None


def _cubature(kalman: Any, states: int, scalars: int, period: float, calls: FilterCalls) -> Any:
    """FilterPy's cubature filter, which wants its measurement as a column."""

    class Cubature(kalman.CubatureKalmanFilter):  # type: ignore[misc]
        def update(self, z: Array, R: Array) -> None:
            super().update(z[:, None], R=R)

    return Cubature(states, scalars, period, calls.measure, calls.transition)


def _extended(kalman: Any, states: int, scalars: int, calls: FilterCalls) -> Any:
    """FilterPy's extended filter behind the interface of the others."""

    class Extended(kalman.ExtendedKalmanFilter):  # type: ignore[misc]
        def update(self, z: Array, R: Array) -> None:
            super().update(z, calls.jacobian, calls.measure, R=R)

    if calls.transition_matrix is None:
        raise TypeError("ExtendedKalmanFilter needs a linear motion")
    extended = Extended(states, scalars)
    extended.F = calls.transition_matrix
    return extended


class FilterPyTrack(Track):
    """The filters of a batch; a filter that fails in NumPy's linear algebra is flagged by an infinite ``nis``."""

    def __init__(self, tracker: FilterPyTracker, models: Models, environments: int) -> None:
        super().__init__(models, environments)
        self._tracker = tracker
        self._time: Array = np.zeros(environments)
        self._poses: list[Pose] = []
        self._reference: Array = np.zeros((models.suite.size, environments))
        self._used: BoolArray = np.ones((models.suite.size, environments), bool)
        self._filters = [self._create(column) for column in range(environments)]
        self.gate = gate_of(tracker.gate, models.suite)
        if self.gate is not None and not all(map(_says_what_it_expects, self._filters)):
            filter_ = type(self._filters[0]).__name__
            raise ScenarioError("gate", tracker.gate, f"must be 0: {filter_} has no innovation y with covariance S")

    def _create(self, column: int, still: bool = False) -> Any:
        """A fresh filter for an environment; for one that is still, time stands still."""
        layout, suite, dynamics = self.models.layout, self.models.suite, self.models.dynamics
        matrix = _of(dynamics.transition.matrix, column) if dynamics.linear else None
        calls = FilterCalls(
            transition=lambda x, period: x if still else self._moved(x, column),
            measure=lambda x: self._measured(x, column),
            jacobian=lambda x: self._jacobian(x, column),
            transition_matrix=np.eye(layout.size) if still else matrix,
        )
        return self._tracker.create(layout.size, suite.size, dynamics.period, calls)

    def start(self, columns: IntArray, mean: Array, covariance: Array, origin: Array | None = None) -> None:
        """Begin anew, with fresh filters, in the given environments."""
        super().start(columns, mean, covariance, origin)
        for column in columns:
            self._filters[column] = self._create(int(column))

    def predict(self, time: Array) -> None:
        """``filter.predict()`` in every environment."""
        self._time = time
        noise = self.models.dynamics.process_noise
        self.nis[...] = 0.0
        for column, filter_ in enumerate(self._filters):
            filter_.x, filter_.P = self.mean[:, column].copy(), self.covariance[..., column].copy()
            filter_.Q = _of(noise, column)
            self._attempt(column, filter_, filter_.predict)

    def update(self, measurement: Array, poses: list[Pose], detected: BoolArray | None = None) -> None:
        """``filter.update(z)`` in every environment whose filter is sound; once more where the gate refuses some."""
        self._correct(np.flatnonzero(np.isfinite(self.nis)), measurement, poses, detected)

    def catch_up(self, measurement: Array, poses: list[Pose], late: BoolArray | None) -> None:
        """Likewise, by filters that have predicted over no time: FilterPy's correct nothing but their predictions."""
        moving = list(self._filters)
        columns = np.flatnonzero(np.ones(len(moving), bool) if late is None else late.any(axis=0))
        for column in columns.tolist():
            self._filters[column] = filter_ = self._create(column, still=True)
            filter_.x, filter_.P = self.mean[:, column].copy(), self.covariance[..., column].copy()
            filter_.Q = np.zeros(filter_.P.shape)
            self._attempt(column, filter_, filter_.predict)
        self._correct(columns, measurement, poses, late)
        self._filters = moving

    def _correct(self, columns: IntArray, measurement: Array, poses: list[Pose], detected: BoolArray | None) -> None:
        """Absorb what was ``detected (m, N)`` in some environments, once more where the gate refuses some of it."""
        suite = self.models.suite
        self._poses = poses
        self._reference = suite.measure(self._scene(self.mean))
        unwrapped = self._reference + suite.difference(measurement, self._reference)
        if self.gate is None:
            self._absorb(columns, unwrapped, detected)
            return
        foreseen = [(np.copy(filter_.x), np.copy(filter_.P)) for filter_ in self._filters]
        self._absorb(columns, unwrapped, detected)
        before = self.gated.copy()
        used = self.admit(*self._innovations(), detected)
        refused = np.flatnonzero(self.gated > before)
        for column in refused:
            self._filters[column].x, self._filters[column].P = foreseen[column]
        self._absorb(refused, unwrapped, used)

    def _absorb(self, columns: IntArray, unwrapped: Array, used: BoolArray | None) -> None:
        """``filter.update(z)`` in some environments, with what is ``used (m, N)`` of it; None means all."""
        self._used = np.ones_like(unwrapped, bool) if used is None else used
        heard = np.where(self._used, unwrapped, self._reference)
        for column in columns:
            filter_, noise = self._filters[column], _of(self.models.suite.noise_covariance, column)
            self._attempt(column, filter_, functools.partial(filter_.update, heard[:, column], R=noise))
            self._judge(column, filter_)

    def _innovations(self) -> tuple[Array, Array]:
        """What was not expected ``(m, N)`` and its covariance ``(m, m, N)``; NaN where a filter is broken."""
        scalars, size = self._reference.shape
        innovation, covariance = np.full((scalars, size), np.nan), np.full((scalars, scalars, size), np.nan)
        for column in np.flatnonzero(np.isfinite(self.nis)):
            innovation[:, column] = np.ravel(self._filters[column].y)
            covariance[..., column] = self._filters[column].S
        return innovation, covariance

    def _attempt(self, column: int, filter_: Any, action: Callable[[], None]) -> None:
        """Run a filter's step and read its belief back."""
        try:
            action()
        except (np.linalg.LinAlgError, ValueError):
            self.nis[column] = np.inf
            return
        self.mean[:, column] = np.asarray(filter_.x).ravel()
        self.covariance[..., column] = 0.5 * (filter_.P + filter_.P.T)

    def _judge(self, column: int, filter_: Any) -> None:
        """Normalised innovation squared of a filter that says how surprised it was; a broken one stays infinite."""
        if not np.isfinite(self.mean[:, column]).all() or not np.isfinite(self.covariance[..., column]).all():
            self.nis[column] = np.inf
        elif np.isfinite(self.nis[column]) and _says_what_it_expects(filter_):
            innovation = np.asarray(filter_.y).ravel()
            try:
                self.nis[column] = innovation @ np.linalg.solve(filter_.S, innovation)
            except np.linalg.LinAlgError:
                self.nis[column] = np.inf

    def _moved(self, x: Array, column: int) -> Array:
        return self.models.dynamics.mean(self._everywhere(x), self._time)[:, column]

    def _everywhere(self, x: Array) -> Array:
        """One state for all environments, so that each reads its own column of the batched models."""
        return np.repeat(np.asarray(x, float).reshape(-1, 1), self.mean.shape[1], axis=1)

    def _scene(self, states: Array) -> Scene:
        return Scene(states, self.models.layout, self._poses)

    def _measured(self, x: Array, column: int) -> Array:
        predicted = self.models.suite.measure(self._scene(self._everywhere(x)))
        unwrapped = self._reference + self.models.suite.difference(predicted, self._reference)
        return np.where(self._used, unwrapped, self._reference)[:, column]

    def _jacobian(self, x: Array, column: int) -> Array:
        rows = self.models.suite.jacobian(self._scene(self._everywhere(x)))
        return np.where(self._used[:, None], rows, 0.0)[..., column]


def _says_what_it_expects(filter_: Any) -> bool:
    """Whether a filter keeps its last innovation and its covariance."""
    return hasattr(filter_, "y") and hasattr(filter_, "S")


def _of(matrix: Array, column: int) -> Array:
    """The matrix of one environment out of ``(m, n, 1|N)``."""
    return np.array(matrix[..., min(column, matrix.shape[-1] - 1)])
