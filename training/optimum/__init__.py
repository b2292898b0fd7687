"""The trajectory optimum: the path that minimises the Cramér–Rao bound when the emitter's future is known.

No policy can know that future, so what its path is worth bounds what policies can hope for; a heuristic bound, for the
search finds local optima. The paths are flown in the environment itself: what tables report is the environment's own
score, not the optimiser's.
"""

from training.optimum.optimum import Optimum, Settings
from training.optimum.replay import NAME, Replay
from training.optimum.search import optimise

__all__ = ["NAME", "Optimum", "Replay", "Settings", "optimise"]
