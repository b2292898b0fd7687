"""How sensors fail beyond ordinary noise: errors far too wide, measurements that come too late, and silence.

An error is an outlier with the probability ε, and then k times as wide as usual, so that errors follow Tukey's
contaminated law ``(1 − ε) p(e) + ε p(e/k)/k`` of variance ``(1 + ε (k² − 1)) σ²`` (Huber, *Robust Statistics*, 1.1).
Trackers are not told: they go on believing in σ. The Cramér–Rao bound *is* told which errors were outliers, and lets
each of these measurements count ``1/k²`` of its information: no tracker can do better.

A measurement that is late arrives after the next one. No tracker here keeps its past to put it into, so it is dropped:
late, lost on the way and never made are the same to tracker and bound, and each is decided by a draw of its own. During
an outage, after its start and up to its end, nothing at all is measured.

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
        "chance that a measurement comes too late to be used", 0.0, at_least=0, at_most=1, appended=True
    )
    outage_start: Number = quantity("when an outage begins", 0.0, unit="s", at_least=0, appended=True)
    outage_duration: Number = quantity("how long it lasts", 0.0, unit="s", at_least=0, appended=True)

    @property
    def outlying(self) -> bool:
        """Whether there may be outliers."""
        return not _never(self.outlier_probability)

    @property
    def losing(self) -> bool:
        """Whether measurements may be lost."""
        return not (_never(self.late_probability) and _never(self.outage_duration))

    def silent(self, time: Array, uniforms: Array) -> BoolArray:
        """Whether what is measured at ``time (N,)`` is lost ``(N,)``, by the clock or by a draw ``(N,)``."""
        end = self.outage_start + self.outage_duration
        lost: BoolArray = (uniforms < self.late_probability) | ((time > self.outage_start) & (time <= end))
        return lost


SOUND = Faults()
"""Nothing goes wrong."""


def _never(number: Number) -> bool:
    return isinstance(number, float) and number == 0.0
