"""Multi-model trackers as parts of a scenario: random numbers, plain data, and what is refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from passloc_env.motion import ConstantVelocity, Manoeuvre, UnknownTurn
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.simulation import Simulation
from passloc_env.tracking import InteractingModels, RangeBank


def test_random_numbers_of_members_are_followed(begin: Callable[..., Simulation]) -> None:
    """Each environment's members have the noise drawn for it: as if that number had been written down."""
    changes = {"type": "LogUniform", "low": 0.01, "high": 1.0}
    scenario = SCENARIOS["BearingDoppler"].replace(tracker=InteractingModels())
    drawn = begin(scenario.override({"tracker.motions.0.acceleration_noise": changes}), 3)
    numbers = drawn.realised.tracker.motions[0].acceleration_noise
    drawn.step(np.zeros((1, 3)))
    assert len(set(numbers)) == 3
    for column, number in enumerate(numbers):
        written = begin(scenario.override({"tracker.motions.0.acceleration_noise": float(number)}), 1, column)
        written.step(np.zeros((1, 1)))
        np.testing.assert_allclose(written.track.mean[:, 0], drawn.track.mean[:, column], rtol=1e-12)


def test_models_as_plain_data() -> None:
    """Trackers come and go as dictionaries, members and all."""
    changes = {
        "tracker": {
            "type": "InteractingModels",
            "motions": [{"type": "ConstantVelocity"}, {"type": "UnknownTurn"}],
            "sojourn": 30,
        }
    }
    scenario = SCENARIOS["BearingDoppler"].override(changes)
    assert scenario.tracker == InteractingModels(motions=(ConstantVelocity(), UnknownTurn()), sojourn=30.0)
    assert Scenario.from_json(scenario.to_json()) == scenario
    bank = SCENARIOS["BearingsOnly"].override({"tracker": {"type": "RangeBank", "members": 7}})
    assert bank.tracker == RangeBank(members=7)


def test_impossible_models_are_refused(refusal: Callable[..., object]) -> None:
    truth = Manoeuvre(start=1.0, duration=1.0)
    assert refusal(lambda: InteractingModels(motions=(ConstantVelocity(), truth))).field == "motions.1"
    assert refusal(lambda: InteractingModels(motions=())).field == "motions"
    assert refusal(lambda: InteractingModels(sojourn=0.0)).field == "sojourn"
    misfit = InteractingModels(motions=(ConstantVelocity(known_acceleration=(1.0, 2.0, 3.0)),))
    field = refusal(lambda: Scenario(tracker=misfit)).field
    assert field == "tracker.motions.0.known_acceleration"
    for tracker in (InteractingModels(kappa=-4.0), RangeBank(kappa=-4.0)):
        assert refusal(lambda tracker=tracker: Simulation(Scenario(tracker=tracker), 1)).field == "kappa"
    for field, value in (("members", 0), ("reach", 7.0), ("nearest", 0.0), ("nearest", 0.6)):
        assert refusal(lambda field=field, value=value: RangeBank(**{field: value})).field == field
