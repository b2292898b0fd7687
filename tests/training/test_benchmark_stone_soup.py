"""Stone Soup's filter and FilterPy's see the same recording alike, so their speeds are those of the same work."""

import math

import numpy as np
import pytest

from passloc_env import SCENARIOS

pytest.importorskip("stonesoup")

from training.benchmark.peer_tracking import build_filter
from training.benchmark.peer_world import wrap
from training.benchmark.recording import record
from training.benchmark.stone_soup import BearingDopplerModel, StoneSoupTracker

SCENARIO = SCENARIOS["BearingDoppler"]


@pytest.mark.parametrize("seed", range(3))
def test_both_filters_believe_the_same(seed: int) -> None:
    looks = record(SCENARIO, np.random.default_rng(seed))
    theirs, filterpy = StoneSoupTracker(SCENARIO), build_filter(SCENARIO)
    theirs.start(looks[0])
    filterpy.x, filterpy.P = theirs.mean.copy(), theirs.covariance.copy()
    for look in looks[1:]:
        theirs.step(look)
        filterpy.predict()
        reference = math.atan2(filterpy.x[0] - look.own.east, filterpy.x[1] - look.own.north)
        measurement = np.array([wrap(look.bearing - reference), look.shift])
        filterpy.update(measurement, own=look.own, reference=reference)
    np.testing.assert_allclose(theirs.mean, filterpy.x, rtol=1e-9)
    np.testing.assert_allclose(theirs.covariance, filterpy.P, rtol=1e-6)


def test_a_recording_is_an_episode() -> None:
    looks = record(SCENARIO, np.random.default_rng(0))
    assert len(looks) == SCENARIO.episode.steps + 1
    own_positions = {(look.own.east, look.own.north) for look in looks}
    assert len(own_positions) == len(looks)


def test_the_model_measures_two_scalars() -> None:
    looks = record(SCENARIO, np.random.default_rng(0))
    model = BearingDopplerModel(
        ndim_state=4, mapping=(0, 1), noise_covar=np.eye(2), own=looks[0].own, reference=0.0, scale=-10.0
    )
    assert model.ndim_meas == 2
