"""The named scenarios, one small file per family."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from passloc_env.errors import ScenarioError, unknown_name
from passloc_env.scenario import Scenario
from passloc_env.scenarios.bearing_doppler import BEARING_DOPPLER, BEARING_DOPPLER_UNKNOWN_CARRIER
from passloc_env.scenarios.bearing_doppler_cases import (
    BEARING_DOPPLER_1A,
    BEARING_DOPPLER_1B,
    BEARING_DOPPLER_2A,
    BEARING_DOPPLER_2B,
)
from passloc_env.scenarios.bearings_only import BEARINGS_ONLY, BEARINGS_ONLY_FAR
from passloc_env.scenarios.cross_fix import CROSS_FIX
from passloc_env.scenarios.dual_array import DUAL_ARRAY
from passloc_env.scenarios.dual_satellite import DUAL_SATELLITE
from passloc_env.scenarios.own_ship import OWN_SHIP_MODERATE, OWN_SHIP_SEVERE
from passloc_env.scenarios.radial_acceleration import RADIAL_ACCELERATION

SCENARIOS: dict[str, Scenario] = {
    scenario.name: scenario
    for scenario in (
        BEARINGS_ONLY,
        BEARINGS_ONLY_FAR,
        OWN_SHIP_MODERATE,
        OWN_SHIP_SEVERE,
        BEARING_DOPPLER,
        BEARING_DOPPLER_UNKNOWN_CARRIER,
        BEARING_DOPPLER_1A,
        BEARING_DOPPLER_1B,
        BEARING_DOPPLER_2A,
        BEARING_DOPPLER_2B,
        RADIAL_ACCELERATION,
        DUAL_ARRAY,
        DUAL_SATELLITE,
        CROSS_FIX,
    )
}
"""All registered scenarios by name."""

NAMESPACE, VERSION = "passloc", 0


def environment_id(name: str) -> str:
    """The Gymnasium id of a named scenario, e.g. ``passloc/BearingsOnly-v0``."""
    return f"{NAMESPACE}/{name}-v{VERSION}"


_FILES = (".yaml", ".yml", ".json")


def find(scenario: str | Mapping[str, Any] | Scenario) -> Scenario:
    """A scenario from its name, its Gymnasium id, the path of its file (YAML or JSON), from plain data, or itself.

    Raises:
        ScenarioError: unknown name (with the closest one), unreadable file or impossible data.
    """
    if isinstance(scenario, Scenario):
        return scenario
    if isinstance(scenario, Mapping):
        return Scenario.from_dict(scenario)
    if not isinstance(scenario, str):
        raise ScenarioError("scenario", scenario, "must be a name, a mapping of fields, or a Scenario")
    if scenario.endswith(_FILES):
        return _read(scenario)
    name = scenario.removeprefix(f"{NAMESPACE}/").removesuffix(f"-v{VERSION}")
    if name not in SCENARIOS:
        raise unknown_name("scenario", scenario, SCENARIOS, "scenario")
    return SCENARIOS[name]


def _read(path: str) -> Scenario:
    try:
        return Scenario.from_file(path)
    except OSError as error:
        raise ScenarioError("scenario", path, f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ScenarioError("scenario", path, "is not a text file") from None
