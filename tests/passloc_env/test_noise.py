"""The random numbers of an episode depend on its generator alone.

Seeds are fixed; each statistical test would have failed by chance with a probability of 1e-3 when they were chosen.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from passloc_env.motion import ConstantVelocity
from passloc_env.noise import EpisodeNoise, NoiseSizes
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.simulation import Simulation
from passloc_env.tracking import Prior, StatePrior

FALSE_ALARM = 1e-3
SIZES = NoiseSizes(uniforms=6, prior=3, nuisances=2, steps=20, measurement=2, process=4, detection=2)
KINDS = {
    "uniforms": "uniform",
    "prior": "norm",
    "nuisances": "norm",
    "measurement": "norm",
    "process": "norm",
    "detection": "uniform",
}
"""What there is, and its law."""


def drawn(sizes: NoiseSizes, environments: int = 1, first_seed: int = 0) -> EpisodeNoise:
    noise = EpisodeNoise(sizes, environments)
    for column in range(environments):
        noise.draw(column, np.random.default_rng(first_seed + column))
    return noise


@pytest.mark.parametrize("kind", KINDS)
def test_noise_does_not_depend_on_the_batch(kind: str) -> None:
    batch = drawn(SIZES, 5).state_arrays()[kind]
    for column in range(5):
        alone = drawn(SIZES, 1, column).state_arrays()[kind]
        np.testing.assert_array_equal(batch[..., column], alone[..., 0])
    assert (batch[..., 0] != batch[..., 1]).all()


@pytest.mark.parametrize("size", [0, 9])
@pytest.mark.parametrize("changed", KINDS)
def test_one_kind_of_noise_never_shifts_another(changed: str, size: int) -> None:
    before, after = drawn(SIZES).state_arrays(), drawn(replace(SIZES, **{changed: size})).state_arrays()
    for kind in KINDS.keys() - {changed}:
        np.testing.assert_array_equal(after[kind], before[kind])


def test_a_longer_episode_begins_like_a_shorter_one() -> None:
    short, long = drawn(SIZES).state_arrays(), drawn(replace(SIZES, steps=50)).state_arrays()
    for kind in KINDS:
        np.testing.assert_array_equal(long[kind][: len(short[kind])], short[kind])


def test_an_episode_takes_the_same_from_its_generator_whatever_it_needs() -> None:
    """So that the second episode does not depend on the length or noise of the first."""
    states = []
    for sizes in (SIZES, replace(SIZES, steps=500, process=0, uniforms=99)):
        generator = np.random.default_rng(0)
        EpisodeNoise(sizes, 1).draw(0, generator)
        states.append(generator.bit_generator.state)
    assert states[0] == states[1]


def test_the_next_episode_is_another_and_leaves_the_neighbours_alone() -> None:
    noise, generator = drawn(SIZES, 3), np.random.default_rng(1)
    before = {kind: values.copy() for kind, values in noise.state_arrays().items()}
    for _ in range(2):
        noise.draw(1, generator)
    for kind, values in noise.state_arrays().items():
        assert (values[..., 1] != before[kind][..., 1]).all()
        np.testing.assert_array_equal(values[..., [0, 2]], before[kind][..., [0, 2]])


@pytest.mark.parametrize(("kind", "law"), KINDS.items())
def test_law_of_each_kind(kind: str, law: str) -> None:
    """Over the environments and over the time of one episode."""
    values = drawn(replace(SIZES, steps=200), 300).state_arrays()[kind]
    assert stats.kstest(values.ravel(), law).pvalue > FALSE_ALARM
    assert stats.kstest(values[0, ..., :].ravel(), law).pvalue > FALSE_ALARM


def test_kinds_and_environments_are_uncorrelated() -> None:
    arrays = drawn(replace(SIZES, steps=2000), 2).state_arrays()
    series = [
        arrays[kind][:2000, i, e] for kind in ("measurement", "process", "detection") for i in (0, 1) for e in (0, 1)
    ]
    correlation = np.corrcoef(series) - np.eye(len(series))
    # 66 correlations of 2000 pairs, all below the level that one seed in a thousand exceeds somewhere.
    level = stats.norm.isf(FALSE_ALARM / 2 / 66) / np.sqrt(2000)
    assert np.abs(correlation).max() < level


@pytest.mark.parametrize("kinds", [("prior", "nuisances", "measurement", "process"), ("uniforms", "detection")])
def test_no_number_is_used_twice(kinds: tuple[str, ...]) -> None:
    """Not even between kinds of the same law, where it would hide in the shapes."""
    arrays = drawn(replace(SIZES, steps=200), 3).state_arrays()
    numbers = np.concatenate([arrays[kind].ravel() for kind in kinds])
    assert len(np.unique(numbers)) == len(numbers)


def test_each_environment_is_read_at_its_own_step() -> None:
    noise, steps = drawn(SIZES, 3), np.array([0, 7, 19])
    arrays = noise.state_arrays()
    for kind in ("measurement", "process", "detection"):
        found = getattr(noise, kind)(steps)
        expected = np.stack([arrays[kind][step, :, column] for column, step in enumerate(steps)], axis=-1)
        np.testing.assert_array_equal(found, expected)


def test_measurements_reach_the_last_step() -> None:
    assert drawn(SIZES).measurement(np.array([SIZES.steps])).shape == (2, 1)
    assert drawn(SIZES).process(np.array([SIZES.steps - 1])).shape == (4, 1)


BASE = SCENARIOS["BearingDopplerUnknownCarrier"].override({"target.motion": ConstantVelocity()})


@pytest.mark.parametrize(
    "changes",
    [
        {"sensors.1.detection_probability": 0.5},
        {"target.motion.acceleration_noise": 1.0},
        {"sensors.0.sigma": {"type": "Uniform", "low": 0.1, "high": 0.2}},
        {"episode.steps": 480},
        {"tracker.motion.acceleration_noise": 0.1},
        {"tracker.motion": {"type": "ConstantAcceleration"}},
        {"reward": []},
    ],
    ids=["detection", "process noise", "random sigma", "longer", "agile tracker", "other tracker", "no reward"],
)
@pytest.mark.parametrize(
    "prior", [BASE.prior, StatePrior(position_sigma=1e3, velocity_sigma=9.0)], ids=["range", "state"]
)
def test_the_world_is_the_same_whatever_else_is_switched_on(
    changes: dict[str, Any], prior: Prior, begin: Callable[..., Simulation]
) -> None:
    base = BASE.override({"prior": prior})
    before, after = begin(base, 3), begin(base.override(changes), 3)
    np.testing.assert_array_equal(after.truth, before.truth)
    np.testing.assert_array_equal(after.platform_states[0], before.platform_states[0])
    for step in range(3):
        at = np.full(3, step)
        np.testing.assert_array_equal(after.noise.measurement(at), before.noise.measurement(at))


def test_every_step_is_measured_with_its_own_noise(begin: Callable[..., Simulation]) -> None:
    simulation, noises = begin(SCENARIOS["BearingDoppler"], 3), []

    def watch(seen: Simulation) -> None:
        scene, suite = seen.scene(), seen.models.suite
        expected = suite.noise(seen.noise.measurement(seen.step_count))
        # A shift of 1e3 Hz leaves eleven digits behind the point.
        np.testing.assert_allclose(seen.measure(scene)[0] - suite.measure(scene), expected, atol=1e-9)
        noises.append(expected)

    simulation.watchers.append(watch)
    simulation.step(np.zeros((1, 3)))
    assert len(noises) == 4
    assert len(np.unique(noises)) == np.size(noises)


def test_the_emitter_is_disturbed_by_the_noise_of_each_step(begin: Callable[..., Simulation]) -> None:
    changes = {"target.motion.acceleration_noise": 2.0, "episode.decision_every": 1}
    simulation = begin(Scenario().override(changes), 3)
    dynamics = simulation.models.truth.dynamics
    for step in range(3):
        expected = dynamics.mean(simulation.truth, simulation.time)
        dynamics.disturb(expected, simulation.noise.process(np.full(3, step)))
        simulation.step(np.zeros((1, 3)))
        np.testing.assert_allclose(simulation.truth, expected, rtol=1e-12)


def test_an_unknown_carrier_is_scattered_by_its_prior(begin: Callable[..., Simulation]) -> None:
    simulation = begin(SCENARIOS["BearingDopplerUnknownCarrier"], 2000)
    offsets = simulation.truth[simulation.models.truth.layout.nuisance_row("carrier_offset")]
    assert stats.kstest(offsets / 10e3, "norm").pvalue > FALSE_ALARM


def test_detections_happen_with_their_probability(begin: Callable[..., Simulation]) -> None:
    simulation = begin(Scenario().override({"sensors.0.detection_probability": 0.3}), 2000)
    _, detected = simulation.measure(simulation.scene())
    assert detected is not None
    assert stats.binomtest(int(detected.sum()), detected.size, 0.3).pvalue > FALSE_ALARM
