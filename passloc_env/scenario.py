"""A scenario: one frozen, validated dataclass that says everything about a problem.

Nothing in the simulation knows a scenario by name; whatever is stochastic or debatable is a component named here.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import yaml

from passloc_env.belief import BeliefFeatures
from passloc_env.component import Component, concrete, from_dict, specs, to_dict
from passloc_env.distributions import Uniform, extremes
from passloc_env.errors import InputError, ScenarioError
from passloc_env.fields import Count, count, flag, part, parts, quantity, text
from passloc_env.motion import ConstantVelocity, Motion
from passloc_env.overrides import override
from passloc_env.platforms import FixedStation, Platform, TurnLimitedPlatform
from passloc_env.reading import json_data, read_text, yaml_data
from passloc_env.rewards import DEFAULT_REWARD, RewardTerm
from passloc_env.sensor_suite import check_nuisances
from passloc_env.sensors import Bearing, Sensor
from passloc_env.target import CartesianStart, PolarStart, Target
from passloc_env.tracking import Prior, RangePrior, Tracker, UnscentedKalman
from passloc_env.tracking.initialisation import BearingPrior


@dataclass(frozen=True, kw_only=True)
class Episode(Component):
    """How long an episode lasts, how often the observer decides, and what ends it early.

    ``steps`` and ``decision_every`` count *sensor steps*: one measurement each, ``period`` seconds apart.
    """

    steps: int = count("sensor steps per episode", 240, at_least=1, at_most=1_000_000)
    period: float = quantity("seconds per sensor step", 1.0, unit="s", above=0, plain=True)
    decision_every: int = count("sensor steps per decision", 4, at_least=1)
    min_range: float = quantity(
        "keep-out radius around the emitter; 0 for none", 10e3, unit="m", at_least=0, plain=True
    )
    early_end: bool = flag("whether entering min_range or losing the track ends the episode", True)
    lost_error: float = quantity(
        "relative range error above which the track counts as lost in flight", 10.0, above=0, plain=True
    )

    def validate(self) -> None:
        """Episodes are whole numbers of decisions."""
        if self.steps % self.decision_every:
            divisors = [d for d in range(1, self.steps + 1) if self.steps % d == 0]
            close = min(divisors, key=lambda d: (abs(d - self.decision_every), d))
            allowed = f"must divide steps = {self.steps}; closest: {close}"
            raise ScenarioError("decision_every", self.decision_every, allowed)

    @property
    def interval(self) -> float:
        """Seconds between decisions."""
        return self.period * self.decision_every

    @property
    def duration(self) -> float:
        """Seconds per episode."""
        return self.period * self.steps


@dataclass(frozen=True, kw_only=True)
class Bound(Component):
    """The motion model of the Cramér–Rao recursion, whatever the tracker believes; linear."""

    motion: Motion = part(Motion, "motion model of the bound", ConstantVelocity())


_HALF_TURN = Uniform(low=-math.pi, high=math.pi)


@dataclass(frozen=True, kw_only=True)
class Scenario(Component):
    """Everything that defines a problem. The defaults are ``BearingsOnly``: an aircraft that hears an aircraft.

    Raises:
        ScenarioError: an unknown field, an impossible value, or components that do not fit each other.
    """

    name: str = text("what it is called", "BearingsOnly")
    target: Target = part(
        Target,
        "the emitter",
        Target(
            start=PolarStart(
                range=Uniform(low=20e3, high=60e3),
                bearing=_HALF_TURN,
                speed=Uniform(low=100.0, high=250.0),
                course=_HALF_TURN,
            )
        ),
    )
    platforms: tuple[Platform, ...] = parts(
        Platform,
        "the observers",
        (
            TurnLimitedPlatform(
                heading=_HALF_TURN, speed=Uniform(low=200.0, high=250.0), max_turn_rate=math.radians(3.0)
            ),
        ),
        at_least=1,
    )
    sensors: tuple[Sensor, ...] = parts(Sensor, "what they hear", (Bearing(sigma=3e-3),), at_least=1)
    prior: Prior = part(
        Prior,
        "what is known before tracking begins",
        RangePrior(range=40e3, range_sigma=15e3, velocity_sigma=127.0),
    )
    tracker: Tracker = part(
        Tracker, "the tracker inside", UnscentedKalman(motion=ConstantVelocity(acceleration_noise=0.02))
    )
    bound: Bound = part(Bound, "the Cramér–Rao recursion", Bound())
    reward: tuple[RewardTerm, ...] = parts(RewardTerm, "reward terms", DEFAULT_REWARD)
    observation: BeliefFeatures = part(BeliefFeatures, "what the agent sees", BeliefFeatures())
    episode: Episode = part(Episode, "length, decisions, keep-out", Episode())

    @property
    def dimension(self) -> int:
        """Number of spatial axes."""
        return self.target.start.dimension

    @cached_property
    def own_ship(self) -> int:
        """The platform that the line of sight is drawn from: the first that can be commanded."""
        return next((i for i, platform in enumerate(self.platforms) if platform.controls), 0)

    @cached_property
    def commanded(self) -> tuple[int, ...]:
        """The platforms that must keep away from the emitter: all that can be commanded, or else the own ship."""
        moving = tuple(i for i, platform in enumerate(self.platforms) if platform.controls)
        return moving or (self.own_ship,)

    @property
    def forecast_motion(self) -> Motion:
        """A linear motion to forecast the emitter by: the tracker's, or the bound's where that is not linear."""
        return self.tracker.motion if self.tracker.motion.linear else self.bound.motion

    @property
    def action_size(self) -> int:
        """Number of action components of all platforms together."""
        return sum(platform.controls for platform in self.platforms)

    def validate(self) -> None:
        """Check that the components fit each other."""
        self._check_sensors()
        self._check_models()
        self._check_keep_out()
        names = [term.name for term in self.reward]
        for index, name in enumerate(names):
            if name in names[:index]:
                raise ScenarioError(f"reward.{index}", name, "each reward term may be named once")

    def _check_sensors(self) -> None:
        for index, observer in enumerate(self.platforms):
            axes = observer.dimension
            if axes != self.dimension:
                allowed = f"must have {self.dimension} axes like the emitter"
                raise ScenarioError(f"platforms.{index}.position", axes, allowed)
        last = len(self.platforms) - 1
        for index, sensor in enumerate(self.sensors):
            for platform in sensor.platforms:
                if platform > last:
                    allowed = f"there is no such platform; known: 0 … {last}"
                    raise ScenarioError(f"sensors.{index}.{_platform_field(sensor, platform)}", platform, allowed)
            if len(sensor.lever_arm) not in (0, self.dimension):
                allowed = f"must be empty or have {self.dimension} axes"
                raise ScenarioError(f"sensors.{index}.lever_arm", sensor.lever_arm, allowed)
            try:
                sensor.check(self.dimension)
            except ScenarioError as error:
                raise error.inside(f"sensors.{index}") from None
        check_nuisances(self.sensors)
        self._check_prior()

    def _check_prior(self) -> None:
        try:
            self.prior.check(self.sensors, self.platforms, self.dimension)
        except ScenarioError as error:
            if error.field == "sensor":
                free = [name for name, kind in concrete(Prior).items() if not issubclass(kind, BearingPrior)]
                allowed = f"{error.allowed}; priors that need no bearing: {', '.join(free)}"
                error = ScenarioError("sensor", error.value, allowed)
            raise error.inside("prior") from None

    def _check_models(self) -> None:
        self.tracker.check(self.sensors, self.dimension)
        for where, motion in (("tracker", self.tracker.motion), ("bound", self.bound.motion)):
            if not motion.model:
                allowed = "is known to the truth alone; a model needs another motion"
                raise ScenarioError(f"{where}.motion", type(motion).__name__, allowed)
        if not self.bound.motion.linear:
            raise ScenarioError("bound.motion", type(self.bound.motion).__name__, "must be a linear motion")
        motions = {"target": self.target.motion, "tracker": self.tracker.motion, "bound": self.bound.motion}
        for where, motion in motions.items():
            try:
                motion.check(self.dimension)
            except ScenarioError as error:
                raise error.inside(f"{where}.motion") from None

    def _check_keep_out(self) -> None:
        starts = [_closest_start(self.target.start, self.platforms[index]) for index in self.commanded]
        closest = min((start for start in starts if start is not None), default=math.inf)
        if self.episode.min_range >= closest:
            allowed = f"must be below the closest start range, {closest:g} m"
            raise ScenarioError("episode.min_range", self.episode.min_range, allowed)

    def override(self, changes: Mapping[str, Any]) -> Scenario:
        """A copy with some fields changed, by dotted name.

        List items are addressed by index or class name: ``{"sensors.Bearing.sigma": 0.01, "episode.steps": 120}``.

        Raises:
            ScenarioError: as for the constructor; the field is the dotted name.
        """
        return cast(Scenario, override(self, changes))

    def to_dict(self) -> dict[str, Any]:
        """Plain data, JSON and YAML safe."""
        return to_dict(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Scenario:
        """Build from plain data; fields left out keep the defaults, unknown ones raise ScenarioError."""
        scenario = from_dict(data, default=cls)
        if not isinstance(scenario, cls):
            raise ScenarioError("type", type(scenario).__name__, f"must be a {cls.__name__}")
        return scenario

    def to_json(self) -> str:
        """JSON text from which :meth:`from_json` builds an equal scenario."""
        return json.dumps(self.to_dict(), indent=2, allow_nan=False, ensure_ascii=False)

    @classmethod
    def from_json(cls, text: str) -> Scenario:
        """Build from JSON text."""
        return cls._from_text(text, "JSON", text[:40])

    def to_yaml(self) -> str:
        """YAML text from which :meth:`from_yaml` builds an equal scenario."""
        return yaml.safe_dump(self.to_dict(), sort_keys=False, allow_unicode=True)

    @classmethod
    def from_yaml(cls, text: str) -> Scenario:
        """Build from YAML text (read with the safe loader)."""
        return cls._from_text(text, "YAML", text[:40])

    @classmethod
    def from_file(cls, path: str | Path) -> Scenario:
        """Build from a ``.json``, ``.yaml`` or ``.yml`` file; OSError when it cannot be read."""
        try:
            content = read_text(Path(path))
        except InputError as error:
            raise ScenarioError("scenario", str(path), f"is {error}") from None
        return cls._from_text(content, "JSON" if Path(path).suffix == ".json" else "YAML", str(path))

    @classmethod
    def _from_text(cls, text: str, language: str, source: str) -> Scenario:
        """Build from text; ``source`` is what a message calls it."""
        try:
            data = json_data(text) if language == "JSON" else yaml_data(text)
        except InputError as error:
            raise ScenarioError("scenario", source, f"is not readable {language}: {error}") from None
        if not isinstance(data, Mapping):
            raise ScenarioError("scenario", source, f"must be a {language} mapping of fields")
        return cls.from_dict(data)

    def replace(self, **fields: Any) -> Scenario:
        """A copy with whole fields replaced."""
        return dataclasses.replace(self, **fields)


def _platform_field(sensor: Sensor, platform: int) -> str:
    """The field in which a sensor names a platform, be it a further one of several."""
    if sensor.platform == platform:
        return "platform"
    numbers = {name: getattr(sensor, name) for name, spec in specs(type(sensor)).items() if isinstance(spec, Count)}
    return next((name for name, number in numbers.items() if number == platform), "platform")


def _closest_start(start: Any, platform: Platform) -> float | None:
    """The smallest possible initial range when it can be told without sampling."""
    position = platform.position if isinstance(platform, (FixedStation, TurnLimitedPlatform)) else None
    if position is None or not all(isinstance(axis, float) for axis in position):
        return None
    if isinstance(start, PolarStart) and not any(position):
        return extremes(start.range)[0]
    if isinstance(start, CartesianStart) and all(isinstance(axis, float) for axis in start.position):
        return math.dist(start.position, position)
    return None
