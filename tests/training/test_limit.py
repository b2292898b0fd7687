"""The limit computes what passloc computes: one sensor step in C beside one of the simulation's own."""

import ctypes

import numpy as np
import pytest
from scipy import stats

from passloc_env import SCENARIOS
from passloc_env.simulation import Simulation
from training.benchmark.limit import CLOSEST, ERRORS, NIS, TERMS, Numbers, library, rows_of

SCENARIO = SCENARIOS["BearingDoppler"].override({"episode.early_end": False})
N = 203
"""Enough for several to a register and a few left over."""


pytestmark = pytest.mark.skipif(library() is None, reason="no C compiler here")


def test_a_step_in_c_is_a_step() -> None:
    """To 1e-7: the compiler may reorder sums, and covariances lose three digits to cancellation."""
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
    library().sensor_step(rows.ctypes.data, N, N, time[0], ctypes.byref(Numbers.of(SCENARIO)))
    simulation.sense(time, noise)

    expected = rows_of(simulation)
    np.testing.assert_allclose(rows[: ERRORS.start], expected[: ERRORS.start], rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(rows[NIS], simulation.track.nis, rtol=1e-6)
    found = dict(zip(("range_bound", "gram_gain", "tracking_error", "keep_out"), rows[TERMS], strict=True))
    for name, value in simulation.reward_terms.items():
        np.testing.assert_allclose(found[name], value, rtol=1e-6, atol=1e-9, err_msg=name)
    np.testing.assert_array_equal(rows[CLOSEST] < SCENARIO.episode.min_range, simulation.violated)


def test_errors_drawn_in_c_are_standard_normal() -> None:
    """Both, and independent of each other; each test raises a false alarm once in a thousand seeds."""
    seeds = np.random.default_rng(1).integers(1, 2**64 - 1, (4, 20_000), dtype=np.uint64)
    rows = np.zeros((CLOSEST + 1, 20_000))
    library().draw_errors(rows.ctypes.data, seeds.ctypes.data, 20_000, 20_000)
    first, second = rows[ERRORS].copy()
    for errors in (first, second, (first + second) / np.sqrt(2.0)):
        assert stats.kstest(errors, "norm").pvalue > 1e-3
    library().draw_errors(rows.ctypes.data, seeds.ctypes.data, 20_000, 20_000)
    assert (rows[ERRORS.start] != first).all()


def test_the_library_leaves_the_arithmetic_of_others_alone() -> None:
    """Libraries made with liberties of arithmetic may have subnormal numbers rounded to zero, everywhere."""
    assert library() is not None
    smallest = np.nextafter(np.zeros(1), 1.0)
    assert (smallest + smallest > smallest).all()
