"""All sensors as one measurement: stacked in order, wrapped where angular, masked where missed."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from passloc_env.distributions import Uniform
from passloc_env.errors import ScenarioError
from passloc_env.layout import StateLayout
from passloc_env.platforms import Pose
from passloc_env.scenarios import SCENARIOS
from passloc_env.sensor_suite import SensorSuite, check_nuisances, may_miss, nuisances
from passloc_env.sensors import Bearing, Doppler, PhaseDifference, Sensor, TimeDifference
from passloc_env.sightline import Scene

SIZE = 6
KNOWN = Doppler(sigma=10.0, carrier=3e9)
UNKNOWN = Doppler(sigma=7.0, carrier=1e9, carrier_sigma=1e4, platform=1)
SENSORS: tuple[Sensor, ...] = (Bearing(sigma=0.1), KNOWN, Bearing(sigma=0.2, platform=1), Bearing(sigma=0.3), UNKNOWN)
SUITE = SensorSuite(SENSORS)


@pytest.fixture
def scene() -> Scene:
    rng = np.random.default_rng(0)
    layout = StateLayout(2, 1, ("carrier_offset",))
    poses = [Pose(*rng.normal(size=(3, 2, SIZE))) for _ in range(2)]
    return Scene(100.0 * rng.normal(size=(layout.size, 3, SIZE)), layout, poses)


def test_rows_are_the_sensors_in_order(scene: Scene) -> None:
    measured, jacobian = SUITE.measure(scene), SUITE.jacobian(scene)
    assert SUITE.size == len(SENSORS)
    assert measured.shape == (5, 3, SIZE)
    assert jacobian.shape == (5, 5, 3, SIZE)
    for sensor, rows in zip(SENSORS, SUITE.rows, strict=True):
        np.testing.assert_array_equal(measured[rows], sensor.measure(scene))
        np.testing.assert_array_equal(jacobian[rows], sensor.jacobian(scene))


def test_each_sensor_listens_on_its_platform(scene: Scene) -> None:
    measured = SUITE.measure(scene)
    np.testing.assert_array_equal(measured[0], measured[3])
    assert (measured[0] != measured[2]).all()


def test_differences_wrap_angles_alone() -> None:
    left = np.array([[3.0], [3.0], [-3.0], [0.5], [-300.0]])
    right = np.array([[-3.0], [-3.0], [3.0], [0.25], [300.0]])
    turn = 2.0 * np.pi
    expected = [[6.0 - turn], [6.0], [turn - 6.0], [0.25], [-600.0]]
    np.testing.assert_allclose(SUITE.difference(left, right), expected, rtol=1e-14)
    np.testing.assert_array_equal(left[:, 0], [3.0, 3.0, -3.0, 0.5, -300.0])


def test_wrap_in_place_brings_angles_alone_within_half_a_turn() -> None:
    measurement = np.full((5, 2, SIZE), 10.0)
    SUITE.wrap(measurement)
    expected = np.array([10.0 - 4 * np.pi, 10.0, 10.0 - 4 * np.pi, 10.0 - 4 * np.pi, 10.0])
    np.testing.assert_allclose(measurement, np.broadcast_to(expected[:, None, None], measurement.shape), rtol=1e-14)


def test_noise_covariance_is_block_diagonal() -> None:
    np.testing.assert_allclose(SUITE.noise_covariance[..., 0], np.diag([0.1, 10.0, 0.2, 0.3, 7.0]) ** 2)


def test_noise_covariance_may_differ_between_environments() -> None:
    bearing, sigma = Bearing(sigma=1.0), np.array([1.0, 2.0, 3.0])
    object.__setattr__(bearing, "sigma", sigma)
    suite = SensorSuite((bearing, KNOWN), dense=True)
    np.testing.assert_allclose(suite.noise_covariance[0, 0], sigma**2)
    np.testing.assert_allclose(suite.noise_covariance[1, 1], 100.0)
    np.testing.assert_allclose(suite.noise(np.ones((2, 3))), [sigma, [10.0] * 3])


def anywhere(size: int) -> Scene:
    """Emitters before a station from which nothing hides."""
    return Scene(np.ones((4, size)), StateLayout(), [Pose(*np.zeros((3, 2, size)))])


def test_detected_masks_the_rows_of_each_sensor() -> None:
    suite = SensorSuite((Bearing(sigma=1.0, detection_probability=0.3), KNOWN))
    uniforms = np.array([[0.0, 0.29, 0.3, 0.99], [0.0, 0.5, 0.99, 0.999]])
    np.testing.assert_array_equal(suite.detected(anywhere(4), uniforms), [[True, True, False, False], [True] * 4])


def test_on_top_of_the_emitter_nothing_is_measured() -> None:
    """There is no direction and no rate; what other places hear is heard. Otherwise all is: None, the quick way."""
    poses = [Pose(*np.zeros((3, 2, 3))) for _ in range(2)]
    poses[0].position[:, 1] = 1.0
    poses[1].position[:, 2] = 1.0
    both = TimeDifference(sigma=1e-9)
    apart = TimeDifference(sigma=1e-9, other=0, other_lever_arm=(0.0, 0.0), lever_arm=(50.0, 0.0), platform=1)
    suite = SensorSuite((Bearing(sigma=0.1), KNOWN, Bearing(sigma=0.1, platform=1), both, apart))
    scene = Scene(np.ones((4, 3)), StateLayout(), poses)
    first, second = [True, False, True], [True, True, False]
    np.testing.assert_array_equal(suite.detected(scene, None), [first, first, second, [True, False, False], first])
    assert SensorSuite((Bearing(sigma=0.1), KNOWN)).detected(anywhere(3), None) is None


def test_detection_probability_may_differ_between_environments() -> None:
    bearing = Bearing(sigma=1.0)
    object.__setattr__(bearing, "detection_probability", np.array([0.1, 0.9]))
    assert may_miss((bearing,))
    np.testing.assert_array_equal(SensorSuite((bearing,)).detected(anywhere(2), np.full((1, 2), 0.5)), [[False, True]])


@pytest.mark.parametrize(("chance", "may"), [(1.0, False), (0.999, True)])
def test_may_miss(chance: float, may: bool) -> None:
    assert may_miss((KNOWN, Bearing(sigma=1.0, detection_probability=chance))) is may


def test_a_nuisance_of_one_name_is_shared(scene: Scene) -> None:
    pair = (UNKNOWN, Doppler(sigma=2.0, carrier=1e9, carrier_sigma=1e4, platform=0), KNOWN)
    (shared,) = nuisances(pair)
    assert (shared.name, shared.sigma) == ("carrier_offset", 1e4)
    row = scene.layout.nuisance_row("carrier_offset")
    slopes = SensorSuite(pair).jacobian(scene)[:, row]
    # Both unknown carriers rise one for one with the offset, but for ṙ/c ≈ 1e-6; the known one does not.
    np.testing.assert_allclose(slopes[:2], 1.0, atol=1e-5)
    np.testing.assert_array_equal(slopes[2], 0.0)


def test_straight_above_there_is_no_bearing() -> None:
    """Off the vertical there is one again; a range rate there is either way."""
    above = np.array([[0.0, 1e-4, 10.0], [0.0, 0.0, 0.0], [5e3, -5e3, 5e3], *np.zeros((3, 3))])
    suite = SensorSuite((Bearing(sigma=0.1), KNOWN))
    heard = suite.detected(Scene(above, StateLayout(3), [Pose(*np.zeros((3, 3, 3)))]), None)
    np.testing.assert_array_equal(heard, [[False, False, True], [True] * 3])


TILTED = partial(PhaseDifference, sigma=0.1, baseline=3.0, carrier=3e9)


@pytest.mark.parametrize(
    ("first", "second", "possible"),
    [
        (UNKNOWN, replace(UNKNOWN, sigma=9.0), True),
        (UNKNOWN, replace(UNKNOWN, carrier_sigma=5.0), False),
        (UNKNOWN, replace(UNKNOWN, carrier_walk=0.5), False),
        (KNOWN, UNKNOWN, True),
        (TILTED(axis=0), TILTED(axis=1), True),
        (TILTED(axis=0, misalignment_sigma=1e-3), TILTED(axis=1, misalignment_sigma=1e-3), True),
        (TILTED(axis=0, misalignment_sigma=1e-3), TILTED(axis=1, misalignment_sigma=2e-3), False),
        (TILTED(axis=0, misalignment_sigma=1e-3), TILTED(axis=1), False),
        (TILTED(axis=0), TILTED(axis=1, misalignment_sigma=1e-3), False),
        (TILTED(axis=0), TILTED(axis=1, misalignment_sigma=1e-3, platform=1), True),
        (*(TILTED(axis=axis, misalignment_sigma=Uniform(low=1e-3, high=2e-3)) for axis in (0, 1)), False),
    ],
)
def test_sensors_agree_on_what_they_share(
    first: Sensor, second: Sensor, possible: bool, refusal: Callable[..., ScenarioError]
) -> None:
    """A nuisance has one prior. Numbers drawn at reset are drawn apart, and so are never the same."""
    if possible:
        check_nuisances((first, second))
    else:
        assert refusal(lambda: check_nuisances((first, second))).field == "sensors.1"


def test_scenarios_ask_whether_sensors_agree(refusal: Callable[..., ScenarioError]) -> None:
    changes = {"sensors.1.misalignment_sigma": 0.0}
    assert refusal(lambda: SCENARIOS["DualSatellite"].override(changes)).field == "sensors.1"


def test_root_of_the_noise_where_scalars_are_missed() -> None:
    """Those that are left keep their own variance; bit for bit the root of R where none is missed."""
    detected = np.array([[True, True, False], [True, False, False], *([[True, True, False]] * 3)])
    found = SUITE.noise_root(detected)
    np.testing.assert_array_equal(found[..., :1], SUITE.noise_root())
    sigmas = np.array([0.1, 10.0, 0.2, 0.3, 7.0])
    for column, made in enumerate(detected.T):
        np.testing.assert_allclose(found[..., column], np.diag(np.where(made, sigmas, 1.0)), rtol=1e-14)
