"""The limit computes what passloc computes: one sensor step in C beside one of the simulation's own."""

import ctypes

import numpy as np
import pytest

from passloc_env import SCENARIOS
from passloc_env.simulation import Simulation
from training.benchmark.limit import CLOSEST, ERRORS, NIS, TERMS, Numbers, rows_of, sensor_step

SCENARIO = SCENARIOS["BearingDoppler"].override({"episode.early_end": False})
N = 203
"""Enough for several to a register and a few left over."""


@pytest.mark.skipif(sensor_step() is None, reason="no C compiler here")
def test_a_step_in_c_is_a_step() -> None:
    """To 1e-7: the compiler may reorder sums, and covariances lose three digits to cancellation."""
    step = sensor_step()
    assert step is not None
    simulation = Simulation(SCENARIO, N, straight=False)
    simulation.reset(np.arange(N), [np.random.default_rng(seed) for seed in range(N)])
    for turn in (0.7, -0.4):
        simulation.step(np.full((1, N), turn))
    rows = rows_of(simulation)
    for total in simulation.reward_terms.values():
        total[...] = 0.0
    time = simulation.time
    simulation.step_count += 1
    noise = simulation.noise_at()
    rows[ERRORS] = noise.measurement
    step(rows.ctypes.data, N, N, time[0], ctypes.byref(Numbers.of(SCENARIO)))
    simulation.sense(time, noise)

    expected = rows_of(simulation)
    np.testing.assert_allclose(rows[: ERRORS.start], expected[: ERRORS.start], rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(rows[NIS], simulation.track.nis, rtol=1e-6)
    found = dict(zip(("range_bound", "gram_gain", "tracking_error", "keep_out"), rows[TERMS], strict=True))
    for name, value in simulation.reward_terms.items():
        np.testing.assert_allclose(found[name], value, rtol=1e-6, atol=1e-9, err_msg=name)
    np.testing.assert_array_equal(rows[CLOSEST] < SCENARIO.episode.min_range, simulation.violated)
