"""Trackers: what turns measurements into a belief, batched over environments."""

from passloc_env.tracking.initialisation import CoursePrior, Prior, RangePrior, StatePrior
from passloc_env.tracking.tracker import Track, Tracker
from passloc_env.tracking.ukf import UnscentedKalman

__all__ = ["CoursePrior", "Prior", "RangePrior", "StatePrior", "Track", "Tracker", "UnscentedKalman"]
