"""Every rule from first principles: what is flown, not how the rule puts it."""

import dataclasses
import math

import numpy as np
import pytest

from agents import Circle, FlyAt, Legs, Perpendicular, Policy, PolicyError, Random, Straight, find_policy
from agents.rules import PUBLISHED_LEGS, stationary, zigzag
from passloc_env import SCENARIOS, LocalisationVectorEnv, Scenario
from passloc_env.angles import bearing_of, wrap
from passloc_env.belief import Belief
from passloc_env.layout import StateLayout
from passloc_env.motion import ConstantVelocity
from passloc_env.platforms import FixedStation, PlanarPose, TurnLimitedPlatform

AGILE = TurnLimitedPlatform(speed=1.0, max_turn_rate=math.inf)
SLOW = TurnLimitedPlatform(speed=1.0, max_turn_rate=math.radians(3.0))
TURNING = TurnLimitedPlatform(speed=1.0, max_turn_rate=math.radians(3.0), control="turn_rate")
INTERVAL = 4.0
CASES = 9
HEADINGS = np.linspace(-3.0, 3.1, CASES)
BEARINGS = np.linspace(2.9, -2.8, CASES) ** 3 / 9.0
TIMES = np.linspace(0.0, 320.0, CASES)
RULES = ("straight", "circle", "zigzag", "zigzag:angle=30:leg=80", "perpendicular", "fly-at", "stationary", "legs")


def believe(platforms=(AGILE,), headings=HEADINGS, bearings=BEARINGS, times=TIMES, interval=INTERVAL) -> Belief:
    """A belief with the emitter 1 km from every platform at the bearings given; the platforms are all in one place."""
    headings, bearings, times = np.broadcast_arrays(headings, bearings, times)
    n = len(headings)
    own = np.stack([np.linspace(-50.0, 50.0, n), np.linspace(20.0, -30.0, n)])
    mean = np.concatenate([own + 1e3 * np.stack([np.sin(bearings), np.cos(bearings)]), np.ones((2, n))])
    pose = PlanarPose(own, np.stack([np.sin(headings), np.cos(headings)]), headings, np.zeros(n))
    return Belief(
        time=times,
        time_left=1e3 - times,
        interval=interval,
        period=1.0,
        mean=mean,
        covariance=np.repeat(np.eye(4)[..., None], n, axis=-1),
        layout=StateLayout(),
        poses=[pose] * len(platforms),
        platforms=platforms,
        sensors=(),
        motion=ConstantVelocity(),
        own_ship=0,
        min_range=0.0,
        last_action=np.zeros((len(platforms), n)),
    )


def decide(policy: Policy, belief: Belief, seed: int = 0) -> np.ndarray:
    """The actions ``(N, a)`` on an observation that no rule may need."""
    return policy.act(np.full((len(belief.time), 17), np.nan), belief, np.random.default_rng(seed))


def flown(policy: Policy, belief: Belief) -> np.ndarray:
    """The heading ``(N,)`` after one decision of the only platform."""
    (platform,), (pose,) = belief.platforms, belief.poses
    offset = belief.mean[:2] - pose.position
    places = [dataclasses.replace(platform, heading=float(heading)) for heading in pose.heading]
    state = np.concatenate([place.start(1) for place in places], axis=-1)
    actions = decide(policy, belief)
    assert np.abs(actions).max() <= 1.0
    set_point = platform.set_point(state, actions.T, offset / np.hypot(*offset))
    return platform.pose(platform.move(state, set_point, belief.interval)).heading


def assert_same_angle(angle, expected):
    assert np.abs(wrap(angle - expected)).max() < 1e-12


@pytest.mark.parametrize("name", [*RULES, "random"])
def test_every_rule_is_a_policy(name):
    policy = find_policy(name, SCENARIOS["OwnShipModerate"])
    assert isinstance(policy, Policy)
    assert policy.name.startswith(name.split(":")[0])
    actions = decide(policy, believe())
    assert actions.shape == (CASES, 1)
    assert np.isfinite(actions).all()
    assert np.abs(actions).max() <= 1.0


def test_what_lacks_a_part_is_no_policy():
    class Nameless:
        def act(self, observation, belief, rng):
            return observation

    assert not isinstance(Nameless(), Policy)


@pytest.mark.parametrize("platform", [AGILE, SLOW, TURNING])
def test_straight_keeps_the_heading(platform):
    assert_same_angle(flown(Straight(), believe((platform,))), HEADINGS)


def test_fly_at_flies_at_the_believed_emitter():
    assert_same_angle(flown(FlyAt(), believe()), BEARINGS)


@pytest.mark.parametrize("platform", [SLOW, TURNING])
def test_fly_at_turns_the_shorter_way_at_the_maximum_rate(platform):
    """From 100° off, 12° in four seconds; from 5° off, all of it."""
    bearings = np.array([0.0, 0.0, 3.0, 3.0])
    off = np.radians([100.0, -100.0, 5.0, -5.0])
    turned = wrap(flown(FlyAt(), believe((platform,), bearings + off, bearings, 0.0)) - (bearings + off))
    np.testing.assert_allclose(np.degrees(turned), [-12.0, 12.0, -5.0, 5.0], rtol=1e-9)


def test_perpendicular_picks_the_nearer_side():
    heading = flown(Perpendicular(), believe())
    assert_same_angle(np.cos(heading - BEARINGS), np.zeros(CASES))
    other = heading + np.pi
    assert (np.abs(wrap(heading - HEADINGS)) <= np.abs(wrap(other - HEADINGS))).all()
    assert len(set(np.sign(np.sin(heading - BEARINGS)))) == 2


@pytest.mark.parametrize(("angle", "leg"), [(60.0, 40.0), (30.0, 80.0), (105.0, 360.0)])
def test_zigzag_legs_and_angles(angle, leg):
    """Starboard of the line of sight in the first leg, port in the second, and so on, changing at the full leg."""
    times = np.array([0.0, leg - 1.0, leg, 2.0 * leg - 1.0, 2.0 * leg, 3.0 * leg, 4.0 * leg])
    sides = np.array([1, 1, -1, -1, 1, -1, 1])
    bearings = np.linspace(-3.0, 3.0, len(times))
    policy = find_policy(f"zigzag:angle={angle}:leg={leg}", SCENARIOS["BearingsOnly"])
    heading = flown(policy, believe(headings=np.zeros(len(times)), bearings=bearings, times=times))
    np.testing.assert_allclose(np.degrees(wrap(heading - bearings)), sides * angle, rtol=1e-9)


def test_a_zigzag_may_begin_with_a_longer_leg():
    """Eighteen minutes to starboard, then six to each side in turn, port first."""
    minutes = np.array([0, 6, 17, 18, 23, 24, 29, 30, 36])
    sides = np.array([1, 1, 1, -1, -1, 1, 1, -1, 1])
    policy = find_policy("zigzag:angle=105:leg=360:first=1080", SCENARIOS["OwnShipSevere"])
    assert policy.name == "zigzag 105° 360 s, first 1080 s"
    bearings = np.linspace(-3.0, 3.0, len(minutes))
    heading = flown(policy, believe(headings=np.zeros(len(minutes)), bearings=bearings, times=60.0 * minutes))
    np.testing.assert_allclose(np.degrees(wrap(heading - bearings)), sides * 105.0, rtol=1e-9)


def test_a_zigzag_opens_the_range_where_it_is_believed_too_small():
    """The same legs on the same sides, 120° from the line of sight instead of 70°; 130° is wide enough already."""
    offsets = believe(headings=np.zeros(2), bearings=np.zeros(2), times=np.array([0.0, 480.0]))
    away = np.linalg.norm(offsets.mean[:2] - offsets.poses[0].position, axis=0)
    cases = [
        (70.0, 1.01, 120.0),
        (70.0, 0.99, 70.0),
        (130.0, 1.01, 130.0),
        (-60.0, 1.01, -120.0),
        (-130.0, 1.01, -130.0),
    ]
    for angle, keep, expected in cases:
        policy = find_policy(f"zigzag:angle={angle}:leg=480:keep={keep * away[0]}", SCENARIOS["OwnShipModerate"])
        np.testing.assert_allclose(np.degrees(flown(policy, offsets)), [expected, -expected], rtol=1e-9)


@pytest.mark.parametrize("setting", ["first=-1", "keep=-1", "first=inf", "keep=nan", "leg=0"])
def test_impossible_zigzags_are_refused(setting):
    with pytest.raises(PolicyError, match=setting.split("=")[0]):
        find_policy(f"zigzag:{setting}", SCENARIOS["OwnShipModerate"])


@pytest.mark.parametrize("name", SCENARIOS)
def test_zigzag_has_six_legs_of_whole_decisions_unless_told(name):
    scenario = SCENARIOS[name]
    leg = zigzag(scenario).leg
    assert abs(leg - scenario.episode.duration / 6.0) <= 0.5 * scenario.episode.interval
    assert (leg / scenario.episode.interval) == round(leg / scenario.episode.interval)
    assert zigzag(scenario).name == f"zigzag 60° {leg:g} s"


@pytest.mark.parametrize("control", ["heading", "turn_rate"])
@pytest.mark.parametrize("decision_every", [1, 4, 15])
def test_circle_is_a_circle_at_the_maximum_rate(control, decision_every):
    """Radius v/ω about a centre to starboard, whatever the time between decisions."""
    changes = {"platforms.0.control": control, "episode.decision_every": decision_every, "episode.early_end": False}
    env = LocalisationVectorEnv(3, overrides=changes)
    observation, _ = env.reset(seed=0)
    tile = env.batch.tiles[0]
    pose, speed = tile.poses()[0], tile.realised.platforms[0].speed
    radius = speed / math.radians(3.0)
    starboard = np.stack([np.cos(pose.heading), -np.sin(pose.heading)])
    centre = pose.position + radius * starboard
    start = pose.heading.copy()
    distances, headings = [], []
    tile.watchers.append(lambda s: distances.append(np.hypot(*(s.poses()[0].position - centre))))
    tile.watchers.append(lambda s: headings.append(s.poses()[0].heading.copy()))
    for _ in range(120 // decision_every):
        observation, *_ = env.step(Circle().act(observation, env.belief, np.random.default_rng(0)))
    assert len(distances) == 120
    np.testing.assert_allclose(distances, np.broadcast_to(radius, (120, 3)), rtol=1e-9)
    assert_same_angle(headings[29], start + math.radians(90.0))
    assert_same_angle(headings[119], start)


def test_circle_on_the_spot_turns_thirty_degrees_per_decision():
    np.testing.assert_allclose(np.degrees(wrap(flown(Circle(), believe()) - HEADINGS)), 30.0, rtol=1e-9)


def test_random_stays_within_bounds_and_follows_its_generator():
    belief = believe((AGILE, TURNING), times=0.0, headings=np.zeros(500), bearings=0.0)
    first, again, other = (decide(Random(), belief, seed) for seed in (1, 1, 2))
    assert first.shape == (500, 2)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert np.abs(first).max() <= 1.0
    # The mean of 1000 uniform draws in [-1, 1] lies within 5 σ = 5/√3000 of zero; the extremes reach 0.98 surely.
    assert abs(first.mean()) < 5.0 / math.sqrt(3000.0)
    assert first.min() < -0.98
    assert first.max() > 0.98
    assert abs(np.corrcoef(first.T)[0, 1]) < 5.0 / math.sqrt(500.0)


@pytest.mark.parametrize(
    "name", [name for name, s in SCENARIOS.items() if isinstance(s.platforms[0], TurnLimitedPlatform)]
)
def test_stationary_stays_where_it_is(name):
    policy = stationary(SCENARIOS[name])
    env = LocalisationVectorEnv(2, SCENARIOS[name], overrides={**policy.overrides, "episode.early_end": False})
    observation, _ = env.reset(seed=0)
    before = env.belief.poses[0].position.copy()
    for _ in range(3):
        observation, *_ = env.step(policy.act(observation, env.belief, np.random.default_rng(0)))
    pose = env.belief.poses[0]
    assert np.array_equal(pose.position, before)
    assert not pose.velocity.any()
    assert not pose.acceleration.any()


def test_stationary_stops_every_moving_platform():
    fixed, moving = FixedStation(), TurnLimitedPlatform(speed=200.0, max_turn_rate=0.05)
    scenario = SCENARIOS["BearingsOnly"].replace(platforms=(fixed, moving, moving))
    policy = stationary(scenario)
    assert policy.overrides == {"platforms.1.speed": 0.0, "platforms.2.speed": 0.0}
    stopped = scenario.override(policy.overrides)
    assert [platform.speed for platform in stopped.platforms[1:]] == [0.0, 0.0]


LEGS_BY_MINUTE = {
    "OwnShipModerate": [140.0] * 13 + [110.0, 80.0, 50.0] + [20.0] * 16,
    "OwnShipSevere": [-80.0] * 15 + [146.0] * 15,
}
"""Heading from minute k to minute k + 1."""

PUBLISHED_BOUNDS = {
    "OwnShipModerate": {15: 1.34, 20: 0.131, 25: 0.055, 32: 0.089},
    "OwnShipSevere": {30: 0.109},
}
"""Root of the trace of the bound's position block by minute, km."""


def noise_free(name: str) -> Scenario:
    """The case with an emitter that flies exactly straight; tracker and bound still allow for its noise."""
    return SCENARIOS[name].override({"target.motion": ConstantVelocity(), "episode.early_end": False})


@pytest.mark.parametrize("name", LEGS_BY_MINUTE)
def test_published_legs_are_flown_and_give_the_published_bound(name):
    env = LocalisationVectorEnv(1, noise_free(name))
    observation, _ = env.reset(seed=0)
    policy = find_policy("legs", env.scenario)
    positions, bounds = [env.belief.poses[0].position[:, 0].copy()], {}
    for minute in range(1, env.scenario.episode.steps + 1):
        observation, *_ = env.step(policy.act(observation, env.belief, np.random.default_rng(0)))
        positions.append(env.belief.poses[0].position[:, 0].copy())
        bounds[minute] = math.sqrt(np.trace(env.batch.tiles[0].information.bound[:2, :2, 0])) / 1e3
    steps = np.diff(positions, axis=0).T
    assert np.abs(np.degrees(wrap(bearing_of(steps) - np.radians(LEGS_BY_MINUTE[name])))).max() < 1e-9
    np.testing.assert_allclose(np.hypot(*steps), 5 * 0.514 * 60.0)
    # The figures are quoted to two or three digits.
    for minute, published in PUBLISHED_BOUNDS[name].items():
        assert bounds[minute] == pytest.approx(published, rel=0.02), f"minute {minute}"


def test_legs_by_the_clock():
    """A leg holds from its own second on, and rounding of the clock does not delay it."""
    policy = Legs(legs=((0.0, 10.0), (60.0, 20.0), (120.0, -170.0)))
    times = np.array([0.0, 59.9, 60.0 * (1.0 - 1e-15), 60.0, 119.0, 120.0, 500.0])
    headings = flown(policy, believe(headings=np.zeros(len(times)), bearings=0.4, times=times))
    np.testing.assert_allclose(np.degrees(headings), [10.0, 10.0, 20.0, 20.0, 20.0, -170.0, -170.0], rtol=1e-9)


def test_published_legs_begin_at_the_start():
    for name, legs in PUBLISHED_LEGS.items():
        times = [time for time, _ in legs]
        assert times == sorted(times)
        assert times[0] == 0.0
        assert times[-1] < SCENARIOS[name].episode.duration


@pytest.mark.parametrize("platform", [AGILE, SLOW, TURNING])
@pytest.mark.parametrize("name", RULES)
def test_batched_is_one_by_one(name, platform):
    if platform is TURNING and name == "legs":
        platform = TurnLimitedPlatform(speed=1.0, max_turn_rate=1.0, control="turn_rate")
    policy = find_policy(name, SCENARIOS["OwnShipModerate"])
    together = decide(policy, believe((platform,)))
    own = believe((platform,)).poses[0].position
    for index in range(CASES):
        belief = believe((platform,), HEADINGS[[index]], BEARINGS[[index]], TIMES[[index]])
        shift = own[:, [index]] - belief.poses[0].position
        belief.mean[:2] += shift
        belief.poses[0].position = own[:, [index]]
        # Putting the emitter 1 km from another corner costs two roundings of a position.
        np.testing.assert_allclose(decide(policy, belief)[0], together[index], rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["circle", "zigzag", "perpendicular", "fly-at", "straight"])
def test_every_platform_gets_its_own_action(name):
    """Two platforms at different places and headings decide as each would alone; a station takes no action."""
    policy = find_policy(name, SCENARIOS["BearingsOnly"])
    left, right = believe((SLOW,)), believe((TURNING,), HEADINGS[::-1], BEARINGS)
    right.poses[0].position = left.poses[0].position + np.array([[300.0], [-200.0]])
    right.mean = left.mean
    both = believe((SLOW, FixedStation(), TURNING))
    both.poses = [left.poses[0], left.poses[0], right.poses[0]]
    actions = decide(policy, both)
    assert actions.shape == (CASES, 2)
    assert np.array_equal(actions[:, :1], decide(policy, left))
    assert np.array_equal(actions[:, 1:], decide(policy, right))


@pytest.mark.parametrize(("name", "axis"), [("roll", 0), ("yaw", 2)])
def test_body_rates_turn_every_body_and_nothing_else(name, axis):
    """Both satellites turn about the wanted body axis at their largest rate; the axis itself keeps its direction."""
    scenario = SCENARIOS["DualSatellite"]
    policy = find_policy(name, scenario)
    env = LocalisationVectorEnv(2, scenario)
    observation, _ = env.reset(seed=0)
    actions = policy.act(observation, env.belief, np.random.default_rng(0))
    wanted = np.zeros(6)
    wanted[[axis, axis + 3]] = 1.0
    np.testing.assert_array_equal(actions, [wanted, wanted])
    still = find_policy("stationary", scenario).act(observation, env.belief, np.random.default_rng(0))
    np.testing.assert_array_equal(still, np.zeros((2, 6)))
    flying = believe(headings=HEADINGS)
    np.testing.assert_allclose(wrap(flown(policy, flying) - HEADINGS), 0.0, atol=1e-12)
