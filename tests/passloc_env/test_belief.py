"""What the agent sees: named, finite, and the same wherever the world points."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import block_diag

from passloc_env.belief import OBSERVATION_LIMIT, Belief, line_of_sight_axes
from passloc_env.models import observation_names
from passloc_env.motion import ConstantAcceleration
from passloc_env.platforms import FixedStation, Pose
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.sensors import Bearing, Doppler
from passloc_env.simulation import Simulation
from passloc_env.spaces import observation_space
from passloc_env.target import CartesianStart
from passloc_env.tracking import StatePrior

ENVIRONMENTS = 6
STATION = FixedStation(position=(5e3, 1e3))
WORLDS = SCENARIOS | {
    "two platforms": Scenario().override(
        {
            "platforms": [Scenario().platforms[0], STATION],
            "sensors": [Bearing(sigma=0.01), Bearing(sigma=0.01, platform=1)],
        }
    ),
    "the own ship between two stations": Scenario().override(
        {
            "platforms": [STATION, Scenario().platforms[0], FixedStation(position=(-4e3, 7e3))],
            "sensors": [Bearing(sigma=0.01, platform=platform) for platform in range(3)],
        }
    ),
    "acceleration": Scenario().override({"tracker.motion": ConstantAcceleration(acceleration_noise=0.1)}),
    "space": Scenario().override(
        {
            "target.start": CartesianStart(position=(2e4, 1e4, 3e3), velocity=(-50.0, 100.0, 10.0)),
            "platforms": [FixedStation(position=(0.0, 0.0, 0.0)), FixedStation(position=(9e3, 0.0, 100.0))],
            "sensors": [Bearing(sigma=0.01), Doppler(sigma=10.0, carrier=3e9, carrier_sigma=1e3, platform=1)],
            "prior": StatePrior(position_sigma=2e3, velocity_sigma=50.0),
        }
    ),
}


@pytest.fixture(params=WORLDS.values(), ids=list(WORLDS))
def simulation(request: pytest.FixtureRequest, begin: Callable[..., Simulation]) -> Simulation:
    """A world after five decisions, when the belief is neither diagonal nor the prior."""
    simulation = begin(request.param, ENVIRONMENTS)
    rng = np.random.default_rng(0)
    for _ in range(5):
        simulation.step(rng.uniform(-1, 1, (request.param.action_size, ENVIRONMENTS)))
    return simulation


def moved(belief: Belief, plane: np.ndarray, action: float = 1.0) -> Belief:
    """The same belief in a world whose east and north have been mapped by an orthogonal matrix."""
    layout = belief.layout
    axes = plane if layout.dimension == 2 else block_diag(plane, 1.0)
    whole = block_diag(*[axes] * (layout.order + 1), np.eye(len(layout.nuisance)))
    return dataclasses.replace(
        belief,
        mean=whole @ belief.mean,
        covariance=np.einsum("ia,abN,jb->ijN", whole, belief.covariance, whole),
        poses=[
            Pose(
                axes @ p.position,
                axes @ p.velocity,
                axes @ p.acceleration,
                np.einsum("ab,ibN->iaN", axes, p.attitude),
            )
            for p in belief.poses
        ],
        last_action=action * belief.last_action,
    )


def test_every_feature_has_a_name(simulation: Simulation) -> None:
    names, features = observation_names(simulation.scenario), simulation.observe()
    assert features.shape == (len(names), ENVIRONMENTS)
    assert len(set(names)) == len(names)
    assert observation_space(simulation.scenario).shape == (len(names),)


@pytest.mark.parametrize("angle", [0.1, np.pi / 2, np.pi, -2.5])
def test_turning_the_world_changes_nothing(simulation: Simulation, angle: float) -> None:
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    observe = simulation.scenario.observation.observe
    # Rotations of a covariance whose condition number may reach 1e6 cost about that many ulp.
    np.testing.assert_allclose(
        observe(moved(simulation.belief, turn)), observe(simulation.belief), rtol=1e-9, atol=1e-9
    )


def test_a_mirror_flips_the_signs_of_the_across_features(simulation: Simulation) -> None:
    observe = simulation.scenario.observation.observe
    features = observe(simulation.belief)
    mirrored = observe(moved(simulation.belief, np.diag([-1.0, 1.0]), action=-1.0))
    names = observation_names(simulation.scenario)
    odd = [
        not name.startswith("ln sigma") and (name.count("across") % 2 == 1 or name.startswith("last action"))
        for name in names
    ]
    signs = np.where(odd, -1.0, 1.0)[:, None]
    np.testing.assert_allclose(mirrored, signs * features, rtol=1e-9, atol=1e-9)
    assert (np.abs(features[odd]) > 1e-6).any()


def test_features_by_hand() -> None:
    """Emitter 30 km east, own ship northbound at 100 m/s, emitter southbound at 50 m/s, round uncertainties."""
    scenario = Scenario()
    layout = Simulation(scenario, 1).models.tracker.layout
    sigmas = np.array([3e3, 6e3, 20.0, 40.0])
    covariance = np.diag(sigmas**2)
    covariance[0, 1] = covariance[1, 0] = 0.5 * sigmas[0] * sigmas[1]
    belief = Belief(
        time=np.array([60.0]),
        time_left=np.array([180.0]),
        interval=4.0,
        period=1.0,
        mean=np.array([[30e3], [0.0], [0.0], [-50.0]]),
        covariance=covariance[..., None],
        layout=layout,
        poses=[Pose(np.zeros((2, 1)), np.array([[0.0], [100.0]]), np.zeros((2, 1)))],
        platforms=scenario.platforms,
        sensors=scenario.sensors,
        motion=scenario.tracker.motion,
        own_ship=0,
        min_range=10e3,
        last_action=np.array([[0.25]]),
    )
    features = dict(zip(observation_names(scenario), scenario.observation.observe(belief)[:, 0], strict=True))
    # Starboard of an eastward line of sight is south.
    expected = {
        "ln range": np.log(0.75),
        "own velocity along": 0.0,
        "own velocity across": -0.5,
        "emitter velocity along": 0.0,
        "emitter velocity across": 0.25,
        "ln sigma of position along": np.log(0.1),
        "ln sigma of position across": np.log(0.2),
        "ln sigma of velocity along": np.log(0.1),
        "ln sigma of velocity across": np.log(0.2),
        "correlation of position across and position along": -0.5,
        "correlation of velocity along and position along": 0.0,
        "time left": 0.75,
        "last action 0": 0.25,
    }
    for name, value in expected.items():
        assert features[name] == pytest.approx(value, abs=1e-12), name


def test_names_say_whose_place_and_whose_body_it_is(simulation: Simulation) -> None:
    """Places relative to the own ship in units of the range, and body axes, by their coordinates along the line of
    sight, to starboard of it and upward."""
    belief, d = simulation.belief, simulation.belief.layout.dimension
    named = dict(zip(observation_names(simulation.scenario), simulation.observe(), strict=True))
    along = belief.line_of_sight
    across = np.stack([along[1], -along[0], *np.zeros((d - 2, ENVIRONMENTS))])
    across /= np.linalg.norm(across, axis=0)
    axes = {"along": along, "across": across}
    if d == 3:
        axes["up"] = np.cross(across, along, axis=0)
    expected: dict[str, np.ndarray] = {}
    own = belief.poses[belief.own_ship].position
    for index, (platform, pose) in enumerate(zip(belief.platforms, belief.poses, strict=True)):
        for axis, unit in axes.items():
            if index != belief.own_ship:
                offset = pose.position - own
                expected[f"platform {index} offset {axis}"] = (unit * offset).sum(axis=0) / belief.range
            if platform.steers_body:
                for row in range(d):
                    expected[f"platform {index} body axis {row} {axis}"] = (unit * pose.attitude[row]).sum(axis=0)
    found = {name for name in named if " offset " in name or " body axis " in name}
    assert found == set(expected)
    for name, values in expected.items():
        np.testing.assert_allclose(named[name], values, atol=1e-9, err_msg=name)  # a few ulp


def test_bodies_that_turn_show_it_and_others_do_not(begin: Callable[..., Simulation]) -> None:
    """A yaw keeps the down axis, and after a quarter of a turn forward has become starboard."""
    scenario = SCENARIOS["DualSatellite"].override({"episode.period": 9.0})
    pointing, turned = begin(scenario), begin(scenario)
    pointing.step(np.zeros((6, 1)))
    turned.step(np.array([[0.0], [0.0], [1.0], [0.0], [0.0], [0.0]]))  # 5 steps of 9 s at 2°/s
    axes = ("along", "across", "up")

    def body(seen: Simulation, platform: int, row: int) -> np.ndarray:
        pose = seen.belief.poses[platform]
        towards = line_of_sight_axes(seen.belief.line_of_sight)
        named = dict(zip(observation_names(scenario), seen.observe()[:, 0], strict=True))
        values = np.array([named[f"platform {platform} body axis {row} {axis}"] for axis in axes])
        np.testing.assert_allclose(towards[..., 0] @ pose.attitude[row, :, 0], values, atol=1e-9)
        unturned: np.ndarray = towards[..., 0].T @ values
        return unturned

    for row, (old, sign) in enumerate([(1, 1.0), (0, -1.0), (2, 1.0)]):
        np.testing.assert_allclose(body(turned, 0, row), sign * body(pointing, 0, old), atol=1e-9)
        np.testing.assert_allclose(body(turned, 1, row), body(pointing, 1, row), atol=1e-9)
    flat = observation_names(scenario.override({"platforms.1.max_body_rate": 0.0}))
    assert {name[:10] for name in flat if "body axis" in name} == {"platform 0"}


def test_agents_see_the_attitude_that_is_reported(begin: Callable[..., Simulation]) -> None:
    scenario = SCENARIOS["DualSatellite"].override({"platforms.0.attitude_bias_sigma": 0.3})
    simulation = begin(scenario)
    named = dict(zip(observation_names(scenario), simulation.observe()[:, 0], strict=True))
    values = [named[f"platform 0 body axis 0 {axis}"] for axis in ("along", "across", "up")]
    axes, true = line_of_sight_axes(simulation.belief.line_of_sight)[..., 0], simulation.poses()[0]
    np.testing.assert_allclose(axes.T @ values, simulation.belief.poses[0].attitude[0, :, 0], atol=1e-9)
    assert np.abs(axes.T @ values - true.attitude[0, :, 0]).max() > 0.05


@pytest.mark.parametrize("name", ["mean", "covariance", "last_action"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 0.0, 1e300, 1e-300])
def test_features_are_finite_whatever_the_belief(simulation: Simulation, name: str, value: float) -> None:
    belief = dataclasses.replace(simulation.belief, **{name: np.full_like(getattr(simulation.belief, name), value)})
    with np.errstate(all="ignore"):
        features = simulation.scenario.observation.observe(belief)
    assert np.isfinite(features).all()
    assert (np.abs(features) <= OBSERVATION_LIMIT).all()


def test_an_emitter_on_top_of_the_own_ship_is_finite(simulation: Simulation) -> None:
    belief = dataclasses.replace(simulation.belief, mean=simulation.belief.mean.copy())
    belief.mean[belief.layout.position] = belief.poses[belief.own_ship].position
    features = simulation.scenario.observation.observe(belief)
    assert np.isfinite(features).all()
    assert (np.abs(features) <= OBSERVATION_LIMIT).all()


def test_observing_leaves_the_belief_alone(simulation: Simulation) -> None:
    before = [simulation.track.mean.copy(), simulation.track.covariance.copy()]
    first, second = simulation.observe(), simulation.observe()
    np.testing.assert_array_equal(first, second)
    assert not np.shares_memory(first, second)
    np.testing.assert_array_equal(simulation.track.mean, before[0])
    np.testing.assert_array_equal(simulation.track.covariance, before[1])


def test_belief_geometry(simulation: Simulation) -> None:
    belief = simulation.belief
    own = belief.poses[belief.own_ship].position
    np.testing.assert_allclose(own + belief.range * belief.line_of_sight, belief.mean[belief.layout.position])
    np.testing.assert_allclose(np.tan(belief.bearing), belief.line_of_sight[0] / belief.line_of_sight[1])
    np.testing.assert_allclose(belief.time + belief.time_left, simulation.scenario.episode.duration)


@pytest.mark.parametrize("dimension", [2, 3])
def test_line_of_sight_axes_are_orthonormal_with_across_to_starboard(dimension: int) -> None:
    towards = np.random.default_rng(1).normal(size=(dimension, 50))
    if dimension == 3:
        towards[:, 0] = [0.0, 0.0, 1.0]  # overhead there is no starboard; any will do
    towards /= np.linalg.norm(towards, axis=0)
    axes = line_of_sight_axes(towards)
    gram = np.einsum("ikN,jkN->ijN", axes, axes)
    np.testing.assert_allclose(gram, np.broadcast_to(np.eye(dimension)[..., None], gram.shape), atol=1e-12)
    np.testing.assert_array_equal(axes[0], towards)
    starboard = axes[1, 0] * towards[1] - axes[1, 1] * towards[0]
    assert (starboard[1:] > 0.0).all()
    if dimension == 3:
        np.testing.assert_array_equal(axes[1, 2], 0.0)
        assert (axes[2, 2] >= 0.0).all()


def test_bits_do_not_depend_on_the_batch(
    simulation: Simulation, begin: Callable[..., Simulation], assert_batch_free: Callable[..., None]
) -> None:
    scenario = simulation.scenario
    belief = begin(scenario, 300).belief
    others = [value for pose in belief.poses for value in (pose.position, pose.velocity)]

    def observe(mean: np.ndarray, covariance: np.ndarray, time: np.ndarray, *poses: np.ndarray) -> np.ndarray:
        pairs = zip(poses[::2], poses[1::2], strict=True)
        part = dataclasses.replace(
            belief,
            mean=mean,
            covariance=covariance,
            time=time,
            time_left=300.0 - time,
            poses=[Pose(position, velocity, 0.0 * velocity) for position, velocity in pairs],
            last_action=belief.last_action[:, : len(time)],
        )
        return scenario.observation.observe(part)

    assert_batch_free(observe, belief.mean, belief.covariance, belief.time, *others)
