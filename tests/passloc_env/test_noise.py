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
SIZES = NoiseSizes(
    uniforms=6,
    prior=3,
    nuisances=2,
    steps=20,
    measurement=2,
    process=4,
    detection=2,
    navigation=((2, 1), (0, 0), (1, 3)),
    fault=4,
)
KINDS = {
    "uniforms": "uniform",
    "prior": "norm",
    "nuisances": "norm",
    "measurement": "norm",
    "process": "norm",
    "detection": "uniform",
    "fault": "uniform",
    "constant_errors": "norm",
    "fresh_errors": "norm",
}
"""What there is, and its law."""

NOT_SIZES = {"constant_errors", "fresh_errors"}
"""Kinds that have no size of their own: platforms say how many of each they need."""


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
@pytest.mark.parametrize("changed", sorted(KINDS.keys() - NOT_SIZES))
def test_one_kind_of_noise_never_shifts_another(changed: str, size: int) -> None:
    before, after = drawn(SIZES).state_arrays(), drawn(replace(SIZES, **{changed: size})).state_arrays()
    for kind in KINDS.keys() - {changed}:
        np.testing.assert_array_equal(after[kind], before[kind])


@pytest.mark.parametrize("navigation", [(), ((0, 0),), ((9, 0),), ((0, 9),), ((4, 4), (4, 4))])
def test_navigation_errors_never_shift_other_noise(navigation: tuple[tuple[int, int], ...]) -> None:
    before, after = drawn(SIZES).state_arrays(), drawn(replace(SIZES, navigation=navigation)).state_arrays()
    for kind in KINDS.keys() - NOT_SIZES:
        np.testing.assert_array_equal(after[kind], before[kind])


@pytest.mark.parametrize("uniform", [(0,), (1,), (0, 1)])
def test_uniform_errors_never_shift_other_noise(uniform: tuple[int, ...]) -> None:
    """Not even that of the measurements that stay normal."""
    before, after = drawn(SIZES).state_arrays(), drawn(replace(SIZES, uniform=uniform)).state_arrays()
    for kind in KINDS.keys() - {"measurement"}:
        np.testing.assert_array_equal(after[kind], before[kind])
    same = after["measurement"] == before["measurement"]
    np.testing.assert_array_equal(same.all(axis=(0, 2)), [row not in uniform for row in range(2)])
    np.testing.assert_array_equal(same.any(axis=(0, 2)), [row not in uniform for row in range(2)])


def test_a_longer_episode_begins_like_a_shorter_one() -> None:
    short, long = drawn(SIZES).state_arrays(), drawn(replace(SIZES, steps=50)).state_arrays()
    for kind in KINDS:
        np.testing.assert_array_equal(long[kind][: len(short[kind])], short[kind])


def test_an_episode_takes_the_same_from_its_generator_whatever_it_needs() -> None:
    """So that the second episode does not depend on the length or noise of the first."""
    states = []
    for sizes in (SIZES, replace(SIZES, steps=500, process=0, uniforms=99, navigation=(), uniform=(0,))):
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


NORMAL = tuple(kind for kind, law in KINDS.items() if law == "norm")


@pytest.mark.parametrize("kinds", [NORMAL, ("uniforms", "detection")])
def test_no_number_is_used_twice(kinds: tuple[str, ...]) -> None:
    """Not even between kinds of the same law, where it would hide in the shapes."""
    arrays = drawn(replace(SIZES, steps=200), 3).state_arrays()
    numbers = np.concatenate([arrays[kind].ravel() for kind in kinds])
    assert len(np.unique(numbers)) == len(numbers)


def test_each_environment_is_read_at_its_own_step() -> None:
    noise, steps = drawn(SIZES, 3), np.array([1, 7, 20])
    arrays = noise.state_arrays()
    for kind in ("measurement", "process", "detection"):
        found = getattr(noise, kind)(steps)
        behind = kind == "process"  # no step leads to the first look
        expected = np.stack([arrays[kind][step - behind, :, column] for column, step in enumerate(steps)], axis=-1)
        np.testing.assert_array_equal(found, expected)


def test_navigation_errors_go_to_their_platforms() -> None:
    """Constant ones the same at every step, fresh ones of each environment's own step, in any choice of them."""
    noise, steps = drawn(SIZES, 3), np.array([0, 7, SIZES.steps])
    arrays = noise.state_arrays()
    fresh = np.stack([arrays["fresh_errors"][step, :, column] for column, step in enumerate(steps)], axis=-1)
    for columns in (slice(None), np.array([2, 0])):
        first, second, third = noise.navigation(steps, columns)
        np.testing.assert_array_equal(first.constant, arrays["constant_errors"][:2, columns])
        np.testing.assert_array_equal(first.fresh, fresh[:1, columns])
        assert second.constant.shape[0] == second.fresh.shape[0] == 0
        np.testing.assert_array_equal(third.constant, arrays["constant_errors"][2:, columns])
        np.testing.assert_array_equal(third.fresh, fresh[1:, columns])
    again = noise.navigation(steps - steps)
    np.testing.assert_array_equal(again[0].constant, arrays["constant_errors"][:2])


def test_what_nobody_needs_takes_no_room() -> None:
    bare = drawn(replace(SIZES, navigation=((0, 0), (0, 0))), 3)
    arrays = bare.state_arrays()
    assert arrays["constant_errors"].size == arrays["fresh_errors"].size == 0
    for errors in bare.navigation(np.zeros(3, int)):
        assert (errors.constant.shape, errors.fresh.shape) == ((0, 3), (0, 3))
    assert drawn(replace(SIZES, navigation=())).navigation(np.zeros(1, int)) == []


def test_uniform_errors_are_uniform_with_unit_variance() -> None:
    """Within ± √3, against the law itself, and their mean square against one: its variance is 0.8/n."""
    sizes = replace(SIZES, steps=200, uniform=(1,))
    normal, uniform = np.moveaxis(drawn(sizes, 100).state_arrays()["measurement"], 1, 0)
    assert np.abs(uniform).max() <= np.sqrt(3.0)
    root = np.sqrt(3.0)
    assert stats.kstest(uniform.ravel(), stats.uniform(-root, 2.0 * root).cdf).pvalue > FALSE_ALARM
    assert stats.kstest(uniform[:, 0], stats.uniform(-root, 2.0 * root).cdf).pvalue > FALSE_ALARM
    level = stats.norm.isf(FALSE_ALARM / 2)
    assert abs(np.mean(np.square(uniform)) - 1.0) < level * np.sqrt(0.8 / uniform.size)
    correlation = np.corrcoef(normal.ravel(), uniform.ravel())[0, 1]
    assert abs(correlation) < level / np.sqrt(uniform.size)


def test_measurements_reach_the_last_step() -> None:
    assert drawn(SIZES).measurement(np.array([SIZES.steps])).shape == (2, 1)
    assert drawn(SIZES).process(np.array([SIZES.steps])).shape == (4, 1)


BASE = SCENARIOS["BearingDopplerUnknownCarrier"].override({"target.motion": ConstantVelocity()})


@pytest.mark.parametrize(
    "changes",
    [
        {"sensors.1.detection_probability": 0.5},
        {"sensors.1.faults": {"outlier_probability": 0.5, "late_probability": 0.5}},
        {"sensors.0.faults.outage_duration": {"type": "Uniform", "low": 1.0, "high": 9.0}},
        {"tracker.gate": 0.9},
        {"target.motion.acceleration_noise": 1.0},
        {"sensors.0.sigma": {"type": "Uniform", "low": 0.1, "high": 0.2}},
        {"episode.steps": 480},
        {"tracker.motion.acceleration_noise": 0.1},
        {"tracker.motion": {"type": "ConstantAcceleration"}},
        {"reward": []},
    ],
    ids=[
        "detection",
        "faults",
        "random outage",
        "gate",
        "process noise",
        "random sigma",
        "longer",
        "agile tracker",
        "other tracker",
        "no reward",
    ],
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
        dynamics.disturb(expected, simulation.noise.process(np.full(3, step + 1)))
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


def test_uniform_errors_are_no_other_numbers_in_disguise() -> None:
    """Turned back to [0, 1], none of them is a draw for a quantity or a detection: 14 digits, one in 10¹⁰ by chance."""
    arrays = drawn(replace(SIZES, steps=200, uniform=(0, 1)), 3).state_arrays()
    shares = (arrays["measurement"] / np.sqrt(12.0) + 0.5).ravel().round(14)
    assert len(np.unique(shares)) == len(shares)
    for kind in ("uniforms", "detection"):
        assert not np.isin(shares, arrays[kind].ravel().round(14)).any()


def test_bearings_with_uniform_errors_stay_within_their_limits(begin: Callable[..., Simulation]) -> None:
    """√3 standard deviations, all over; the Doppler beside them keeps its errors to the last bit."""
    base = SCENARIOS["BearingDoppler"]
    plain, uniform = begin(base, 2000), begin(base.override({"sensors.0.noise_law": "uniform"}), 2000)
    errors = [
        seen.models.suite.difference(seen.measure(scene := seen.scene())[0], seen.models.suite.measure(scene))
        for seen in (plain, uniform)
    ]
    limit = np.sqrt(3.0) * 3e-3
    assert np.abs(errors[1][0]).max() <= limit * (1.0 + 1e-9)
    assert stats.kstest(errors[1][0], stats.uniform(-limit, 2.0 * limit).cdf).pvalue > FALSE_ALARM
    np.testing.assert_array_equal(errors[1][1], errors[0][1])
    np.testing.assert_array_equal(uniform.truth, plain.truth)
