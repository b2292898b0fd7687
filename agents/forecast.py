"""Looking ahead: what a belief will become if the platforms fly this way or that.

The believed emitter moves as a linear motion says, the tracker's if that is one, the platforms as they do in the
simulation, and the covariance follows the recursion of the Cramér–Rao bound with every Jacobian taken at the forecast
geometry. Candidates lie side by side in the batch axis, so that one pass flies them all.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from passloc_env.arrays import Array, IntArray
from passloc_env.belief import Belief
from passloc_env.dynamics import Dynamics
from passloc_env.information import Information
from passloc_env.layout import StateLayout
from passloc_env.motion import Motion
from passloc_env.platforms import Platform
from passloc_env.randomisation import take
from passloc_env.sensor_suite import SensorSuite, nuisances
from passloc_env.sensors import Sensor
from passloc_env.sightline import Scene, distance


@dataclass(frozen=True)
class Situation:
    """Where everything stands at a decision, as far as a policy may know.

    Attributes:
        emitter: the state that the forecast starts from ``(n, N)``.
        covariance: of the belief ``(n, n, N)``.
        sighted: where the tracker believes the emitter to be ``(d, N)``: the first command is relative to it.
        states: one array ``(rows, N)`` per platform.
        platforms, sensors, motion: with the numbers of each environment.
        layout: rows of the emitter's state.
        own_ship: index of the platform that ranges are counted from.
        period: seconds per sensor step.
        every: sensor steps per decision.
    """

    emitter: Array
    covariance: Array
    sighted: Array
    states: tuple[Array, ...]
    platforms: tuple[Platform, ...]
    sensors: tuple[Sensor, ...]
    motion: Motion
    layout: StateLayout
    own_ship: int
    period: float
    every: int

    @classmethod
    def of(cls, belief: Belief, emitter: Array | None = None) -> Situation:
        """The situation of a belief; ``emitter (n, N)`` is where to start from if not at the belief's mean."""
        layout = belief.motion.layout(belief.layout.dimension).with_nuisance(
            tuple(nuisance.name for nuisance in nuisances(belief.sensors))
        )
        rows = [theirs for _, theirs in layout.shared_rows(belief.layout)]
        return cls(
            emitter=(belief.mean if emitter is None else emitter)[rows],
            covariance=belief.covariance[np.ix_(rows, rows)],
            sighted=belief.mean[belief.layout.position],
            states=tuple(p.state_at(pose) for p, pose in zip(belief.platforms, belief.poses, strict=True)),
            platforms=belief.platforms,
            sensors=belief.sensors,
            motion=belief.motion,
            layout=layout,
            own_ship=belief.own_ship,
            period=belief.period,
            every=round(belief.interval / belief.period),
        )

    def take(self, columns: IntArray) -> Situation:
        """The situation of some environments, any of them any number of times."""
        return replace(
            self,
            emitter=self.emitter[:, columns],
            covariance=self.covariance[..., columns],
            sighted=self.sighted[:, columns],
            states=tuple(state[:, columns] for state in self.states),
            platforms=tuple(take(platform, columns) for platform in self.platforms),
            sensors=tuple(take(sensor, columns) for sensor in self.sensors),
            motion=take(self.motion, columns),
        )

    @property
    def controls(self) -> int:
        """Number of action components."""
        return sum(platform.controls for platform in self.platforms)


@dataclass(frozen=True)
class Look:
    """What a forecast comes to at one instant; its arrays are reused by the next look.

    Attributes:
        scene: the emitter as it is forecast, from where the platforms will be.
        covariance: ``(n, n, N)`` after all measurements until then.
        unheard: ``(n, n, N)`` if nothing more were measured from the beginning on.
        own_ship: index of the platform that ranges are counted from.
        steps: sensor steps that the look stands for.
        decision: decisions from the beginning until then.
    """

    scene: Scene
    covariance: Array
    unheard: Array
    own_ship: int
    steps: int
    decision: float


@dataclass(frozen=True)
class Pace:
    """How a forecast walks through time.

    Attributes:
        strides: sensor steps from one look to the next; every look counts for that many measurements.
    """

    strides: tuple[int, ...]

    @classmethod
    def of(cls, steps: int, looks: int, every: int) -> Pace:
        """A pace of about ``looks`` looks over so many sensor steps, a whole number of decisions ``every`` steps apart.

        Where looks abound they are evenly spread, several to a decision. Where they are scarce half of them are one
        decision apart, for what is near must be seen sharply, and the others some decisions.
        """
        decisions = steps // every
        if decisions <= looks:
            stride = min(stride for stride in range(1, every + 1) if every % stride == 0 and stride * looks >= steps)
            return cls((stride,) * (steps // stride))
        near = (looks + 1) // 2
        wide = -(-(decisions - near) // (looks - near)) if looks > near else decisions - near
        whole, rest = divmod(decisions - near, wide)
        return cls(tuple(every * count for count in (*(1,) * near, *(wide,) * whole, *(rest,) * (rest > 0))))

    @property
    def steps(self) -> int:
        """Sensor steps in all."""
        return sum(self.strides)


class Forecast:
    """Flies plans from a situation, at a pace."""

    def __init__(self, situation: Situation, pace: Pace) -> None:
        self._situation, self._pace = situation, pace
        self._suite = SensorSuite(situation.sensors)
        states = situation.motion.nuisances + nuisances(situation.sensors)
        # What happens to be zero in some environments must not decide how it is reckoned in others.
        dynamics = Dynamics(situation.motion, situation.layout, situation.period, states, dense=_varies(situation))
        self._dynamics = {stride: dynamics.repeated(stride) for stride in set(pace.strides)}

    def fly(self, plan: Array) -> Iterator[Look]:
        """Fly a plan and look around after every stride.

        Args:
            plan: actions of equally long legs, one after the other, ``(legs, a, N)``. An action takes effect at the
                decision at or after the beginning of its leg, and is made relative to the line of sight at each look
                that falls on a decision.

        Yields:
            One look per stride. Measurements that may be missed count as made; what the surroundings hide is not heard.
        """
        here, pace, suite, environments = self._situation, self._pace, self._suite, plan.shape[-1]
        information = Information(self._dynamics[pace.strides[0]], environments, gram=False)
        information.start(np.arange(environments), here.covariance)
        emitter, time = here.emitter.copy(), np.zeros(environments)
        states, sighted, done = list(here.states), here.sighted, 0
        unheard = here.covariance.copy()
        held: list[Array] = []
        for stride in pace.strides:
            if done % here.every == 0:
                held = _set_points(here.platforms, states, plan[done * len(plan) // pace.steps], sighted)
            done += stride
            dynamics = information.dynamics = self._dynamics[stride]
            states = [p.move(s, h, dynamics.period) for p, s, h in zip(here.platforms, states, held, strict=True)]
            dynamics.advance(emitter, time)
            sighted = emitter[here.layout.position]
            scene = Scene(emitter, here.layout, [p.pose(s) for p, s in zip(here.platforms, states, strict=True)])
            information.advance()
            dynamics.spread(unheard)
            # Measurements of one geometry add up: k of them weigh as one whose Jacobian is √k times as large.
            jacobian = suite.jacobian(scene)
            jacobian *= np.sqrt(stride)
            information.absorb(jacobian, suite, suite.detected(scene, None))
            yield Look(scene, information.bound, unheard, here.own_ship, stride, done / here.every)


def _varies(situation: Situation) -> bool:
    """Whether a number of the motion or the sensors differs between environments."""
    parts = (situation.motion, *situation.sensors)
    numbers = [number for part in parts for value in vars(part).values() for number in _flat(value)]
    return any(isinstance(number, np.ndarray) for number in numbers)


def _flat(value: object) -> tuple[object, ...]:
    return value if isinstance(value, tuple) else (value,)


def _set_points(platforms: tuple[Platform, ...], states: list[Array], action: Array, sighted: Array) -> list[Array]:
    """What every platform holds until the next decision, as the simulation would have it."""
    held, first = [], 0
    for platform, state in zip(platforms, states, strict=True):
        part = action[first : first + platform.controls]
        first += platform.controls
        offset = sighted - platform.pose(state).position
        held.append(platform.set_point(state, part, offset / distance(offset)))
    return held
