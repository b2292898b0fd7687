"""Trackers: what turns measurements into a belief, batched over environments."""

from passloc_env.tracking.crossing import CrossingKalman
from passloc_env.tracking.ekf import ExtendedKalman
from passloc_env.tracking.filterpy_tracker import FilterPyTracker
from passloc_env.tracking.height_prior import HeightPrior
from passloc_env.tracking.initialisation import CoursePrior, Prior, RangePrior, StatePrior
from passloc_env.tracking.interacting import InteractingModels
from passloc_env.tracking.place_prior import PlacePrior
from passloc_env.tracking.range_bank import RangeBank
from passloc_env.tracking.recursive_cross_fix import RecursiveCrossFix
from passloc_env.tracking.scattered_prior import ScatteredPrior
from passloc_env.tracking.square_root import SquareRootKalman
from passloc_env.tracking.tracker import Track, Tracker
from passloc_env.tracking.ukf import UnscentedKalman

__all__ = [
    "CoursePrior",
    "CrossingKalman",
    "ExtendedKalman",
    "FilterPyTracker",
    "HeightPrior",
    "InteractingModels",
    "PlacePrior",
    "Prior",
    "RangeBank",
    "RangePrior",
    "RecursiveCrossFix",
    "ScatteredPrior",
    "SquareRootKalman",
    "StatePrior",
    "Track",
    "Tracker",
    "UnscentedKalman",
]
