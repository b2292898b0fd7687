"""What a path lets one know: the bound against a recursion written out, rank and weakest direction against theory."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from passloc_env.belief import Belief
from passloc_env.dynamics import Dynamics
from passloc_env.errors import InputError
from passloc_env.metrics import root_trace
from passloc_env.models import observation_names
from passloc_env.motion import UnknownTurn
from passloc_env.observability import cramer_rao_path
from passloc_env.platforms import Pose
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.sightline import Scene
from passloc_env.survey import Survey
from passloc_env.tracking import StatePrior

Flight = tuple[str, dict[str, Any], tuple[float, ...]]
"""Scenario, changes to it, and the action that is held throughout."""

BY_RATE = {"platforms.0.control": "turn_rate"}
AT_REST = {"platforms.0.speed": 0.0}
STRAIGHT: Flight = ("BearingsOnly", BY_RATE, (0.0,))
CIRCLE: Flight = ("BearingsOnly", BY_RATE, (0.3,))
FIXED_1B: Flight = ("BearingDopplerCase1b", AT_REST, (0.0,))
CIRCLE_1B: Flight = ("BearingDopplerCase1b", BY_RATE, (0.3,))
AT_THE_EMITTER: Flight = ("BearingsOnly", {}, (0.0,))
POINTING_DOWN: Flight = ("DualSatellite", {}, (0.0,) * 6)
FLOWN: dict[str, Flight] = {
    "bearings only, straight": STRAIGHT,
    "bearings only, circle": CIRCLE,
    "case 1b, fixed": FIXED_1B,
    "case 2b, a turning emitter": ("BearingDopplerCase2b", BY_RATE, (-0.5,)),
    "two satellites, yaw": ("DualSatellite", {}, (0.0, 0.0, 1.0, 0.0, 0.0, 1.0)),
    "two arrays, acceleration and process noise": ("DualArray", BY_RATE, (1.0,)),
    "three vehicles": ("CrossFix", {}, (0.5, -0.3, 0.1)),
}
FINITE_STEP = 1e-4
"""Share of the prior's deviation by which states are moved to take derivatives: 1 m of 10 km, and truncation errors of
the order of (step / range)²."""


def survey_of(flight: Flight, seed: int = 2, **changes: Any) -> Survey:
    """An episode of a named scenario, flown by one command; changes have ``__`` for dots."""
    name, overrides, command = flight
    renamed = {key.replace("__", "."): value for key, value in changes.items()}

    def hold(observation: np.ndarray, belief: Belief, rng: np.random.Generator) -> np.ndarray:
        return np.array([command])

    return Survey(SCENARIOS[name].override({**overrides, **renamed}), hold, seed)


@pytest.fixture(scope="module", params=FLOWN.values(), ids=list(FLOWN))
def survey(request: pytest.FixtureRequest) -> Survey:
    return survey_of(request.param)


def differentiated(survey: Survey, state: np.ndarray, poses: list[Pose], scale: np.ndarray) -> np.ndarray:
    """The measurement's derivative ``(m, n)`` with respect to the state in units of ``scale``, by central differences.

    All neighbours of the state are seen together, as an axis of the scene.
    """
    suite, n = survey.simulation.models.suite, len(state)
    shift = FINITE_STEP * np.diag(scale)
    neighbours = state[:, None] + np.concatenate([shift, -shift], axis=1)
    seen = suite.measure(Scene(neighbours[..., None], survey.layout, poses))[..., 0]
    slope: np.ndarray = suite.difference(seen[:, :n], seen[:, n:]) / (2.0 * FINITE_STEP)
    return slope


def recursion(survey: Survey) -> np.ndarray:
    """``J ← (Q + F J⁻¹ Fᵀ)⁻¹ + Hᵀ R⁻¹ H`` in plain matrices, states in units of the prior's deviations."""
    scale = np.sqrt(np.diag(survey.prior[..., 0]))
    dynamics, noise = survey.dynamics, survey.simulation.models.suite.noise_covariance[..., 0]
    transition = dynamics.transition.matrix[..., 0] / scale[:, None] * scale
    process = dynamics.process_noise[..., 0] / np.outer(scale, scale)
    information = np.linalg.inv(survey.prior[..., 0] / np.outer(scale, scale))
    bounds = []
    for state, poses in zip(survey.states, survey.path, strict=True):
        slope = differentiated(survey, state, poses, scale)
        information = np.linalg.inv(process + transition @ np.linalg.inv(information) @ transition.T)
        information = information + slope.T @ np.linalg.inv(noise) @ slope
        bounds.append(np.linalg.inv(information) * np.outer(scale, scale))
    return np.stack(bounds)


def assert_same_bound(found: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    """Covariances ``(K, n, n)`` alike in units of their own deviations."""
    sigma = np.sqrt(np.einsum("kii->ki", expected))
    np.testing.assert_allclose((found - expected) / (sigma[:, :, None] * sigma[:, None]), 0.0, atol=tolerance)


def test_bound_is_the_information_recursion(survey: Survey) -> None:
    # Derivatives are good to 1e-8, and information matrices scaled by the prior have condition numbers up to 1e8, of
    # which rounding makes 1e-8 and differences between steps much less.
    assert_same_bound(survey.bound, recursion(survey), tolerance=1e-6)


def test_bound_along_a_path_is_the_simulations_own(survey: Survey) -> None:
    start = survey.start.copy()
    bounds = cramer_rao_path(survey.dynamics, survey.simulation.models.suite, start, survey.prior, survey.path)
    # The same operations on the same numbers but for the state, whose sums are taken in the same order.
    assert_same_bound(bounds[..., 0], survey.bound, tolerance=1e-9)
    np.testing.assert_array_equal(start, survey.start)


def test_bounds_of_a_batch_are_those_of_its_members(survey: Survey) -> None:
    """Emitters side by side before the same poses, one of which is this episode's own."""
    moved = survey.start * np.linspace(0.98, 1.02, 5)
    priors = survey.prior * np.linspace(1.0, 3.0, 5)
    models = survey.simulation.models
    together = cramer_rao_path(survey.dynamics, models.suite, moved, priors, survey.path)
    for column in range(5):
        part = slice(column, column + 1)
        alone = cramer_rao_path(survey.dynamics, models.suite, moved[:, part], priors[..., part], survey.path)
        assert alone.tobytes() == together[..., part].tobytes()


def test_a_nonlinear_motion_has_no_path_bound() -> None:
    survey = survey_of(STRAIGHT, episode__steps=4)
    layout = UnknownTurn().layout(2)
    dynamics = Dynamics(UnknownTurn(), layout, 1.0, UnknownTurn().nuisances)
    start, prior = np.ones((5, 1)), np.eye(5)[..., None]
    with pytest.raises(TypeError, match="UnknownTurn is not linear"):
        cramer_rao_path(dynamics, survey.simulation.models.suite, start, prior, survey.path)


def test_record_of_the_episode(survey: Survey) -> None:
    episode, n = survey.scenario.episode, survey.layout.size
    k = episode.steps
    np.testing.assert_allclose(survey.time, episode.period * np.arange(1, k + 1))
    assert survey.states.shape == (k, n)
    assert survey.rows.shape == (k, survey.simulation.models.suite.size, n, 1)
    assert [len(poses) for poses in survey.path] == [len(survey.scenario.platforms)] * k
    transition = survey.dynamics.transition.matrix[..., 0]
    known = survey.dynamics.motion.known_input(survey.layout, episode.period)  # type: ignore[attr-defined]
    push = np.zeros((n, 1)) if known is None else known
    states = np.concatenate([survey.start, survey.states.T], axis=1)
    # None of these emitters is disturbed: rounding of one step.
    np.testing.assert_allclose(states[:, 1:], transition @ states[:, :-1] + push, rtol=1e-12, atol=1e-9)
    own = np.stack([poses[survey.scenario.own_ship].position[:, 0] for poses in survey.path])
    offsets = survey.states[:, survey.layout.position] - own
    np.testing.assert_allclose(survey.range, np.linalg.norm(offsets, axis=1), rtol=1e-12)
    spread = np.einsum("kii->ki", survey.bound)[:, survey.layout.position].sum(axis=1)
    np.testing.assert_allclose(survey.position_bound, np.sqrt(spread), rtol=1e-12)


def test_poses_are_those_of_their_instants() -> None:
    survey = survey_of(STRAIGHT)
    first = survey.path[0][0]
    for time, (pose,) in zip(survey.time, survey.path, strict=True):
        expected = first.position + (time - survey.time[0]) * first.velocity
        np.testing.assert_allclose(pose.position, expected, atol=1e-6)  # rounding of 60 km over 240 steps


def test_rows_are_the_derivative_over_the_noise(survey: Survey) -> None:
    scale = np.sqrt(np.diag(survey.prior[..., 0]))
    deviations = np.sqrt(np.diag(survey.simulation.models.suite.noise_covariance[..., 0]))
    for k in (0, len(survey.time) // 2, -1):
        expected = differentiated(survey, survey.states[k], survey.path[k], scale) / deviations[:, None]
        np.testing.assert_allclose(survey.rows[k, ..., 0] * scale, expected, atol=1e-6 * np.abs(expected).max())


def test_gramian_is_the_sum_of_mapped_rows(survey: Survey) -> None:
    transition = survey.dynamics.transition.matrix[..., 0]
    expected, power = np.zeros((survey.layout.size,) * 2), np.eye(survey.layout.size)
    for rows in survey.rows[..., 0]:
        expected += (rows @ power).T @ rows @ power
        power = transition @ power
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose((survey.gramian - expected) / np.outer(size, size), 0.0, atol=1e-9)


def test_a_straight_observer_never_learns_the_range() -> None:
    """Scaling the relative state changes no bearing: that is the direction left in the dark, the only one."""
    straight, circle = survey_of(STRAIGHT), survey_of(CIRCLE)
    report = straight.rank()
    (pose,) = straight.path[0]
    relative = straight.states[0] - np.concatenate([pose.position[:, 0], pose.velocity[:, 0]])
    direction, weakest = relative / np.linalg.norm(relative), report.weakest[:, 0]
    assert report.rank[0] == 3
    assert report.condition[0] > 1e12
    # A null vector of a matrix whose other singular values are above 1e-3 of the largest.
    np.testing.assert_allclose(weakest / np.linalg.norm(weakest) * np.sign(weakest @ direction), direction, atol=1e-9)
    assert circle.rank().rank[0] == 4
    assert circle.rank().condition[0] < 1e3
    assert circle.position_bound[-1] < 0.05 * straight.position_bound[-1]


def test_case_1b_hides_the_range_from_a_fixed_station() -> None:
    """Along the line of sight only the ratio of speed to range is missing: range and its scatter, (2, 1)/√5."""
    survey = survey_of(FIXED_1B)
    report = survey.rank()
    assert report.rank[0] == 3
    weakest = report.weakest[:, 0] / np.linalg.norm(report.weakest[:, 0])
    np.testing.assert_allclose(weakest, np.array([2.0, 1.0, 0.0, 0.0]) / math.sqrt(5.0), atol=1e-9)
    assert report.weakest_name == ("east",)
    # The prior's 20 % of the range, and across the line of sight the bearings' share, 0.003 · r0 at most.
    np.testing.assert_allclose(survey.position_bound, 0.2 * math.hypot(120e3, 60e3), rtol=0.01)
    assert survey_of(CIRCLE_1B).rank().rank[0] == 4


def test_condition_is_in_units_of_the_prior_s_deviations(survey: Survey) -> None:
    """The Gramian scaled by them has its square; squaring leaves little of conditions above 1e5."""
    scale = np.sqrt(np.diag(survey.prior[..., 0]))
    condition = float(survey.rank().condition[0])
    values = np.linalg.eigvalsh(survey.gramian * np.outer(scale, scale))
    if condition < 1e5:
        assert condition == pytest.approx(math.sqrt(values[-1] / values[0]), rel=1e-4)
    else:
        assert abs(values[0]) < 1e-9 * values[-1]


def test_rank_depends_on_the_tolerance() -> None:
    survey = survey_of(CIRCLE)
    condition = float(survey.rank().condition[0])
    assert survey.rank(0.9 / condition).rank[0] == 4
    assert survey.rank(1.1 / condition).rank[0] < 4


def test_elsewhere_at_home(survey: Survey) -> None:
    """At the emitter's own start the path comes to what the episode came to."""
    found = survey.bound_elsewhere(survey.start[survey.layout.position])
    np.testing.assert_allclose(found, survey.position_bound[-1], rtol=1e-9)


@pytest.mark.parametrize("name", ["BearingDopplerCase1b", "BearingDopplerCase2a"])
def test_elsewhere_is_what_an_episode_there_comes_to(name: str) -> None:
    """Against episodes of their own, flown on the same path by a turn rate that no belief sways."""
    flight: Flight = (name, {**BY_RATE, "episode.steps": 60, "episode.min_range": 0.0}, (0.3,))
    places = np.array([[60e3, -40e3, 5e3], [80e3, 10e3, -70e3]])
    found = survey_of(flight).bound_elsewhere(places)
    for place, bound in zip(places.T, found, strict=True):
        there = survey_of(flight, target__start__position=tuple(place))
        assert there.position_bound[-1] == pytest.approx(bound, rel=1e-9)  # the same sums


def test_elsewhere_takes_any_number_of_places() -> None:
    survey = survey_of(CIRCLE_1B, episode__steps=8)
    places = np.random.default_rng(0).uniform(-1e5, 1e5, (2, 1100))
    whole = survey.bound_elsewhere(places)
    assert whole.shape == (1100,)
    np.testing.assert_array_equal(whole[500:530], survey.bound_elsewhere(places[:, 500:530]))
    assert np.isfinite(whole).all()


def test_elsewhere_on_top_of_the_observer_is_finite() -> None:
    survey = survey_of(FIXED_1B, episode__steps=8)
    assert np.isfinite(survey.bound_elsewhere(np.zeros((2, 1)))).all()


def below_the_horizon() -> Survey:
    """Satellites over Africa, the emitter in the Pacific, known to 10 km and 100 m/s."""
    prior = StatePrior(position_sigma=10e3, velocity_sigma=100.0)
    place = {"target__start__latitude": -0.5, "target__start__longitude": 3.3}
    return survey_of(POINTING_DOWN, prior=prior, episode__steps=20, **place)


def test_an_emitter_below_the_horizon_gives_nothing_away() -> None:
    survey = below_the_horizon()
    transition = survey.dynamics.transition.matrix[..., 0]
    expected = survey.prior[..., 0]
    for bound in survey.bound:
        expected = transition @ expected @ transition.T
        np.testing.assert_allclose(bound, expected, rtol=1e-12, atol=1e-9)
    elsewhere = survey.bound_elsewhere(survey.start[survey.layout.position])
    np.testing.assert_allclose(elsewhere, survey.position_bound[-1], rtol=1e-12)
    np.testing.assert_allclose(survey.position_bound, math.sqrt(3.0) * np.hypot(10e3, 100.0 * survey.time), rtol=1e-12)


def test_a_hidden_emitter_leaves_no_record() -> None:
    """What the bound was not told is in neither rank nor Gramian."""
    survey = below_the_horizon()
    assert survey.rank().rank[0] == 0
    assert not survey.gramian.any()


def test_a_missed_measurement_leaves_no_record() -> None:
    """Without process noise the bound is that of the Gramian, mapped to the end, and the prior."""
    survey = survey_of(CIRCLE, sensors__0__detection_probability=0.4)
    transition = survey.dynamics.transition.matrix[..., 0]
    to_the_end = np.linalg.matrix_power(transition, len(survey.time) - 1)
    whole = to_the_end.T @ np.linalg.inv(survey.bound[-1]) @ to_the_end
    expected = whole - np.linalg.inv(transition @ survey.prior[..., 0] @ transition.T)
    size = np.sqrt(np.diag(whole))
    # Inverses of covariances whose condition number in these units is 1e4.
    np.testing.assert_allclose((survey.gramian - expected) / np.outer(size, size), 0.0, atol=1e-6)


@pytest.mark.parametrize("flight", FLOWN.values(), ids=list(FLOWN))
def test_same_seed_same_survey(flight: Flight) -> None:
    survey, again, other = (survey_of(flight, seed, episode__steps=20) for seed in (2, 2, 3))
    for attribute in ("time", "start", "states", "rows", "prior", "bound", "gramian"):
        np.testing.assert_array_equal(getattr(again, attribute), getattr(survey, attribute))
    # In the fixed cases nothing is random but the noise, which sways no command here and no bound anywhere.
    fixed = flight[0].startswith("BearingDopplerCase")
    assert np.array_equal(other.bound, survey.bound) == fixed


def test_the_helmsman_sees_what_agents_see() -> None:
    seen: list[tuple[np.ndarray, float]] = []

    def steer(observation: np.ndarray, belief: Belief, rng: np.random.Generator) -> np.ndarray:
        seen.append((observation, float(belief.time[0])))
        return rng.uniform(-1.0, 1.0, (1, 1))

    scenario = Scenario().override({"episode.steps": 24})
    survey, again = Survey(scenario, steer, seed=5), Survey(scenario, steer, seed=5)
    assert [time for _, time in seen] == 2 * [0.0, 4.0, 8.0, 12.0, 16.0, 20.0]
    features = len(observation_names(scenario))
    for observation, _ in seen:
        assert observation.shape == (1, features)
        assert observation.dtype == np.float32
    np.testing.assert_array_equal(survey.bound, again.bound)
    assert not np.array_equal(survey.bound, Survey(scenario, seed=5).bound)


def test_nobody_at_the_helm_keeps_commands_neutral() -> None:
    quick = {"episode__steps": 24}
    np.testing.assert_array_equal(
        Survey(Scenario().override({"episode.steps": 24}), seed=2).bound, survey_of(AT_THE_EMITTER, **quick).bound
    )


def test_an_episode_is_flown_to_its_end() -> None:
    """Even where an agent would have been stopped for coming too close."""
    survey = survey_of(AT_THE_EMITTER, target__start__range=12e3, target__start__speed=0.0)
    assert survey.range.min() < survey.scenario.episode.min_range
    assert len(survey.time) == survey.scenario.episode.steps


# What was missed by chance, and what nobody can use.

DEAF: Flight = ("RadialAcceleration", {f"sensors.{i}.detection_probability": 0.2 for i in (0, 1)}, (0.0,))


def test_elsewhere_misses_what_was_missed_by_chance() -> None:
    """With four of five measurements missing, the path told the emitter's own start what the episode came to."""
    survey = survey_of(DEAF)
    here = survey.bound_elsewhere(survey.start[survey.layout.position])
    np.testing.assert_allclose(here, survey.position_bound[-1], rtol=1e-9)
    suite, dynamics = survey.simulation.models.suite, survey.dynamics
    all_heard = cramer_rao_path(dynamics, suite, survey.start, survey.prior, survey.path)
    assert root_trace(all_heard[-1], survey.layout.position) < 0.7 * here
    assert survey_of(STRAIGHT)._chances(survey_of(STRAIGHT).simulation) is None


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"start": np.zeros(4)}, r"start of shape \(4,\) is not possible"),
        ({"start": np.zeros((5, 1))}, r"start of shape \(5, 1\) is not possible: must be \(4, 1\)"),
        ({"start": np.full((4, 1), np.nan)}, "start = nan is not possible: must be finite"),
        ({"prior": np.eye(4)}, r"prior of shape \(4, 4\) is not possible: must be \(4, 4, 1\)"),
        ({"prior": np.full((4, 4, 1), np.inf)}, "prior = inf is not possible: must be finite"),
        ({"uniforms": [None]}, "uniforms of 1 instants is not possible: must be 4, as the path"),
    ],
)
def test_a_path_bound_refuses_in_one_line(changes: dict[str, Any], message: str) -> None:
    survey = survey_of(STRAIGHT, episode__steps=4)
    given = {"start": survey.start, "prior": survey.prior, "path": survey.path} | changes
    with pytest.raises(InputError, match=message):
        cramer_rao_path(survey.dynamics, survey.simulation.models.suite, **given)


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        (np.zeros(2), r"positions of shape \(2,\) is not possible: must be axes and emitters"),
        (np.zeros((3, 1)), r"positions of shape \(3, 1\) is not possible: must be \(2, 1\)"),
        (np.array([[0.0], [np.nan]]), "positions = nan is not possible: must be finite"),
    ],
)
def test_elsewhere_refuses_in_one_line(positions: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        survey_of(STRAIGHT, episode__steps=4).bound_elsewhere(positions)
