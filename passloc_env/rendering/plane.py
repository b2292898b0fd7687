"""The plane that a picture shows: east and north, for scenarios in space those of the place where the emitter began."""

from __future__ import annotations

import numpy as np

from passloc_env.arrays import Array
from passloc_env.frames import geodetic, local_axes


class Plane:
    """East and north of an origin.

    Args:
        origin: position ``(d,)`` of the emitter at the beginning, m; planar positions are shown as they are.
    """

    def __init__(self, origin: Array) -> None:
        self._origin, self._axes = np.zeros(2), np.eye(2)
        if len(origin) == 3:
            place = geodetic(origin[:, None])
            self._origin = origin.copy()
            self._axes = local_axes(place.latitude, place.longitude)[:2, :, 0]

    def point(self, position: Array) -> Array:
        """East and north ``(2,)`` of a position ``(d,)``, m."""
        shown: Array = self._axes @ (position - self._origin)
        return shown

    def spread(self, covariance: Array) -> Array:
        """The covariance ``(2, 2)`` in the plane of one of positions ``(d, d)``."""
        shown: Array = self._axes @ covariance @ self._axes.T
        return shown
