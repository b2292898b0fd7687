"""Whether a state can be found at all: Gramians, their determinants and ranks, and closed forms for known geometries.

A linear (or linearised) problem ``x_k = Φ x_{k−1}``, ``z_k = H_k x_k`` is observable from the start iff the rows
``H_k Φᵏ`` span the state space, that is, iff the Gramian ``G = Σ (Φᵏ)ᵀ H_kᵀ H_k Φᵏ`` has full rank. With rows divided
by their noise the Gramian is the Fisher information of the initial state. With the *pseudo-linear* rows of bearing and
Doppler, whose coefficients are the measurements themselves, it needs no estimate of the state (paper 000, eqs. 5–9).

Shapes: rows ``(K, m, n, N)`` for K instants of m scalars; matrices ``(n, n, N)``; the batch axis comes last.
"""

from passloc_env.observability.corollaries import (
    constant_acceleration_observable,
    coordinated_turn_observable,
    dual_array_observable,
)
from passloc_env.observability.gramian import (
    fisher_rows,
    gram_gain,
    gramian,
    observability_matrix,
    windowed_gram_determinant,
)
from passloc_env.observability.path import cramer_rao_path
from passloc_env.observability.pseudo_linear import (
    augmented_layout,
    augmented_pseudo_linear_rows,
    augmented_transition,
    pseudo_linear_rows,
)
from passloc_env.observability.radial_acceleration import (
    bearing_radial_acceleration_gram_determinant,
    degree_of_observability,
    radial_acceleration_gram_determinant,
    track_state_rows,
)
from passloc_env.observability.rank import RankReport, rank_report, record_scale

__all__ = [
    "RankReport",
    "augmented_layout",
    "augmented_pseudo_linear_rows",
    "augmented_transition",
    "bearing_radial_acceleration_gram_determinant",
    "constant_acceleration_observable",
    "coordinated_turn_observable",
    "cramer_rao_path",
    "degree_of_observability",
    "dual_array_observable",
    "fisher_rows",
    "gram_gain",
    "gramian",
    "observability_matrix",
    "pseudo_linear_rows",
    "radial_acceleration_gram_determinant",
    "rank_report",
    "record_scale",
    "track_state_rows",
    "windowed_gram_determinant",
]
