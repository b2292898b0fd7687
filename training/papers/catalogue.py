"""The papers by name."""

from __future__ import annotations

import importlib
from dataclasses import dataclass

from passloc_env.errors import InputError, unknown_name
from training.papers.reproduction import Reproduction


@dataclass(frozen=True)
class Paper:
    """A paper and the module that reproduces it."""

    name: str
    number: str
    """As docstrings cite it."""
    citation: str
    subject: str

    def reproduce(self, reproduction: Reproduction) -> None:
        """Run the paper's simulations and record claims, figures and tables."""
        module = importlib.import_module(f"training.papers.{self.name.replace('-', '_')}")
        module.reproduce(reproduction)


PAPERS = {
    paper.name: paper
    for paper in (
        Paper(
            "bearing-doppler",
            "000",
            "Zhan R., Wang L., Wan J.: *Observability of maneuvering target passive tracking with bearing and Doppler "
            "measurements*, National University of Defense Technology, 2006.",
            "Bearing and Doppler from one fixed station; accelerating and turning emitters.",
        ),
        Paper(
            "dual-satellite",
            "001",
            "Xu H., Su C., Dang W., Gao F.: tracking of airborne emitters by fusing the interferometer phases of two "
            "satellites and their time difference, Beijing Institute of Remote Sensing Information.",
            "Two satellites with interferometers and the time difference.",
        ),
        Paper(
            "radial-acceleration",
            "002",
            "Feng D., Li Z., Zhou Y., Sun Z.: *A new single observer passive location and tracking technology and its "
            "observability analysis*, National University of Defense Technology.",
            "Bearing and radial acceleration from one fixed station.",
        ),
        Paper(
            "dual-array",
            "003",
            "Xu Z., Han S.: tracking of an accelerating emitter with the bearings of two arrays and a frequency, "
            "*Transducer and Microsystem Technologies* 31(7), 2012.",
            "Two sonar arrays; an emitter on the line through both.",
        ),
        Paper(
            "cross-fix",
            "004",
            "Shen X., Xu B., Zou J., Wan Y., Tang S., Yang W.: *A positive restriction method used in crossing "
            "location*, Journal of UESTC 43(6), 2014, doi:10.3969/j.issn.1001-0548.2014.06.007.",
            "Bearings of several stations crossed by least squares.",
        ),
    )
}
"""In the order in which the code cites them."""


def find_papers(name: str) -> list[Paper]:
    """The paper of a name or number, or all of them.

    Raises:
        InputError: no such paper, with the closest name.
    """
    if name == "all":
        return list(PAPERS.values())
    found = [paper for paper in PAPERS.values() if name in (paper.name, paper.number)]
    if not found:
        numbers = [paper.number for paper in PAPERS.values()]
        raise InputError(str(unknown_name("paper", name, [*PAPERS, *numbers, "all"], "paper")))
    return found
