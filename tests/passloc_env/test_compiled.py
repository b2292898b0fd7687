"""What flies as straight-line code is what the simulation's own methods do, to the last bit, signs of zeros aside."""

import copy
import itertools
from dataclasses import dataclass

import numpy as np
import pytest

from passloc_env import SCENARIOS, Scenario
from passloc_env.compiled.graph import Graph, TraceError, function
from passloc_env.compiled.instructions import INSTRUCTIONS
from passloc_env.compiled.machine import Machine
from passloc_env.compiled.stage import Stage
from passloc_env.compiled.traced import symbols
from passloc_env.sensors import Bearing
from passloc_env.simulation import Simulation

BY_METHODS_ALONE = {"CrossFix"}
"""Its tracker keeps what was heard at places that depend on how many looks there were."""

DOPPLER = SCENARIOS["BearingDoppler"].override({"episode.early_end": False})


def begin(scenario: Scenario, environments: int, straight: bool = True) -> Simulation:
    simulation = Simulation(scenario, environments, straight=straight)
    simulation.reset(np.arange(environments), [np.random.default_rng(index) for index in range(environments)])
    return simulation


def pair(scenario: Scenario, environments: int) -> tuple[Simulation, Simulation]:
    return begin(scenario, environments), begin(scenario, environments, straight=False)


def fly(simulations, decisions: int) -> None:
    """The same actions to all; everything must stay equal."""
    first = simulations[0]
    random = np.random.default_rng(7)
    for _ in range(decisions):
        action = random.uniform(-1.2, 1.2, first.action.shape)
        for simulation in simulations:
            simulation.step(action)
        assert_same(*simulations)


def assert_same(flown: Simulation, by_methods: Simulation) -> None:
    expected = by_methods.state_arrays()
    for name, found in flown.state_arrays().items():
        np.testing.assert_array_equal(found, expected[name], err_msg=name)
    np.testing.assert_array_equal(flown.observe(), by_methods.observe())
    np.testing.assert_array_equal(flown.outcome.nees, by_methods.outcome.nees)
    if by_methods.detected is None:
        assert flown.detected is None
    else:
        np.testing.assert_array_equal(flown.detected, by_methods.detected)


@pytest.mark.parametrize("environments", [1, 6])
@pytest.mark.parametrize("name", SCENARIOS)
def test_every_scenario_flies_as_its_methods_say(name: str, environments: int) -> None:
    simulations = pair(SCENARIOS[name], environments)
    fly(simulations, min(6, simulations[0].scenario.episode.steps // simulations[0].scenario.episode.decision_every))
    assert (simulations[0].flight is None) == (name in BY_METHODS_ALONE)
    assert simulations[1].flight is None


@pytest.mark.parametrize("decision_every", [1, 3, 5])
@pytest.mark.parametrize("environments", [1, 4])
def test_any_number_of_sensor_steps_per_decision(decision_every: int, environments: int) -> None:
    scenario = DOPPLER.override({"episode.steps": 30, "episode.decision_every": decision_every})
    simulations = pair(scenario, environments)
    fly(simulations, 30 // decision_every)
    assert simulations[0].flight is not None


@pytest.mark.parametrize("environments", [1, 4])
def test_missed_detections(environments: int) -> None:
    scenario = DOPPLER.override({"sensors.0.detection_probability": 0.6})
    simulations = pair(scenario, environments)
    fly(simulations, 10)
    assert simulations[0].flight is not None


@pytest.mark.parametrize("gate", [0.0, 0.8])
@pytest.mark.parametrize("environments", [1, 4])
@pytest.mark.parametrize("tracker", ["SquareRootKalman", "RangeBank", "InteractingModels"])
def test_trackers_that_miss_and_refuse(tracker: str, environments: int, gate: float) -> None:
    """The models hold different states; bearings and Dopplers go missing one by one."""
    changes = {"tracker": {"type": tracker, "gate": gate}, "episode.early_end": False}
    missing = {f"sensors.{index}.detection_probability": 0.7 for index in range(2)}
    simulations = pair(SCENARIOS["BearingDopplerUnknownCarrier"].override(changes | missing), environments)
    fly(simulations, 10)
    assert simulations[0].flight is not None
    assert simulations[0].flight.repeated == 0
    assert (simulations[0].track.gated > 0).all() == bool(gate)


RANDOM = {"type": "Uniform", "low": 0.01, "high": 0.1}
"""Numbers that the matrices of tracker, bound and noise are made of, drawn anew at every reset."""


@pytest.mark.parametrize("environments", [1, 4])
@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("BearingsOnly", ["sensors.Bearing.sigma"]),
        ("BearingDoppler", ["sensors.Bearing.sigma", "sensors.Doppler.sigma"]),
        ("BearingDopplerUnknownCarrier", ["sensors.Doppler.carrier_walk"]),
        ("BearingDoppler", ["tracker.motion.acceleration_noise", "bound.motion.acceleration_noise"]),
    ],
)
def test_matrices_of_random_numbers(name: str, fields: list[str], environments: int) -> None:
    scenario = SCENARIOS[name].override({"episode.early_end": False, **dict.fromkeys(fields, RANDOM)})
    simulations = pair(scenario, environments)
    fly(simulations, 2)
    assert simulations[0].models.volatile
    assert simulations[0].flight is not None
    for simulation in simulations:
        simulation.reset(np.arange(1), [np.random.default_rng(99)])
    fly(simulations, 2)


@pytest.mark.parametrize("environments", [1, 4])
def test_what_is_out_of_the_ordinary_is_done_by_the_methods(environments: int) -> None:
    """A covariance that is none, and an emitter on top of the observer: repaired and unheard as ever."""
    flown, by_methods = simulations = pair(DOPPLER, environments)
    fly(simulations, 2)
    assert flown.flight is not None
    assert flown.flight.repeated == 0
    for simulation in simulations:
        covariance = simulation.track.covariance
        covariance[0, 1, -1] = covariance[1, 0, -1] = 2.0 * np.sqrt(covariance[0, 0, -1] * covariance[1, 1, -1])
    fly(simulations, 1)
    assert flown.flight.repeated == 1
    assert by_methods.track.repairs[-1] == 1
    for simulation in simulations:
        simulation.platform_states[0][:2] = simulation.truth[:2] + 1e-5
        simulation.platform_states[0][4:] = simulation.truth[2:] = 0.0
    fly(simulations, 1)
    assert flown.flight.repeated > 1


@pytest.mark.parametrize("part", ["mean", "covariance"])
@pytest.mark.parametrize("environments", [1, 4])
def test_a_belief_that_is_no_number_raises_nothing(environments: int, part: str) -> None:
    simulations = pair(DOPPLER, environments)
    fly(simulations, 1)
    for simulation in simulations:
        getattr(simulation.track, part)[..., -1] = np.nan
    fly(simulations, 2)
    assert simulations[0].track.repairs[-1] > 0


@pytest.mark.parametrize("environments", [1, 3])
def test_watchers_see_every_sensor_step_and_may_meddle(environments: int) -> None:
    simulations = pair(DOPPLER, environments)
    seen: list[list[float]] = [[], []]
    for record, simulation in zip(seen, simulations, strict=True):

        def watch(world: Simulation, record: list[float] = record) -> None:
            record.append(float(world.outcome.range_sigma[0] + world.track.mean[0, 0]))
            world.track.mean[:2] += 1.0

        simulation.watchers.append(watch)
    fly(simulations, 3)
    assert len(seen[0]) == 3 * DOPPLER.episode.decision_every
    assert seen[0] == seen[1]
    assert simulations[0].flight is not None


@dataclass(frozen=True, kw_only=True)
class Forgetful(Bearing):
    """A bearing that gets worse with every look: it keeps a memory of its own."""

    def measure(self, scene):
        looks = self.__dict__.setdefault("looks", [])
        looks.append(None)
        return super().measure(scene) + 1e-3 * len(looks) ** 2


@dataclass(frozen=True, kw_only=True)
class ShortSighted(Bearing):
    """A bearing of another kind when anything is near, as a user would write it: by a branch."""

    def measure(self, scene):
        bearing = super().measure(scene)
        return 0.5 * bearing if (scene.sightline(0).range < 60e3).any() else bearing


@dataclass(frozen=True, kw_only=True)
class Numbers(Bearing):
    """A bearing by way of Python's own numbers."""

    def measure(self, scene):
        bearing = super().measure(scene)
        return bearing + 0.0 * float(bearing.reshape(-1)[0])


@pytest.mark.parametrize("sensor", [Forgetful, Numbers])
def test_components_that_no_straight_line_can_express_fly_by_their_methods(sensor) -> None:
    simulation = begin(SCENARIOS["BearingsOnly"].replace(sensors=(sensor(sigma=0.01),)), 3)
    simulation.step(np.zeros((1, 3)))
    assert simulation.flight is None


@pytest.mark.parametrize("environments", [1, 5])
def test_a_branch_becomes_a_guard(environments: int) -> None:
    scenario = SCENARIOS["BearingsOnly"].replace(sensors=(ShortSighted(sigma=0.01),))
    scenario = scenario.override({"episode.early_end": False, "target.start.range": 62e3})
    simulations = pair(scenario, environments)
    fly(simulations, 20)
    assert simulations[0].flight is not None
    assert simulations[0].flight.repeated > 0


@pytest.mark.parametrize("name", SCENARIOS)
def test_some_begin_anew_as_their_methods_say(name: str) -> None:
    simulations = pair(SCENARIOS[name].override({"episode.early_end": False}), 7)
    for columns in ([4], [0, 5, 6], [3, 1], list(range(7))):
        fly(simulations, 1)
        for simulation in simulations:
            generators = [np.random.default_rng([column, 5]) for column in columns]
            simulation.reset(np.array(columns), generators)
        assert_same(*simulations)


def test_openings_are_flown(monkeypatch) -> None:
    """All of them, in a batch that takes its environments in chunks, the last of these in part."""
    flown, by_methods = pair(DOPPLER, 1500)
    monkeypatch.setattr(Simulation, "open", None)
    columns = np.arange(1400)[::-1]
    for simulation in (flown, by_methods):
        monkeypatch.undo() if simulation is by_methods else None
        simulation.reset(columns, [np.random.default_rng([column, 5]) for column in columns])
    assert_same(flown, by_methods)


def test_clones_fly_on_their_own() -> None:
    flown, _ = pair(DOPPLER, 3)
    flown.step(np.zeros((1, 3)))
    twin = copy.deepcopy(flown)
    assert twin.flight is None
    twin.step(np.full((1, 3), 0.5))
    flown.step(np.full((1, 3), 0.5))
    assert_same(twin, flown)


def test_scenarios_that_differ_in_a_number_differ_in_what_is_flown() -> None:
    first, second = pair(DOPPLER, 2), pair(DOPPLER.override({"sensors.0.sigma": 0.02}), 2)
    fly(first, 2)
    fly(second, 2)
    assert (first[0].track.mean != second[0].track.mean).any()


AWKWARD = [0.0, -0.0, 1.0, -1.0, 0.5, 1.5, 2.5, -2.5, 3.7, 1e-310, 1e300, -1e300]
NOT_FINITE = [np.inf, -np.inf, np.nan]
LOGICAL = {"logical_and", "bitwise_and", "logical_or", "bitwise_or", "logical_not", "invert"}


@pytest.mark.parametrize("lanes", [1, 2, 4, 8])
@pytest.mark.parametrize("name", sorted(INSTRUCTIONS))
def test_machine_code_does_what_numpy_does(name: str, lanes: int) -> None:
    """Every operation on awkward numbers, in so many environments that some are left for the end."""
    count = getattr(function(name), "nin", 3)
    numbers = [True, False] if name in LOGICAL else AWKWARD + NOT_FINITE
    cases = list(itertools.product(*[numbers] * count))
    columns = [np.array(column) for column in zip(*cases, strict=True)]
    if name == "where":
        columns[0] = columns[0] > 0.0
    graph = Graph()
    inputs = [graph.input(column[0].item()) for column in columns]
    result = graph.apply(name, tuple(inputs))
    slots = {("in", index): node for index, node in enumerate(inputs)}
    stage = Stage(slots, {("out", 0): result}, None, graph.order([result]))
    with np.errstate(all="ignore"):
        expected = function(name)(*columns)
    found = np.full(expected.shape, 7, expected.dtype)
    machine = Machine(stage, lanes=lanes)
    scratch = np.empty((machine.scratch, len(found)))
    assert machine(dict(zip(slots, columns, strict=True)), {("out", 0): found}, scratch)()
    np.testing.assert_array_equal(found, expected)


def test_symbols_refuse_what_they_cannot_be() -> None:
    array = symbols(Graph(), np.arange(3.0))
    with pytest.raises(TraceError):
        np.sort(array)
    with pytest.raises(TraceError):
        np.add(array, 1.0, out=np.empty((3, 1)))
    with pytest.raises(TraceError):
        float(array[0, 0])
