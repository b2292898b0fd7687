"""The leaderboard: all scenarios × all policies on the same unseen episodes, as one page with pictures."""

from training.leaderboard.board import leaderboard
from training.leaderboard.entrants import Entrant, entrants
from training.leaderboard.store import Store
from training.leaderboard.variants import Variant, variants

__all__ = ["Entrant", "Store", "Variant", "entrants", "leaderboard", "variants"]
