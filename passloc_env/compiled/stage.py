"""A stage of the simulation, traced: the graph of one environment's arithmetic, with named inputs and outputs.

Every stage is a method of :class:`~passloc_env.world.World`. A copy of a small simulation, whose arrays are
symbols, runs it once; what then stands in the arrays is what the stage computes.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from passloc_env.compiled.graph import Drawn, Graph, Node, TraceError, Value
from passloc_env.compiled.traced import Traced, symbols
from passloc_env.noise import EpisodeNoise, NavigationErrors, Opening, StepNoise

Slot = tuple[str, int]
"""One number of every environment: the name of an array, and which of its rows, counted in C order."""

FIRST: Slot = ("argument.first_cell", 0)
"""Where every environment's steps begin among those of all; see :meth:`~passloc_env.noise.EpisodeNoise.tables`."""

COLUMN: Slot = ("argument.column", 0)
"""Which environments are meant where only some are."""


@dataclass
class Stage:
    """What one stage computes.

    Attributes:
        inputs: where its inputs are read.
        outputs: where its results go, only those that differ from what was there.
        guard: whether the graph stands for the code; None when it always does.
        order: its operations.
        kinds: what the arrays are made of that inputs and outputs are rows of; those left out hold what is put there.
    """

    inputs: dict[Slot, Node]
    outputs: dict[Slot, Value]
    guard: Value | None
    order: list[Node]
    kinds: Mapping[str, np.dtype[Any]] = field(default_factory=dict)


OPENING = ("opening.uniforms", "opening.prior", "opening.nuisances")
"""What chance has in store for the beginning of an episode, by name."""

NoiseAhead = Callable[[int], StepNoise]
"""The noise of the step so many steps ahead of where an environment stands."""

StageCode = Callable[[Any, dict[str, Any], NoiseAhead], dict[str, Traced] | None]
"""Runs a stage on a simulation of symbols, given the arguments by name; returns results that are no state."""


def begin(simulation: Any, arguments: dict[str, Any], noise: NoiseAhead) -> None:
    """Begin an episode."""
    uniforms, prior, nuisances = (arguments[name] for name in OPENING)
    simulation.open(np.arange(1), Opening(uniforms, prior, nuisances, noise(0)))


def decide(simulation: Any, arguments: dict[str, Any], noise: NoiseAhead) -> None:
    """Take an action."""
    simulation.decide(arguments["argument.action"], noise(0))


def sense(simulation: Any, arguments: dict[str, Any], noise: NoiseAhead) -> dict[str, Traced] | None:
    """One sensor step, with the matrices that the numbers of the episode make."""
    simulation.rebuild_models()
    simulation.advance(noise(1), before=noise(0))
    return None if simulation.detected is None else {"result.detected": simulation.detected}


def conclude(simulation: Any, arguments: dict[str, Any], noise: NoiseAhead) -> None:
    """Average the decision's reward and raise the flags."""
    simulation.outcome = simulation.look(simulation.scene())
    simulation.conclude()


def observe(simulation: Any, arguments: dict[str, Any], noise: NoiseAhead) -> dict[str, Traced]:
    """What the agent sees."""
    belief = simulation.belief_at(simulation.time, noise(0))
    return {"result.observation": simulation.realised.observation.observe(belief)}


STAGES: dict[str, StageCode] = {
    "open": begin,
    "decide": decide,
    "sense": sense,
    "conclude": conclude,
    "observe": observe,
}


def live_arrays(simulation: Any) -> dict[str, np.ndarray]:
    """The state of a simulation by name, but for the noise of whole episodes."""
    arrays: dict[str, np.ndarray] = simulation.state_arrays()
    return {name: array for name, array in arrays.items() if not name.startswith("noise.")}


def episode_arrays(noise: EpisodeNoise) -> dict[str, np.ndarray]:
    """What chance has in store for whole episodes by name: their openings, and the errors that never change."""
    opening = noise.opening()
    arrays = dict(zip(OPENING, (opening.uniforms, opening.prior, opening.nuisances), strict=True))
    return arrays | {f"constant.{platform}": errors for platform, errors in enumerate(noise.constants())}


def _noise(graph: Graph, step: Value, simulation: Any, known: Mapping[str, Traced]) -> StepNoise:
    """The noise of a step: looked up, but for what is the same throughout an episode."""

    def drawn(kind: str, values: np.ndarray) -> Traced:
        nodes = np.empty((len(values), 1), dtype=object)
        for index, (value,) in enumerate(values.tolist()):
            nodes[index, 0] = Drawn(graph, (f"step.{kind}", index), step, value)
        return nodes.view(Traced)

    example = simulation.noise_at()
    navigation = [
        NavigationErrors(known[f"constant.{platform}"], drawn(f"fresh.{platform}", errors.fresh))
        for platform, errors in enumerate(example.navigation)
    ]
    measurement, process, detection, fault = (
        drawn(kind, getattr(example, kind)) for kind in ("measurement", "process", "detection", "fault")
    )
    return StepNoise(measurement, process, detection, fault, navigation)


def trace(simulation: Any, name: str) -> Stage:
    """Trace a stage on the first environment of a simulation in flight.

    Raises:
        TraceError: its code is no straight-line arithmetic.
    """
    graph = Graph()
    live = live_arrays(simulation)
    arguments = {"argument.action": simulation.action, **episode_arrays(simulation.noise)}
    examples = live | arguments
    known = {key: _tied(key, symbols(graph, array[..., 0])) for key, array in examples.items()}
    before = {key: array.copy() for key, array in known.items()}
    memo: dict[int, Any] = {id(array): known[key] for key, array in live.items()}
    memo[id(simulation.noise)] = memo[id(simulation.watchers)] = None
    memo[id(simulation.outcome)] = None
    # What is about to begin has no count yet.
    count = 0 if name == "open" else known["simulation.step_count"].item()

    def noise(ahead: int) -> StepNoise:
        step = graph.apply("add", (count, ahead)) if ahead else count
        last = simulation.scenario.episode.steps
        return _noise(graph, graph.apply("minimum", (step, last)), simulation, known)

    try:
        twin = copy.deepcopy(simulation, memo)
        results = STAGES[name](twin, {key: known[key] for key in arguments}, noise)
    except TraceError:
        raise
    except Exception as error:
        raise TraceError(f"{name}: {type(error).__name__}: {error}") from error
    stage = _stage(graph, before, {key: known[key] for key in live}, results or {})
    return replace(stage, kinds={key: array.dtype for key, array in examples.items()})


def copying(pairs: dict[Slot, Slot], values: Mapping[Slot, Value]) -> Stage:
    """The stage that fills slots from others, given ``{to: from}`` and something like what stands there."""
    graph = Graph()
    like = {source: values[to] for to, source in pairs.items()}
    inputs = {slot: graph.input(value.value if isinstance(value, Node) else value) for slot, value in like.items()}
    return Stage(inputs, {to: inputs[source] for to, source in pairs.items()}, None, [])


def _tied(name: str, array: Traced) -> Traced:
    """Covariances are symmetric to the last bit: one symbol stands for both halves."""
    if is_symmetric(name):
        for row in range(len(array)):
            array[:row, row] = array[row, :row]
    return array


def is_symmetric(name: str) -> bool:
    """Whether the first two axes of an array of the state may be exchanged."""
    return "covariance" in name


def _stage(graph: Graph, before: dict[str, Any], after: dict[str, Any], results: dict[str, Any]) -> Stage:
    inputs = {slot: node for slot, node in _slots(before) if isinstance(node, Node)}
    kept = {slot: id(node) for slot, node in inputs.items()}
    outputs = {slot: value for slot, value in _slots(after) if kept[slot] != id(value)}
    outputs |= dict(_slots(results))
    guard = _all_of(graph)
    order = graph.order([*outputs.values(), guard])
    used = {id(operand) for node in order for operand in node.operands} | {id(value) for value in outputs.values()}
    return Stage({slot: node for slot, node in inputs.items() if id(node) in used}, outputs, guard, order)


def _slots(arrays: dict[str, Any]) -> list[tuple[Slot, Value]]:
    return [
        ((name, index), value)
        for name, array in arrays.items()
        for index, value in enumerate(array.view(np.ndarray).reshape(-1).tolist())
    ]


def _all_of(graph: Graph) -> Value | None:
    """One truth value that is true where every guard comes out as expected."""
    whole: Value | None = None
    for node, expected in dict.fromkeys(graph.guards):
        met = node if expected else graph.apply("logical_not", (node,))
        whole = met if whole is None else graph.apply("logical_and", (whole, met))
    return whole
