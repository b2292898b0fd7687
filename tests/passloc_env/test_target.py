"""Where emitters start: places above the ellipsoid with a level course, against pymap3d."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pymap3d
import pytest

from passloc_env import frames
from passloc_env.errors import ScenarioError
from passloc_env.platforms import CircularOrbit
from passloc_env.scenario import Scenario
from passloc_env.sensors import PhaseDifference
from passloc_env.simulation import Simulation
from passloc_env.target import GeodeticStart, Target
from passloc_env.tracking import StatePrior

START = GeodeticStart(latitude=0.7, longitude=-2.1, height=9e3, speed=250.0, course=2.3)


def random_starts(size: int, seed: int = 0) -> GeodeticStart:
    """A realised start whose quantities differ between environments."""
    rng = np.random.default_rng(seed)
    start = replace(START)
    quantities = {
        "latitude": np.arcsin(rng.uniform(-1.0, 1.0, size)),
        "longitude": rng.uniform(-np.pi, np.pi, size),
        "height": rng.uniform(-400.0, 20e3, size),
        "speed": rng.uniform(1.0, 300.0, size),
        "course": rng.uniform(-np.pi, np.pi, size),
    }
    for name, values in quantities.items():
        object.__setattr__(start, name, values)
    return start


def test_the_place_comes_back() -> None:
    """Through the package's own frames and through pymap3d: 7e6 m are rounded to 1e-9 m."""
    start = random_starts(500)
    position = start.sample(500)[:3]
    place = frames.geodetic(position)
    np.testing.assert_allclose(place.latitude, start.latitude, atol=3e-9)
    np.testing.assert_allclose(place.longitude, start.longitude, atol=1e-12)
    np.testing.assert_allclose(place.height, start.height, atol=1e-7)
    expected = pymap3d.geodetic2ecef(start.latitude, start.longitude, start.height, deg=False)
    np.testing.assert_allclose(position, expected, atol=1e-8)


def test_course_and_speed_are_over_ground_and_level() -> None:
    """Velocities turned to local axes by pymap3d: east and north as the course says, none of it up."""
    start = random_starts(500)
    state = start.sample(500)
    east, north, up = pymap3d.uvw2enu(*state[3:], start.latitude, start.longitude, deg=False)
    np.testing.assert_allclose(east, start.speed * np.sin(start.course), atol=1e-10)
    np.testing.assert_allclose(north, start.speed * np.cos(start.course), atol=1e-10)
    np.testing.assert_allclose(up, 0.0, atol=1e-10)
    difference = frames.course(state[:3], state[3:]) - start.course
    np.testing.assert_allclose(np.sin(difference), 0.0, atol=1e-6)
    assert (np.cos(difference) > 0.0).all()


def test_a_level_course_keeps_its_height_to_first_order() -> None:
    """After a second at 250 m/s the ground has fallen away by (250 m)²/2R = 5 mm."""
    state = START.sample(2)
    later = frames.geodetic(state[:3] + state[3:]).height
    np.testing.assert_allclose(later - 9e3, 250.0**2 / 2.0 / 6.38e6, rtol=0.01)


def test_by_hand() -> None:
    """On the equator at longitude 90°, going north-east: x is west, z is north."""
    start = GeodeticStart(latitude=0.0, longitude=math.pi / 2, height=100.0, speed=math.sqrt(8.0), course=math.pi / 4)
    expected = [0.0, 6_378_237.0, 0.0, -2.0, 0.0, 2.0]
    np.testing.assert_allclose(start.sample(1)[:, 0], expected, atol=1e-6)


@pytest.mark.parametrize("latitude", [-math.pi / 2, math.pi / 2])
def test_poles_are_places(latitude: float) -> None:
    """Where all courses lead away from the pole, the longitude tells which meridian north is along."""
    state = replace(START, latitude=latitude, longitude=0.0, course=0.0).sample(1)[:, 0]
    polar = 6_356_752.314245 + 9e3
    np.testing.assert_allclose(state[:3], [0.0, 0.0, math.copysign(polar, latitude)], atol=1e-6)
    np.testing.assert_allclose(state[3:], [-math.copysign(250.0, latitude), 0.0, 0.0], atol=1e-6)


def test_bits_do_not_depend_on_the_batch(assert_batch_free: Callable[..., None]) -> None:
    whole = random_starts(300)
    names = ("latitude", "longitude", "height", "speed", "course")

    def sample(*values: np.ndarray) -> np.ndarray:
        start = replace(START)
        for name, value in zip(names, values, strict=True):
            object.__setattr__(start, name, value)
        return start.sample(len(values[0]))

    assert_batch_free(sample, *(getattr(whole, name) for name in names))


def test_it_starts_scenarios_in_space(begin: Callable[..., Simulation]) -> None:
    scenario = Scenario(
        target=Target(start=START),
        platforms=(CircularOrbit(),),
        sensors=(PhaseDifference(sigma=0.1, baseline=1.0, carrier=1e9),),
        prior=StatePrior(position_sigma=1.0, velocity_sigma=1.0),
    )
    assert scenario.dimension == START.dimension == 3
    random = scenario.override({"target.start.course": {"type": "Uniform", "low": -3.0, "high": 3.0}})
    simulation = begin(random, 3)
    np.testing.assert_array_equal(simulation.truth[:3], START.sample(3)[:3])
    np.testing.assert_allclose(np.linalg.norm(simulation.truth[3:], axis=0), 250.0)
    assert len(np.unique(simulation.truth[3])) == 3
    assert Scenario.from_yaml(scenario.to_yaml()) == scenario


@pytest.mark.parametrize(
    ("field", "value"), [("latitude", 1.6), ("latitude", -1.6), ("height", -2e3), ("speed", -1.0), ("course", math.inf)]
)
def test_impossible_starts(field: str, value: float, refusal: Callable[..., ScenarioError]) -> None:
    assert refusal(lambda: replace(START, **{field: value})).field == field
