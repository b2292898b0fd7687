"""Scenario quantities given as distributions: drawn anew at each reset, one draw each, used everywhere or refused."""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from passloc_env.component import Component, specs
from passloc_env.distributions import Choice, Distribution, LogUniform, Uniform
from passloc_env.errors import ScenarioError
from passloc_env.fields import Part, Parts, Quantity, Vector
from passloc_env.motion import ConstantAcceleration, ConstantVelocity, CoordinatedTurn, UnknownTurn
from passloc_env.randomisation import Randomisation, join
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.sensors import Bearing, Doppler
from passloc_env.simulation import Simulation
from passloc_env.target import CartesianStart
from passloc_env.tracking import StatePrior

BASES = {
    "carrier": SCENARIOS["BearingDopplerUnknownCarrier"].override({"platforms.0.control": "turn_rate"}),
    "own ship": SCENARIOS["OwnShipModerate"],
    "turns": Scenario().override(
        {
            "target.motion": CoordinatedTurn(turn_rate=0.02, acceleration_noise=0.1),
            "tracker.motion": UnknownTurn(acceleration_noise=0.1, turn_rate_noise=1e-3),
            "bound.motion": CoordinatedTurn(turn_rate=0.02),
        }
    ),
    "accelerations": Scenario().override(
        {
            "target.start": CartesianStart(position=(2e4, 1e4), velocity=(-50.0, 100.0)),
            "target.motion": ConstantVelocity(known_acceleration=(1.0, 2.0)),
            "tracker.motion": ConstantAcceleration(acceleration_noise=0.1),
            "bound.motion": ConstantAcceleration(acceleration_noise=0.1),
            "prior": StatePrior(position_sigma=1e3, velocity_sigma=30.0),
            "sensors": [
                Bearing(sigma=0.01, lever_arm=(30.0, 5.0), detection_probability=0.9),
                Doppler(sigma=10.0, carrier=3e9, carrier_sigma=1e3, carrier_walk=1.0),
            ],
        }
    ),
}


def quantities(component: Component, path: str = "") -> Iterator[tuple[str, Any]]:
    """The dotted name and value of every number of a component."""
    for name, spec in specs(type(component)).items():
        value, where = getattr(component, name), f"{path}{name}"
        if isinstance(spec, Quantity):
            yield where, value
        elif isinstance(spec, Vector):
            yield from ((f"{where}.{i}", item) for i, item in enumerate(value))
        elif isinstance(spec, Part):
            yield from quantities(value, f"{where}.")
        elif isinstance(spec, Parts):
            for i, item in enumerate(value):
                yield from quantities(item, f"{where}.{i}.")


def around(value: Any) -> Distribution:
    """A distribution on the same side of every limit as the value."""
    if isinstance(value, Distribution):
        return value
    if math.isinf(value):
        return Uniform(0.01, 0.02)
    return Uniform(*sorted((0.8 * value, value))) if value else Uniform(0.0, 1e-3)


def get(component: Any, name: str) -> Any:
    for key in name.split("."):
        component = component[int(key)] if key.isdigit() else getattr(component, key)
    return component


def randomise(scenario: Scenario, name: str) -> Scenario | None:
    """The scenario with one number random, None when it refuses that, naming the number."""
    try:
        return scenario.override({name: around(get(scenario, name))})
    except ScenarioError as error:
        if error.field != name:
            raise
        return None


NAMES = [(base, name) for base, scenario in BASES.items() for name, _ in quantities(scenario)]


@pytest.mark.parametrize(("base", "name"), NAMES)
def test_a_random_number_does_what_the_same_fixed_number_does(
    base: str, name: str, begin: Callable[..., Simulation]
) -> None:
    """Or is refused at once. One environment begins a second episode half-way, which must not touch the other."""
    scenario = BASES[base]
    randomised = randomise(scenario, name)
    if randomised is None:
        return
    simulation = begin(randomised, 2)
    action = np.array([[0.3, -0.4]])
    simulation.step(action)
    simulation.reset(np.array([1]), [np.random.default_rng(50)])
    simulation.step(action)

    for column, seed, decisions in ((0, 0, 2), (1, 50, 1)):
        drawn = float(get(simulation.realised, name)[column])
        low, high = get(randomised, name).support
        assert low <= drawn <= high
        fixed = begin(scenario.override({name: drawn}), 1, seed)
        for _ in range(decisions):
            fixed.step(action[:, [column]])
        for random, same in (
            (simulation.truth, fixed.truth),
            (simulation.track.mean, fixed.track.mean),
            (simulation.track.covariance, fixed.track.covariance),
            (simulation.information.covariance[:, :, 0], fixed.information.covariance[:, :, 0]),
            (simulation.reward, fixed.reward),
            (simulation.observe(), fixed.observe()),
        ):
            # The same sums, zeros of matrices left out or not.
            np.testing.assert_allclose(random[..., column], same[..., 0], rtol=1e-9, atol=1e-12 * np.abs(same).max())


@pytest.mark.parametrize("base", BASES)
def test_everything_random_at_once_does_not_depend_on_the_batch(base: str, begin: Callable[..., Simulation]) -> None:
    scenario = BASES[base]
    for name, _ in quantities(scenario):
        scenario = randomise(scenario, name) or scenario
    batch, alone = begin(scenario, 5), begin(scenario, 1, 3)
    for _ in range(5):
        batch.step(np.full((1, 5), 0.4))
        alone.step(np.full((1, 1), 0.4))
    mine = alone.state_arrays()
    for name, values in batch.state_arrays().items():
        assert values[..., 3].tobytes() == mine[name][..., 0].tobytes(), name


RANDOM = {
    "sensors.0.sigma": LogUniform(1e-3, 1e-2),
    "platforms.0.position.1": Uniform(-5.0, 5.0),
    "target.start.range": Choice((30e3, 40e3)),
}


def test_realised_numbers_are_the_samples_of_their_draws() -> None:
    scenario = Scenario().override(RANDOM)
    randomisation, uniforms = Randomisation(scenario, 4), np.random.default_rng(0).random((200, 4))
    columns = np.array([1, 3])
    before = {name: get(randomisation.realised, name).copy() for name in RANDOM}
    randomisation.sample(columns, uniforms[: randomisation.size, columns])
    names = [name for name, _ in quantities(scenario)]
    assert randomisation.size == len(names)
    for name, distribution in RANDOM.items():
        found, draws = get(randomisation.realised, name), uniforms[names.index(name)]
        np.testing.assert_array_equal(found[columns], distribution.sample(draws[columns]))
        np.testing.assert_array_equal(found[[0, 2]], before[name][[0, 2]])


def test_fixed_numbers_and_the_scenario_itself_are_left_alone() -> None:
    scenario = Scenario().override(RANDOM)
    before = scenario.to_dict()
    realised = Randomisation(scenario, 4).realised
    assert scenario.to_dict() == before
    assert realised.prior == scenario.prior
    assert realised.platforms[0].max_turn_rate == scenario.platforms[0].max_turn_rate


def test_making_one_number_random_shifts_no_other(begin: Callable[..., Simulation]) -> None:
    one = {"sensors.0.sigma": LogUniform(1e-3, 1e-2)}
    few, many = begin(Scenario().override(one), 3), begin(Scenario().override(RANDOM), 3)
    np.testing.assert_array_equal(get(few.realised, "sensors.0.sigma"), get(many.realised, "sensors.0.sigma"))
    np.testing.assert_array_equal(few.noise.uniforms, many.noise.uniforms)
    np.testing.assert_array_equal(few.noise.prior, many.noise.prior)


def test_joined_tiles_hold_every_number_in_order() -> None:
    scenario = Scenario().override(RANDOM)
    tiles = [Randomisation(scenario, size) for size in (2, 3)]
    uniforms = np.random.default_rng(0).random((tiles[0].size, 5))
    whole = Randomisation(scenario, 5)
    for tile, part in ((tiles[0], slice(0, 2)), (tiles[1], slice(2, 5)), (whole, slice(0, 5))):
        columns = np.arange(part.stop - part.start)
        tile.sample(columns, uniforms[:, part])
    joined = join([tile.realised for tile in tiles])
    for name in RANDOM:
        np.testing.assert_array_equal(get(joined, name), get(whole.realised, name))
    assert joined.episode == scenario.episode
