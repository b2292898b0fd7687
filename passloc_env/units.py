"""Units used at the edges, and constants of nature; inside, everything is SI and radians."""

from __future__ import annotations

import math

KNOT = 0.514
"""One knot in m/s, as the own-ship cases round it."""

DEGREE = math.pi / 180.0
KILOMETRE = 1e3
MINUTE = 60.0
GIGAHERTZ = 1e9
NANOSECOND = 1e-9

SPEED_OF_LIGHT = 299_792_458.0
"""m/s."""
