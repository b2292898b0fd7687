"""The parts of a scenario fit each other, or the scenario says which one does not."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from passloc_env.distributions import Choice, LogUniform, Uniform
from passloc_env.errors import ScenarioError
from passloc_env.motion import ConstantAcceleration, ConstantVelocity, Manoeuvre, UnknownTurn
from passloc_env.platforms import FixedStation, TurnLimitedPlatform
from passloc_env.rewards import RangeBound
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS, environment_id, find
from passloc_env.sensors import Bearing, Doppler, TimeDifference
from passloc_env.simulation import Simulation
from passloc_env.target import CartesianStart, PolarStart
from passloc_env.tracking import StatePrior

Refusal = Callable[..., ScenarioError]

STRAIGHT = Manoeuvre(start=1.0, duration=2.0)
SPACE = {
    "target.start": CartesianStart(position=(1e4, 2e4, 3e3), velocity=(100.0, 0.0, 0.0)),
    "platforms": [FixedStation(position=(0.0, 0.0, 0.0))],
    "prior": StatePrior(position_sigma=1e3, velocity_sigma=50.0),
}
STATION = {"platforms": [FixedStation(position=(0.0, 0.0))]}


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        pytest.param({"sensors.0.platform": 3}, "sensors.0.platform", "known: 0 … 0", id="no such platform"),
        pytest.param(
            {"sensors": [Bearing(sigma=1.0), TimeDifference(sigma=1.0, other=7)]},
            "sensors.1.other",
            "known: 0 … 0",
            id="no such other platform",
        ),
        pytest.param(
            {"sensors": [Doppler(sigma=1.0, carrier=1e9)]},
            "prior.sensor",
            "here []; priors that need no bearing: StatePrior, HeightPrior, PlacePrior",
            id="no bearing for the prior",
        ),
        pytest.param({"sensors.0.lever_arm": (1, 2, 3)}, "sensors.0.lever_arm", "have 2 axes", id="3-D lever arm"),
        pytest.param({"platforms.0.position": (1, 2, 3)}, "platforms.0.position", "2 axes", id="3-D platform"),
        pytest.param({"platforms.0.position": ()}, "platforms.0.position", "2 axes", id="platform nowhere"),
        pytest.param({**SPACE, **STATION}, "platforms.0.position", "3 axes like the emitter", id="flat platform"),
        pytest.param({**SPACE, "prior": Scenario().prior}, "prior.sensor", "planar", id="flat prior"),
        pytest.param(
            {"target.start": {"type": "CartesianStart", "position": [1], "velocity": [1]}},
            "target.start.position",
            "2 or 3 axes",
            id="one axis",
        ),
        pytest.param(
            {"target.start": {"type": "CartesianStart", "position": [1, 2], "velocity": [1, 2, 3]}},
            "target.start.velocity",
            "2 axes like the position",
            id="3-D velocity",
        ),
        pytest.param(
            {"target.start": {"type": "CartesianStart", "position": [1, 2], "velocity": [1, 2], "acceleration": [1]}},
            "target.start.acceleration",
            "be empty or have 2 axes like the position",
            id="1-D acceleration",
        ),
        pytest.param({"prior.sensor": 1}, "prior.sensor", "index of a Bearing sensor; here [0]", id="no such sensor"),
        pytest.param(
            {"sensors": [Doppler(sigma=1.0, carrier=1e9)]},
            "prior.sensor",
            "index of a Bearing",
            id="prior from Doppler",
        ),
        *(
            pytest.param(
                {f"{where}.motion": ConstantVelocity(known_acceleration=(1, 2, 3))},
                f"{where}.motion.known_acceleration",
                "be empty or have 2 axes",
                id=f"3-D acceleration of the {where}",
            )
            for where in ("target", "tracker", "bound")
        ),
        pytest.param({"tracker.motion": STRAIGHT}, "tracker.motion", "the truth alone", id="manoeuvre as a model"),
        pytest.param({"bound.motion": STRAIGHT}, "bound.motion", "the truth alone", id="manoeuvre in the bound"),
        pytest.param({"bound.motion": UnknownTurn()}, "bound.motion", "a linear motion", id="nonlinear bound"),
        pytest.param(
            {"episode.decision_every": 7}, "episode.decision_every", "closest: 6", id="decisions do not divide"
        ),
        pytest.param({"episode.decision_every": 0}, "episode.decision_every", "at least 1", id="no decisions"),
        pytest.param({"episode.steps": 0}, "episode.steps", "at least 1", id="no steps"),
        pytest.param({"episode.steps": 240.0}, "episode.steps", "whole number", id="steps with a point"),
        pytest.param({"episode.period": 0}, "episode.period", "above 0 s", id="zero period"),
        pytest.param({"episode.period": Uniform(1, 2)}, "episode.period", "plain number", id="random period"),
        pytest.param({"episode.min_range": -1}, "episode.min_range", "at least 0 m", id="negative keep-out"),
        pytest.param({"episode.min_range": 20e3}, "episode.min_range", "start range, 20000 m", id="starts inside"),
        pytest.param(
            {"target.start": PolarStart(range=15e3), "episode.min_range": 15e3},
            "episode.min_range",
            "start range, 15000 m",
            id="starts on the edge",
        ),
        pytest.param(
            {"target.start": CartesianStart(position=(3e3, 4e3), velocity=(0, 0))},
            "episode.min_range",
            "start range, 5000 m",
            id="starts inside, by axis",
        ),
        pytest.param(
            {
                "target.start": CartesianStart(position=(30e3, 0), velocity=(0, 0)),
                "platforms": [TurnLimitedPlatform(position=(x, 4e3), speed=1, max_turn_rate=1) for x in (0, 27e3)],
            },
            "episode.min_range",
            "start range, 5000 m",
            id="another commanded platform starts inside",
        ),
        pytest.param(
            {"platforms.0.max_turn_rate": math.inf, "platforms.0.control": "turn_rate"},
            "platforms.0.max_turn_rate",
            "finite with control 'turn_rate'",
            id="infinite turn rate commanded",
        ),
        pytest.param(
            {"platforms.0.max_turn_rate": math.nan}, "platforms.0.max_turn_rate", "above 0", id="NaN turn rate"
        ),
        pytest.param({"reward": [RangeBound(), RangeBound()]}, "reward.1", "named once", id="reward term twice"),
        pytest.param({"tracker.alpha": Uniform(1, 2)}, "tracker.alpha", "a plain number", id="random alpha"),
        pytest.param({"tracker.alpha": 0}, "tracker.alpha", "above 0", id="no spread"),
        pytest.param({"sensors.0.sigma": Uniform(0, 1)}, "sensors.0.sigma", "above 0", id="sigma that may be zero"),
        pytest.param(
            {"sensors.0.detection_probability": Choice((0.5, 1.5))},
            "sensors.0.detection_probability",
            "at most 1",
            id="chance above one",
        ),
        pytest.param({"platforms.0.speed": Uniform(1, 2, True)}, "platforms.0.speed", "at least 0 m/s", id="backwards"),
    ],
)
def test_parts_that_do_not_fit(changes: dict[str, Any], field: str, words: str, refusal: Refusal) -> None:
    error = refusal(Scenario().override, changes)
    assert error.field == field
    assert words in error.allowed


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param(SPACE | {"sensors": [Doppler(sigma=1.0, carrier=1e9)]}, id="space"),
        pytest.param(STATION | {"episode.min_range": 0}, id="nobody moves"),
        pytest.param({"target.motion": STRAIGHT}, id="manoeuvre as the truth"),
        pytest.param({"tracker.motion": UnknownTurn()}, id="nonlinear tracker"),
        pytest.param({"tracker.motion": ConstantAcceleration(), "bound.motion": ConstantAcceleration()}, id="order 2"),
        pytest.param({"sensors.0.lever_arm": (1.0, -2.0)}, id="lever arm"),
        pytest.param({"reward": []}, id="no reward"),
        pytest.param({"episode.min_range": 0.0}, id="no keep-out"),
        pytest.param({"sensors.0.sigma": LogUniform(1e-3, 1e-2), "platforms.0.max_turn_rate": math.inf}, id="random"),
    ],
)
def test_parts_that_fit_run(changes: dict[str, Any], begin: Callable[..., Simulation]) -> None:
    scenario = Scenario().override(changes)
    simulation = begin(scenario, 2)
    for _ in range(3):
        simulation.step(np.full((scenario.action_size, 2), 0.3))
    assert np.isfinite(simulation.reward).all()
    assert np.isfinite(simulation.observe()).all()


def test_kappa_must_leave_a_spread(refusal: Refusal) -> None:
    scenario = Scenario().override({"tracker.kappa": -4.0})
    error = refusal(Simulation, scenario, 1)
    assert error.field.endswith("kappa")
    assert "above -4 with 4 states" in error.allowed


def test_own_ship_is_the_first_that_can_be_commanded() -> None:
    vessel = TurnLimitedPlatform(speed=5.0, max_turn_rate=1.0)
    station = FixedStation(position=(1.0, 0.0))
    scenario = Scenario().override({"platforms": [station, vessel, vessel], "episode.min_range": 0})
    assert (scenario.own_ship, scenario.action_size, scenario.dimension) == (1, 2, 2)
    assert Scenario().override(STATION).own_ship == 0


def test_episode_times() -> None:
    episode = SCENARIOS["BearingsOnlyFar"].override({"episode.period": 0.5}).episode
    assert (episode.interval, episode.duration) == (2.0, 150.0)


@pytest.mark.parametrize("name", SCENARIOS)
def test_scenarios_are_found_by_name_id_data_and_themselves(name: str) -> None:
    scenario = SCENARIOS[name]
    assert find(name) is find(environment_id(name)) is find(scenario) is scenario
    assert find(scenario.to_dict()) == scenario
    assert environment_id(name) == f"passloc/{name}-v0"


@pytest.mark.parametrize(
    ("wanted", "words"),
    [("BearingOnly", "did you mean 'BearingsOnly'"), ("passloc/Nothing-v0", "known: "), (3, "a name")],
)
def test_unknown_scenarios(wanted: Any, words: str, refusal: Refusal) -> None:
    error = refusal(find, wanted)
    assert (error.field, error.value) == ("scenario", wanted)
    assert words in error.allowed


# The published numbers, one by one: a named scenario is frozen.
KNOT, DEGREE = 0.514, math.pi / 180


@pytest.mark.parametrize(
    ("name", "values"),
    [
        (
            "BearingsOnly",
            {
                "target.start.range": Uniform(20e3, 60e3),
                "target.start.speed": Uniform(100, 250),
                "platforms.0.speed": Uniform(200, 250),
                "platforms.0.max_turn_rate": 3 * DEGREE,
                "sensors.0.sigma": 3e-3,
                "prior.range": 40e3,
                "prior.range_sigma": 15e3,
                "prior.velocity_sigma": 127.0,
                "tracker.motion.acceleration_noise": 0.02,
                "bound.motion.acceleration_noise": 0.0,
                "episode.steps": 240,
                "episode.decision_every": 4,
                "episode.min_range": 10e3,
            },
        ),
        (
            "BearingsOnlyFar",
            {"target.start.range": Uniform(40e3, 120e3), "sensors.0.sigma": 17e-3, "episode.steps": 300},
        ),
        (
            "OwnShipModerate",
            {
                "target.start.position": (4920.0, 850.0),
                "target.motion.acceleration_density": 9e-6,
                "platforms.0.speed": 5 * KNOT,
                "sensors.0.sigma": 1.5 * DEGREE,
                "prior.range_sigma": 2e3,
                "prior.speed_sigma": 2 * KNOT,
                "prior.course_sigma": math.pi / math.sqrt(12),
                "prior.min_range": 600.0,
                "prior.min_speed": 0.6 * KNOT,
                "episode.steps": 32,
                "episode.period": 60.0,
                "episode.min_range": 1.5e3,
            },
        ),
        (
            "OwnShipSevere",
            {
                "target.start.position": (7090.9, 7052.6),
                "platforms.0.speed": 5 * KNOT,
                "sensors.0.sigma": 2 * DEGREE,
                "prior.range_sigma": 4e3,
                "episode.steps": 30,
                "episode.min_range": 2e3,
            },
        ),
        (
            "BearingDoppler",
            {
                "sensors.0.sigma": 3e-3,
                "sensors.1.sigma": 10.0,
                "sensors.1.carrier": 3e9,
                "sensors.1.carrier_sigma": 0.0,
                "target.motion.start": Uniform(0, 144),
                "target.motion.duration": Uniform(40, 100),
                "target.motion.acceleration": Choice((-1.0, 1.0)),
                "tracker.motion.acceleration_noise": 3.0,
                "bound.motion.acceleration_noise": 3.0,
            },
        ),
        ("BearingDopplerUnknownCarrier", {"sensors.1.carrier": 3e9, "sensors.1.carrier_sigma": 10e3}),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_named_scenarios_keep_their_numbers(name: str, values: dict[str, Any]) -> None:
    scenario = SCENARIOS[name]
    for field, value in values.items():
        found: Any = scenario
        for key in field.split("."):
            found = found[int(key)] if key.isdigit() else getattr(found, key)
        if isinstance(value, float):
            assert found == pytest.approx(value, rel=1e-12), field
        else:
            assert found == (pytest.approx(value) if isinstance(value, tuple) else value), field


@pytest.mark.parametrize(("name", "knots", "course"), [("OwnShipModerate", 4, -140.0), ("OwnShipSevere", 15, -135.4)])
def test_own_ship_targets_sail_as_published(name: str, knots: float, course: float) -> None:
    east, north = SCENARIOS[name].target.start.velocity
    assert math.hypot(east, north) == pytest.approx(knots * KNOT)
    assert math.degrees(math.atan2(east, north)) == pytest.approx(course)
