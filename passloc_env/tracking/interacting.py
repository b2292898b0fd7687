"""The interacting multiple model estimator (IMM): filters of several motions that share what they have learnt.

The emitter moves by one of M motions and now and then switches to another. At each step every filter starts from a
mixture of all beliefs, weighed by how likely the switch was, so that one that was wrong is put right at once:

    c_j = Σ_i p_ij μ_i,   μ_i|j = p_ij μ_i / c_j
    x_0j = Σ_i μ_i|j x_i,   P_0j = Σ_i μ_i|j (P_i + (x_i − x_0j)(x_i − x_0j)ᵀ)

then predicts and corrects by its own motion, and ``μ_j ∝ c_j L_j`` (Blom & Bar-Shalom, IEEE Trans. AC 33(8), 1988;
Bar-Shalom, Li & Kirubarajan, *Estimation with Applications*, 11.6.6).

The likelihoods can be compared only where all filters have used the same measurements, so there is one gate for all:
the union of theirs. It is open to whatever any motion foretells, however unlikely that motion is yet; for when the
emitter begins to turn, the turn is believed only after measurements that no other motion explains. Bar-Shalom, Willett
& Tian, *Tracking and Data Fusion*, take the gate of the filter whose innovation has the largest covariance, which is
the union where the filters expect the same measurement and their covariances are nested. The gate of the mixture, which
a bank has, would shut on a manoeuvre: on BearingDoppler one of 99 % loses 0.6 % of the tracks when nothing fails, where
the union and no gate lose 0.1 %.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passloc_env.arrays import Array, BoolArray, IntArray, blank, zeros
from passloc_env.errors import ScenarioError
from passloc_env.fields import parts, quantity
from passloc_env.layout import StateLayout
from passloc_env.linalg import diagonal, tree_sum
from passloc_env.motion import ConstantAcceleration, ConstantVelocity, Motion, UnknownTurn
from passloc_env.nuisance import Nuisance, distinct
from passloc_env.platforms import Pose
from passloc_env.sensors import Sensor
from passloc_env.tracking.correction import correct, log_likelihood
from passloc_env.tracking.gating import gate_of, gate_probability
from passloc_env.tracking.mixture import Members, MixtureTrack, moments
from passloc_env.tracking.tracker import Models, Tracker
from passloc_env.tracking.unscented import Innovation, UnscentedTransform


class SwitchingMotion(Motion):
    """Any of several motions at a time: its state holds those of all. Nobody moves by it, but its members do."""

    linear = False

    def __init__(self, members: tuple[Motion, ...]) -> None:
        self.members = members
        self.order = max(member.order for member in members)
        self.model = all(member.model for member in members)

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """Those of all members, each once."""
        return distinct(nuisance for member in self.members for nuisance in member.nuisances)

    def noise_gain(self, layout: StateLayout, period: float) -> Array:
        """None of its own: ``(n, 0, 1)``."""
        return np.zeros((layout.size, 0, 1))


@dataclass(frozen=True, kw_only=True)
class InteractingModels(Tracker):
    """Interacting multiple model estimator of unscented filters; any motions, any sensors.

    The motions may hold different states: the track holds all of them, each filter runs on its own. Where a filter has
    no such state, its belief about it is the prior's spread around zero (Granström, Willett & Bar-Shalom, *Systematic
    approach to IMM mixing for unequal dimension states*, IEEE Trans. AES 51(4), 2015): that is what the others mix in
    when the emitter switches, so that an acceleration just begun may be large.

    A measurement passes the gate where that of any motion lets it in: more often than ``gate`` says, the more the wider
    the widest motion.
    """

    motions: tuple[Motion, ...] = parts(
        Motion,
        "how it believes the emitter may move",
        (
            ConstantVelocity(acceleration_noise=0.02),
            ConstantAcceleration(acceleration_noise=0.1),
            UnknownTurn(acceleration_noise=0.1, turn_rate_noise=1e-3),
        ),
        at_least=1,
    )
    sojourn: float = quantity("mean time until a motion gives way to another", 60.0, unit="s", above=0, plain=True)
    alpha: float = quantity("spread of the sigma points", 1.0, above=0, plain=True)
    beta: float = quantity("weight of the centre in the covariance; 2 suits a Gaussian", 2.0, plain=True)
    kappa: float = quantity("secondary spread", 0.0, plain=True)
    gate: float = gate_probability()

    def validate(self) -> None:
        """What only the truth can know is no model."""
        for index, motion in enumerate(self.motions):
            if not motion.model:
                allowed = "is known to the truth alone; a model needs another motion"
                raise ScenarioError(f"motions.{index}", type(motion).__name__, allowed)

    def check(self, sensors: tuple[Sensor, ...], dimension: int) -> None:
        """Every motion must fit a problem of this dimension."""
        for index, motion in enumerate(self.motions):
            try:
                motion.check(dimension)
            except ScenarioError as error:
                raise error.inside(f"tracker.motions.{index}") from None

    @property
    def motion(self) -> SwitchingMotion:  # type: ignore[override]
        """What tells the state of the track."""
        return SwitchingMotion(self.motions)

    def build(self, models: Models, environments: int) -> InteractingTrack:
        """The running filters; ScenarioError when kappa leaves no spread to one of them."""
        return InteractingTrack(self, models, environments)


@dataclass
class Crew:
    """The members whose states are the same: they are corrected together.

    Attributes:
        members: their indices ``(g,)``.
        rows: their states' rows in the track ``(k,)``.
        transform: their sigma points.
    """

    members: IntArray
    rows: IntArray
    transform: UnscentedTransform

    def take(self, beliefs: Members) -> Members:
        """A copy of their own states' beliefs ``(k, g, N)`` out of all."""
        return Members.of(beliefs.mean[self._of_mean], beliefs.covariance[self._of_covariance])

    def give(self, own: Members, beliefs: Members) -> None:
        """Put their own states' beliefs, and what is counted about them, back among all."""
        beliefs.mean[self._of_mean], beliefs.covariance[self._of_covariance] = own.mean, own.covariance
        beliefs.nis[self.members] = own.nis
        beliefs.repairs[self.members] += own.repairs

    @property
    def _of_mean(self) -> tuple[IntArray, ...]:
        return np.ix_(self.rows, self.members)

    @property
    def _of_covariance(self) -> tuple[IntArray, ...]:
        return np.ix_(self.rows, self.rows, self.members)


class InteractingTrack(MixtureTrack):
    """The running filters of a batch.

    In the rows that a member lacks its mean stays zero, its covariance diagonal and as the prior has it.
    """

    def __init__(self, tracker: InteractingModels, models: Models, environments: int) -> None:
        super().__init__(models, environments, len(tracker.motions))
        self._tracker = tracker
        self.gate = gate_of(tracker.gate, models.suite)
        for member, own in enumerate(models.members):
            self.rows[member] = _rows(own.layout, models.layout)
        self._crews = self._muster()

    def _muster(self) -> list[Crew]:
        """Members by layout, in the order of the first of each."""
        layouts = [models.layout for models in self.models.members]
        crews = []
        for layout in dict.fromkeys(layouts):
            members = np.flatnonzero([other == layout for other in layouts])
            tracker = self._tracker
            transform = UnscentedTransform(layout.size, tracker.alpha, tracker.beta, tracker.kappa)
            crews.append(Crew(members, self.rows[members[0]], transform))
        return crews

    @property
    def components(self) -> dict[str, Array]:
        """``modes (M, N)``: how likely each motion is; ``means (n, M, N)`` and ``covariances (n, n, M, N)``; live."""
        parts = super().components
        return {"modes": parts.pop("weights"), **parts}

    def start(self, columns: IntArray, mean: Array, covariance: Array, origin: Array | None = None) -> None:
        """Begin anew in the given environments, with every motion equally likely."""
        super().start(columns, mean, covariance, origin)
        self.weights[:, columns] = 1.0 / len(self.weights)
        n, size = len(mean), (len(self.rows), len(columns))
        prior = Members.of(zeros(mean, (n, *size)), zeros(mean, (n, n, *size)))
        for member, rows in enumerate(self.rows):
            block, own = np.ix_(rows, rows), prior.covariance[:, :, member]
            diagonal(own)[...] = diagonal(covariance)
            own[block] = covariance[block]
            prior.mean[rows, member] = mean[rows]
        self.members.mean[..., columns], self.members.covariance[..., columns] = prior.mean, prior.covariance

    def predict(self, time: Array) -> None:
        """Mix, then every member's prediction."""
        joint = self._transition[..., None] * self.weights[:, None]
        likely = tree_sum(joint.copy())
        given = joint / likely
        begun = [self._mixed(crew, given) for crew in self._crews]
        for crew, own in zip(self._crews, begun, strict=True):
            for index, member in enumerate(crew.members):
                crew.transform.predict(own.only(index), self.models.members[member].dynamics, time)
            crew.give(own, self.members)
        self.weights[...] = likely
        self.combine()

    @property
    def _transition(self) -> Array:
        """``p_ij (M, M)``: the chance that motion i gives way to j within a step; the same for all others."""
        count = len(self.weights)
        if count == 1:
            return np.ones((1, 1))
        steps = self.models.dynamics.period / self._tracker.sojourn
        chances = np.full((count, count), -np.expm1(-steps) / (count - 1))
        np.fill_diagonal(chances, np.exp(-steps))
        return chances

    def _mixed(self, crew: Crew, given: Array) -> Members:
        """What a crew's members start from, ``given (M, M, N)`` how likely each motion was before each."""
        mean, covariance = self.members.mean[crew.rows], self.members.covariance[np.ix_(crew.rows, crew.rows)]
        states, size = len(crew.rows), (len(crew.members), given.shape[-1])
        own = Members.of(blank(mean, (states, *size)), blank(mean, (states, states, *size)))
        for index, member in enumerate(crew.members):
            own.mean[:, index], own.covariance[:, :, index] = moments(given[:, member], mean, covariance)
        return own

    def update(self, measurement: Array, poses: list[Pose], detected: BoolArray | None = None) -> None:
        """Every member's correction, and how likely its motion is now."""
        likelihood = blank(self.weights, self.weights.shape)
        beliefs = [crew.take(self.members) for crew in self._crews]
        innovations = [
            crew.transform.innovation(own, self.models.members[crew.members[0]], measurement, poses)
            for crew, own in zip(self._crews, beliefs, strict=True)
        ]
        used = self._admitted(innovations, detected)
        for crew, own, innovation in zip(self._crews, beliefs, innovations, strict=True):
            lower = correct(own, *innovation, self.models.suite.noise_pivots, used)
            likelihood[crew.members] = log_likelihood(own, lower)
            crew.give(own, self.members)
        self.weigh(likelihood)

    def _admitted(self, innovations: list[Innovation], detected: BoolArray | None) -> BoolArray | None:
        """Which scalars all are to use ``(m, N)``, None for all: of those detected, what any member's gate lets in."""
        if self.gate is None:
            return detected
        passed = [self.gate.passed(each.value, each.covariance, self.models.suite) for each in innovations]
        return self.sift(np.logical_or.reduce(np.concatenate(passed, axis=1), axis=1), detected)


def _rows(layout: StateLayout, whole: StateLayout) -> IntArray:
    """Where the states of a layout are in one that holds them all ``(k,)``."""
    found = {own: row for row, own in whole.shared_rows(layout)}
    return np.array([found[row] for row in range(layout.size)])
