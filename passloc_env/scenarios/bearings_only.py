"""An aircraft that hears another: classical bearings-only target motion analysis, near and far.

The emitter flies straight, anywhere around the observer, on any course. A straight observer never learns the range:
only its own acceleration makes the problem observable, and the wrong manoeuvre does so slowly or flies into the
emitter. Each second brings one bearing; every 4 s the observer chooses a heading relative to where it believes the
emitter to be, and turns towards it at up to 3°/s.
"""

from __future__ import annotations

from passloc_env.distributions import Uniform
from passloc_env.scenario import Scenario

BEARINGS_ONLY = Scenario()
"""20–60 km, 3 mrad, 240 s; prior 40 ± 15 km; keep-out 10 km."""

BEARINGS_ONLY_FAR = Scenario(name="BearingsOnlyFar").override(
    {
        "target.start.range": Uniform(low=40e3, high=120e3),
        "sensors.0.sigma": 17e-3,
        "prior.range": 80e3,
        "prior.range_sigma": 30e3,
        "observation.range_scale": 80e3,
        "episode.steps": 300,
    }
)
"""40–120 km, 17 mrad (1°), 300 s; prior 80 ± 30 km."""
