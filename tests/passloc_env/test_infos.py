"""Infos that are made when they are looked at are a list of dictionaries in every respect."""

import copy
import pickle

import pytest

from passloc_env.infos import Infos

PLAIN = [{}, {"episode": 1}, {}, {}]


@pytest.fixture
def infos() -> Infos:
    return Infos(4, {1: {"episode": 1}})


@pytest.mark.parametrize("view", [list, copy.copy, copy.deepcopy, lambda infos: infos[:], Infos.copy])
def test_every_view_is_the_plain_list(infos: Infos, view) -> None:
    found = view(infos)
    assert found == PLAIN
    assert all(type(info) is dict for info in found)


def test_it_equals_prints_and_pickles_as_the_plain_list(infos: Infos) -> None:
    assert infos == PLAIN
    assert infos == Infos(4, {1: {"episode": 1}})
    assert infos != PLAIN[1:]
    assert repr(infos) == repr(PLAIN)
    assert pickle.loads(pickle.dumps(infos)) == PLAIN


def test_what_is_written_stays_and_is_nobody_elses(infos: Infos) -> None:
    infos[-1]["mine"] = 2
    infos[0] = {"new": 3}
    assert infos[3] == {"mine": 2}
    assert infos[2] == {}
    assert list(infos) == [{"new": 3}, {"episode": 1}, {}, {"mine": 2}]
    assert infos[1:3] == [{"episode": 1}, {}]
    with pytest.raises(IndexError):
        infos[4]
