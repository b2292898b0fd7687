"""A cross fix that met a place that is none begins anew, and says so."""

from collections.abc import Callable

import numpy as np

from passloc_env.scenarios import SCENARIOS
from passloc_env.simulation import Simulation


def test_a_cross_fix_that_is_no_number_begins_anew(begin: Callable[..., Simulation]) -> None:
    """One ray heard from nowhere spoils every later fix; its environment restarts, the others go on."""
    simulation, untouched = (begin(SCENARIOS["CrossFix"], 3) for _ in range(2))
    action = np.zeros((3, 3))
    for each in (simulation, untouched):
        each.step(action)
    simulation.track.stations[0, 0, 0, 1] = np.nan  # type: ignore[attr-defined]
    for each in (simulation, untouched):
        each.step(action)
    np.testing.assert_array_equal(simulation.track.repairs, [0, 1, 0])
    assert np.isfinite(simulation.track.mean).all()
    assert np.isfinite(simulation.track.covariance).all()
    assert np.isfinite(simulation.track.nis).all()
    np.testing.assert_array_equal(simulation.track.mean[:, [0, 2]], untouched.track.mean[:, [0, 2]])
