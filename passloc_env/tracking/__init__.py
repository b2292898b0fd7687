"""Trackers: what turns measurements into a belief, batched over environments."""

from passloc_env.tracking.filterpy_tracker import FilterPyTracker
from passloc_env.tracking.initialisation import CoursePrior, Prior, RangePrior, StatePrior
from passloc_env.tracking.tracker import Track, Tracker
from passloc_env.tracking.ukf import UnscentedKalman

__all__ = ["CoursePrior", "FilterPyTracker", "Prior", "RangePrior", "StatePrior", "Track", "Tracker", "UnscentedKalman"]
