"""The Cramér–Rao bound along a path that the observers have flown or mean to fly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from passloc_env.arrays import Array
from passloc_env.dynamics import Dynamics
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
) -> Array:
    """The bound after every measurement of emitters that move as the model says, without process noise.

    The same recursion as inside every simulation (Tichavský, Muravchik & Nehorai 1998), for paths chosen by hand.

    Args:
        dynamics: motion of the emitter, linear; its process noise widens the bound.
        suite: what is heard at every instant.
        start: true states ``(n, N)`` one period before the first instant.
        prior: covariance ``(n, n, N)`` at the start, of the truth.
        path: at each instant, one pose per platform, ``(d, 1 | N)``.

    Returns:
        Covariances ``(K, n, n, N)``.

    Raises:
        TypeError: a motion that is not linear.
    """
    environments = start.shape[1]
    information = Information(dynamics, environments)
    information.start(np.arange(environments), prior)
    state, time = start.copy(), np.zeros(environments)
    bounds = np.empty((len(path), *information.bound.shape))
    with np.errstate(all="ignore"):
        for instant, poses in enumerate(path):
            dynamics.advance(state, time)
            time += dynamics.period
            scene = Scene(state, dynamics.layout, list(poses))
            information.advance()
            information.absorb(suite.jacobian(scene), suite, suite.detected(scene, None))
            bounds[instant] = information.bound
    return bounds
