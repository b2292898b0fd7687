"""The Cramér–Rao bound along a path that the observers have flown or mean to fly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from passloc_env.arrays import Array
from passloc_env.checks import require_exactly, require_shape
from passloc_env.dynamics import Dynamics
from passloc_env.errors import InputError
from passloc_env.information import Information
from passloc_env.platforms import Pose
from passloc_env.sensor_suite import SensorSuite
from passloc_env.sightline import Scene


def cramer_rao_path(
    dynamics: Dynamics,
    suite: SensorSuite,
    start: Array,
    prior: Array,
    path: Sequence[Sequence[Pose]],
    uniforms: Sequence[Array | None] | None = None,
    inflations: Sequence[Array | None] | None = None,
) -> Array:
    """The bound after every measurement of emitters that move as the model says, without process noise.

    The same recursion as inside every simulation (Tichavský, Muravchik & Nehorai 1998), for paths chosen by hand.

    Args:
        dynamics: motion of the emitter, linear; its process noise widens the bound.
        suite: what is heard at every instant.
        start: true states ``(n, N)`` one period before the first instant.
        prior: covariance ``(n, n, N)`` at the start, of the truth.
        path: at each instant, one pose per platform, ``(d, 1 | N)``.
        uniforms: at each instant, one draw per sensor ``(s, 1 | N)``, for sensors that may miss; None where nothing is
            missed by chance. What is hidden or on top of a platform is never measured.
        inflations: at each instant, how many times as wide as usual the error of each scalar is ``(m, 1 | N)``; None
            where there are no outliers.

    Returns:
        Covariances ``(K, n, n, N)``.

    Raises:
        InputError: shapes that do not match, numbers that are not finite.
        TypeError: a motion that is not linear.
    """
    n = dynamics.layout.size
    state = require_shape("start", start, 2, "states and emitters").copy()
    environments = state.shape[1]
    require_exactly("start", state, (n, environments))
    known = require_exactly("prior", prior, (n, n, environments), (n, n, 1))
    draws, widths = _along("uniforms", uniforms, len(path)), _along("inflations", inflations, len(path))
    information = Information(dynamics, environments)
    information.start(np.arange(environments), known)
    time = np.zeros(environments)
    bounds = np.empty((len(path), *information.bound.shape))
    with np.errstate(all="ignore"):
        for instant, (poses, chances, inflation) in enumerate(zip(path, draws, widths, strict=True)):
            dynamics.advance(state, time)
            time += dynamics.period
            scene = Scene(state, dynamics.layout, list(poses))
            information.advance()
            jacobian = suite.jacobian(scene)
            if inflation is not None:
                jacobian /= inflation[:, None]
            information.absorb(jacobian, suite, suite.detected(scene, chances))
            bounds[instant] = information.bound
    return bounds


def _along(name: str, given: Sequence[Array | None] | None, instants: int) -> list[Array | None]:
    """What is given at each instant of a path; InputError when that is not as long as the path."""
    values: list[Array | None] = [None] * instants if given is None else list(given)
    if len(values) != instants:
        raise InputError(f"{name} of {len(values)} instants is not possible: must be {instants}, as the path")
    return values
