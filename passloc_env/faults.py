"""How sensors fail beyond ordinary noise: errors far too wide, measurements that come late, and silence.

An error is an outlier with the probability ε, and then k times as wide as usual, so that errors follow Tukey's
contaminated law ``(1 − ε) p(e) + ε p(e/k)/k`` of variance ``(1 + ε (k² − 1)) σ²`` (Huber, *Robust Statistics*, 1.1).
Trackers are not told: they go on believing in σ. The Cramér–Rao bound *is* told which errors were outliers, and lets
each of these measurements count ``1/k²`` of its information: no tracker can do better.

A measurement that is late arrives within the next period. The belief that its own instant's decision rests on lacks it;
before tracker and bound go on to the next instant they take it in, so that nothing is out of sequence and nothing of it
is lost but time. What comes later still is as good as missed: let the detection probability be lower. During an outage,
after its start and up to its end, nothing at all is measured.

The first look of an episode is spared: a track begins with a measurement that has been confirmed.
"""

from __future__ import annotations

from dataclasses import dataclass

from passloc_env.arrays import Array, BoolArray, Number
from passloc_env.component import Component
from passloc_env.fields import quantity


@dataclass(frozen=True, kw_only=True)
class Faults(Component):
    """What goes wrong with a sensor; by default nothing."""

    outlier_probability: Number = quantity("chance of an outlier", 0.0, at_least=0, at_most=1, appended=True)
    outlier_scale: Number = quantity(
        "how many times as wide as usual the errors of outliers are", 10.0, at_least=1, appended=True
    )
    late_probability: Number = quantity(
        "chance that a measurement comes late, within the next period", 0.0, at_least=0, at_most=1, appended=True
    )
    outage_start: Number = quantity("when an outage begins", 0.0, unit="s", at_least=0, appended=True)
    outage_duration: Number = quantity("how long it lasts", 0.0, unit="s", at_least=0, appended=True)

    @property
    def outlying(self) -> bool:
        """Whether there may be outliers."""
        return not _never(self.outlier_probability)

    @property
    def delaying(self) -> bool:
        """Whether measurements may come late."""
        return not _never(self.late_probability)

    @property
    def withholding(self) -> bool:
        """Whether what would be detected may be absent at its time: late, or never measured in an outage."""
        return self.delaying or not _never(self.outage_duration)

    def late(self, uniforms: Array) -> BoolArray:
        """Whether a measurement comes late ``(N,)``, by a draw ``(N,)``."""
        late: BoolArray = uniforms < self.late_probability
        return late

    def out(self, time: Array) -> BoolArray:
        """Whether there is an outage at ``time (N,)``."""
        out: BoolArray = (time > self.outage_start) & (time <= self.outage_start + self.outage_duration)
        return out


SOUND = Faults()
"""Nothing goes wrong."""


def _never(number: Number) -> bool:
    return isinstance(number, float) and number == 0.0
