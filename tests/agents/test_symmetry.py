"""Port and starboard against worlds that are mirrored indeed, and agents that fly by their symmetry and shield."""

import dataclasses
import json

import numpy as np
import pytest
from scipy.linalg import block_diag

from agents import AgentFile, AgentFileError, LearnedPolicy
from agents.agent_file import CARD
from agents.shield import Shield
from agents.symmetry import MirrorSymmetry
from passloc_env import SCENARIOS, LocalisationVectorEnv, observation_names
from passloc_env.errors import InputError
from passloc_env.motion import UnknownTurn
from passloc_env.platforms import FixedStation, PlanarPose, Pose, TurnLimitedPlatform
from passloc_env.sensors import Bearing
from passloc_env.simulation import Simulation

AIRCRAFT = SCENARIOS["BearingsOnly"]
STATION = FixedStation(position=(5e3, 1e3))
PLANAR = {name: scenario for name, scenario in SCENARIOS.items() if name != "DualSatellite"} | {
    "an own ship and a station": AIRCRAFT.override(
        {
            "platforms": [STATION, AIRCRAFT.platforms[0]],
            "sensors": [Bearing(sigma=0.01), Bearing(sigma=0.01, platform=1)],
        }
    ),
    "two own ships": AIRCRAFT.override(
        {
            "platforms": [
                AIRCRAFT.platforms[0],
                TurnLimitedPlatform(
                    position=(5e3, 2e3), heading=1.0, speed=200.0, max_turn_rate=0.05, control="turn_rate"
                ),
            ],
            "sensors": [Bearing(sigma=0.01), Bearing(sigma=0.01, platform=1)],
        }
    ),
    "turning at an unknown rate": AIRCRAFT.override(
        {"tracker.motion": UnknownTurn(acceleration_noise=0.1, turn_rate_noise=1e-3)}
    ),
}
ENVIRONMENTS = 8
FLIP = np.array([[-1.0], [1.0]])


def begun(scenario, environments=ENVIRONMENTS):
    simulation = Simulation(scenario, environments)
    simulation.reset(np.arange(environments), [np.random.default_rng(column) for column in range(environments)])
    return simulation


def plane(layout):
    """The mirror of a state: east changes its sign, and so does a turn rate; a carrier does not."""
    nuisances = [-1.0 if name == "turn_rate" else 1.0 for name in layout.nuisance]
    return block_diag(*[np.diag([-1.0, 1.0])] * (layout.order + 1), np.diag(nuisances))[: layout.size, : layout.size]


def mirrored_pose(pose):
    if isinstance(pose, PlanarPose):
        return PlanarPose(FLIP * pose.position, FLIP * pose.velocity, -pose.heading, -pose.turn_rate)
    return Pose(FLIP * pose.position, FLIP * pose.velocity)


def mirrored_belief(belief):
    """The belief of somebody in the mirror."""
    swap = plane(belief.layout)
    return dataclasses.replace(
        belief,
        mean=swap @ belief.mean,
        covariance=np.einsum("ia,abN,jb->ijN", swap, belief.covariance, swap),
        poses=[mirrored_pose(pose) for pose in belief.poses],
        last_action=-belief.last_action,
    )


def hold_a_mirror(simulation):
    """Mirror a world of bearings alone as it stands: its truth, platforms, belief, and the errors still to come."""
    layout = simulation.models.tracker.layout
    swap = plane(layout)
    simulation.truth[:2] *= FLIP
    simulation.truth[2:4] *= FLIP
    simulation.track.mean[...] = swap @ simulation.track.mean
    simulation.track.covariance[...] = np.einsum("ia,abN,jb->ijN", swap, simulation.track.covariance, swap)
    for state in simulation.platform_states:
        state[[0, 2, 3, 4] if len(state) > 2 else [0]] *= -1.0  # east, heading, turn rate, forward east
    simulation.noise._measurement *= -1.0


def agent(scenario=AIRCRAFT, seed=0, **card):
    """An agent with random weights, large enough for actions of every size, and what its card says beside."""
    rng = np.random.default_rng(seed)
    features, actions = len(observation_names(scenario)), scenario.action_size
    sizes = {"actor": [features, 16, actions]}
    weights = {
        f"{network}.{layer}.{kind}": rng.normal(
            0.0, 0.1, (widths[layer + 1], widths[layer]) if kind == "weight" else widths[layer + 1]
        ).astype(np.float32)
        for network, widths in sizes.items()
        for layer in range(2)
        for kind in ("weight", "bias")
    }
    told = {
        "architecture": sizes,
        "observation": list(observation_names(scenario)),
        "scenario": scenario.to_dict(),
        "training": {},
    }
    return AgentFile(weights, told | card)


def experienced(scenario, seed=0):
    """A simulation after five random decisions, when its belief is neither diagonal nor the prior."""
    simulation = begun(scenario)
    rng = np.random.default_rng(seed)
    for _ in range(5):
        simulation.step(rng.uniform(-1.0, 1.0, (scenario.action_size, ENVIRONMENTS)))
    return simulation


@pytest.mark.parametrize("scenario", PLANAR.values(), ids=list(PLANAR))
def test_parity_is_what_a_mirror_does(scenario):
    """1e-9: a rotation of a covariance whose condition number may reach 1e6 costs about that many ulp."""
    belief = experienced(scenario).belief
    observe, parity = scenario.observation.observe, MirrorSymmetry(scenario).parity
    features = observe(belief)
    assert parity.shape == (len(features),)
    assert parity.dtype == np.float32
    np.testing.assert_allclose(observe(mirrored_belief(belief)), parity[:, None] * features, rtol=1e-9, atol=1e-9)
    # None of the signs goes unnoticed, but that of what is zero.
    telling = np.abs(features).max(axis=1) > 1e-6
    assert {-1.0, 1.0} == set(parity[telling].tolist())
    assert telling.mean() > 0.6


@pytest.mark.parametrize("scenario", PLANAR.values(), ids=list(PLANAR))
def test_the_mirrored_world_looks_the_same_from_the_other_side(scenario):
    """Whatever side it lies on, the observation shown is one and the same; the side tells which."""
    belief, symmetry = experienced(scenario).belief, MirrorSymmetry(scenario)
    here = scenario.observation.observe(belief).T.astype(np.float32)
    there = scenario.observation.observe(mirrored_belief(belief)).T.astype(np.float32)
    sides, other = symmetry.sides(here), symmetry.sides(there)
    assert (sides.shape, sides.dtype) == ((ENVIRONMENTS, 1), np.float32)
    np.testing.assert_array_equal(other, -sides)
    shown = symmetry.mirrored(here, sides)
    # 1e-6: one unit in the last place of float32 features below 10.
    np.testing.assert_allclose(symmetry.mirrored(there, other), shown, rtol=0, atol=1e-6)
    assert (symmetry.sides(shown) == 1.0).all()


def test_sides_by_hand():
    """From the own ship's velocity and line of sight: starboard is where the bearing grows."""
    simulation = experienced(AIRCRAFT)
    belief = simulation.belief
    course = np.arctan2(*belief.poses[0].velocity)
    expected = np.where(np.sin(course - belief.bearing) < 0.0, -1.0, 1.0)
    sides = MirrorSymmetry(AIRCRAFT).sides(simulation.observe().T.astype(np.float32))
    assert sides[:, 0].tolist() == expected.tolist()
    assert set(expected) == {-1.0, 1.0}


def test_a_tie_goes_to_starboard():
    """Zero of either sign, and the smallest numbers to either side of it."""
    index = observation_names(AIRCRAFT).index("own velocity across")
    tiny = np.finfo(np.float32).smallest_subnormal
    observation = np.ones((4, len(observation_names(AIRCRAFT))), np.float32)
    observation[:, index] = [0.0, -0.0, tiny, -tiny]
    symmetry = MirrorSymmetry(AIRCRAFT)
    sides = symmetry.sides(observation)
    assert sides[:, 0].tolist() == [1.0, 1.0, 1.0, -1.0]
    assert symmetry.mirrored(observation, sides)[:3].tobytes() == observation[:3].tobytes()


def test_mirrored_twice_is_the_original_to_the_last_bit():
    symmetry = MirrorSymmetry(AIRCRAFT)
    observation = np.random.default_rng(0).normal(size=(50, len(symmetry.parity))).astype(np.float32)
    sides = np.where(np.arange(50) % 3 == 0, np.float32(-1.0), np.float32(1.0))[:, None]
    before = observation.copy()
    once = symmetry.mirrored(observation, sides)
    assert once.dtype == np.float32
    assert observation.tobytes() == before.tobytes()
    assert (once != observation).any(axis=1).tolist() == (sides[:, 0] < 0.0).tolist()
    assert symmetry.mirrored(once, sides).tobytes() == observation.tobytes()


def test_what_steers_more_than_headings_is_refused():
    with pytest.raises(InputError) as caught:
        MirrorSymmetry(SCENARIOS["DualSatellite"])
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith("mirror = True is not possible")
    assert "DualSatellite" in message


@pytest.mark.parametrize("scenario", [AIRCRAFT, SCENARIOS["CrossFix"]], ids=["one", "three"])
def test_an_agent_with_a_mirror_is_odd(scenario):
    """Mirrored observations, mirrored actions, in every component and to the last bit; without the card's word not."""
    symmetry = MirrorSymmetry(scenario)
    here = np.random.default_rng(0).normal(size=(40, len(symmetry.parity))).astype(np.float32)
    policy, bare = LearnedPolicy(agent(scenario, mirror=True)), LearnedPolicy(agent(scenario))
    found, other = (policy.act(seen, None, None) for seen in (here, here * symmetry.parity))
    assert found.shape == (40, scenario.action_size)
    assert other.tobytes() == (-found).tobytes()
    starboard = symmetry.sides(here)[:, 0] > 0.0
    assert 5 < starboard.sum() < 35
    # 1e-6: a float32 matrix product of another number of rows.
    expected = np.where(starboard[:, None], bare.act(here, None, None), -bare.act(here * symmetry.parity, None, None))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)
    assert np.abs(found - bare.act(here, None, None))[~starboard].max() > 0.1
    assert np.abs(found).max() <= 1.0


def fly_both(policy, scenario, decisions=30):
    """Worlds and their mirror images under one policy: both simulations, and the actions in each ``(T, N, a)``."""
    worlds = experienced(scenario), experienced(scenario)
    hold_a_mirror(worlds[1])
    worlds[1].action *= -1.0
    taken = [[], []]
    for _ in range(decisions):
        for world, actions in zip(worlds, taken, strict=True):
            action = policy.act(world.observe().T.astype(np.float32), world.belief, np.random.default_rng(0))
            actions.append(action)
            world.step(action.T.astype(float))
    return worlds, np.array(taken[0]), np.array(taken[1])


@pytest.mark.parametrize("name", ["BearingsOnly", "an own ship and a station", "two own ships"])
def test_in_a_mirrored_world_it_flies_the_mirrored_flight(name):
    """Thirty decisions, errors mirrored too; 1e-3: float32 observations, fed back through what they make it do."""
    scenario = PLANAR[name].override({"episode.early_end": False})
    (here, there), actions, mirrored = fly_both(LearnedPolicy(agent(scenario, mirror=True)), scenario)
    assert (np.abs(actions) < 1.0).mean() > 0.3
    # ±π is one heading.
    np.testing.assert_allclose(np.sin(np.pi * mirrored), -np.sin(np.pi * actions), rtol=0, atol=1e-3)
    for state, other in zip(here.platform_states, there.platform_states, strict=True):
        # Flights of 26 km.
        np.testing.assert_allclose(FLIP * other[:2], state[:2], rtol=0, atol=26.0)
    error = here.outcome.relative_range_error
    np.testing.assert_allclose(there.outcome.relative_range_error, error, rtol=0, atol=1e-3)
    _, actions, others = fly_both(LearnedPolicy(agent(scenario)), scenario)
    assert np.abs(np.sin(np.pi * others) + np.sin(np.pi * actions)).max() > 0.1


def near(scenario=AIRCRAFT, environments=40):
    """A belief after flying at the emitter, and the observation of it."""
    env = LocalisationVectorEnv(environments, scenario, overrides={"episode.early_end": False})
    observation, _ = env.reset(seed=0)
    for _ in range(22):
        observation, *_ = env.step(np.zeros((environments, 1)))
    return observation, env.belief


@pytest.mark.parametrize("mirror", [False, True])
def test_an_agent_flies_behind_the_shield_of_its_card(mirror):
    """Its own wishes, mirrored back, guarded by as many deviations as the card says."""
    observation, belief = near()
    wishes = LearnedPolicy(agent(mirror=mirror)).act(observation, belief, None)
    for sigmas in (0.5, 6.0):
        policy = LearnedPolicy(agent(mirror=mirror, shield_sigmas=sigmas))
        found = policy.act(observation, belief, None)
        assert found.tobytes() == Shield(sigmas).guard(belief, wishes).tobytes()
        assert 0 < (found != wishes).sum() < found.size


def test_without_a_belief_or_a_word_in_the_card_it_flies_bare():
    """Agents from before there were mirrors and shields fly as they did."""
    observation, belief = near()
    old = LearnedPolicy(agent()).act(observation, belief, None)
    for card in ({"mirror": False, "shield_sigmas": 0.0}, {"mirror": False}, {"shield_sigmas": 0}):
        assert LearnedPolicy(agent(**card)).act(observation, belief, None).tobytes() == old.tobytes()
    assert LearnedPolicy(agent(shield_sigmas=6.0)).act(observation, None, None).tobytes() == old.tobytes()


def test_mirror_and_shield_survive_the_file(tmp_path):
    observation, belief = near()
    made = agent(mirror=True, shield_sigmas=2.5)
    made.save(tmp_path)
    loaded = LearnedPolicy.load(tmp_path, AIRCRAFT)
    card = json.loads((tmp_path / CARD).read_text(encoding="utf-8"))
    assert (card["mirror"], card["shield_sigmas"]) == (True, 2.5)
    expected = LearnedPolicy(made).act(observation, belief, None)
    assert loaded.act(observation, belief, None).tobytes() == expected.tobytes()


@pytest.mark.parametrize(
    "change",
    [
        {"shield_sigmas": "many"},
        {"shield_sigmas": [1.5]},
        {"shield_sigmas": None},
        {"shield_sigmas": True},
        {"shield_sigmas": -1.0},
        {"shield_sigmas": float("nan")},
        {"shield_sigmas": float("inf")},
        {"mirror": "no"},
        {"mirror": 1},
        {"mirror": None},
    ],
    ids=str,
)
def test_a_card_with_an_impossible_mirror_or_shield_is_refused(tmp_path, change):
    """One line that names the file, as for everything else that a card may get wrong."""
    agent(mirror=True, shield_sigmas=1.5).save(tmp_path)
    path = tmp_path / CARD
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")) | change), encoding="utf-8")
    with pytest.raises(AgentFileError) as caught:
        LearnedPolicy.load(tmp_path, AIRCRAFT)
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_card_whose_scenario_has_no_mirror_is_refused(tmp_path):
    scenario = SCENARIOS["DualSatellite"]
    agent(scenario, mirror=True).save(tmp_path)
    with pytest.raises(InputError) as caught:
        LearnedPolicy.load(tmp_path, scenario)
    assert "mirror" in str(caught.value)
    assert "\n" not in str(caught.value)
