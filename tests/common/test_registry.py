"""Things known by a name, nvsdata's own and those of installed packages."""

import os
import threading
import warnings

import pytest

from nvsdata.common import registry
from nvsdata.common.registry import Registry


class Point:
    """An entry point that gives what it is told to, or raises it."""

    value = "package:thing"

    def __init__(self, name, thing):
        self.name, self._thing = name, thing

    def load(self):
        if isinstance(self._thing, BaseException):
            raise self._thing
        return self._thing


@pytest.fixture
def breads(monkeypatch):
    """A registry, and what is to be installed."""
    installed, asked = {}, []

    def entry_points(group):
        asked.append(group)
        return [Point(name, thing) for name, thing in installed.items()]

    monkeypatch.setattr("importlib.metadata.entry_points", entry_points)
    return Registry("bread", "breads"), installed, asked


def rye():
    """A thing."""


def test_installed_things_are_loaded_when_they_are_wanted(breads):
    known, installed, asked = breads
    installed |= {"rye": rye, "oat": "oats"}
    assert known.register("wheat", "flour") == "flour"
    # what is known needs no others
    assert known["wheat"] == "flour"
    assert known.loaded() == ("flour",)
    assert asked == []
    assert known["rye"] is rye
    assert asked == ["nvsdata.breads"]
    assert list(known) == ["wheat", "rye", "oat"]
    assert len(known) == 3
    with pytest.raises(KeyError):
        known["stone"]
    # once is enough
    assert asked == ["nvsdata.breads"]


@pytest.mark.parametrize("first", [len, list])
def test_names_and_their_number_are_those_of_all(breads, first):
    known, installed, _ = breads
    installed["rye"] = rye
    assert first(known) in (1, ["rye"])


def test_whether_there_are_new_ones(breads):
    known, installed, _ = breads
    installed["rye"] = rye
    assert known.load_installed()
    assert not known.load_installed()
    none = Registry("bread", "breads")
    none.register("rye", rye)
    assert not none.load_installed()


def test_what_cannot_be_loaded_is_told_and_the_others_work(breads):
    known, installed, _ = breads
    installed |= {"bad": OSError("no flour"), "worse": SystemExit(3), "rye": rye}
    with pytest.warns(UserWarning, match="the bread") as expected:
        assert list(known) == ["rye"]
    assert [str(warning.message) for warning in expected] == [
        "the bread 'bad' (package:thing) of an installed package can't be used: OSError: no flour",
        "the bread 'worse' (package:thing) of an installed package can't be used: SystemExit: 3",
    ]
    # told where it was asked for
    assert expected[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert list(known) == ["rye"]


def test_loading_goes_on_after_it_was_interrupted(breads):
    known, installed, _ = breads
    installed["rye"] = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        len(known)
    installed["rye"] = rye
    assert known["rye"] is rye


def test_a_package_that_asks_while_it_is_loaded_finds_those_known_so_far(breads):
    known, installed, asked = breads
    seen = []
    entered = Registry("bread", "breads", lambda name, thing: seen.append((name, thing, list(entered))))
    entered.register("wheat", "flour")
    installed["rye"] = rye
    assert list(entered) == ["wheat"]
    assert seen == [("rye", rye, ["wheat"])]
    assert asked == ["nvsdata.breads"]
    # what has registered itself while it was loaded isn't entered again
    known.register("my rye", rye)
    assert list(known) == ["my rye"]


def test_a_name_belongs_to_the_thing_that_was_first_defined_there(breads):
    known, *_ = breads

    def rye_again():
        pass

    known.register("rye", rye)
    rye_again.__qualname__, rye_again.__module__ = rye.__qualname__, rye.__module__
    assert known.register("rye", rye_again) is rye_again
    assert known["rye"] is rye_again
    flour = object()
    known.register("flour", flour)
    known.register("flour", flour)
    rye_again.__module__ = "elsewhere"
    for name, other in (("rye", rye), ("flour", object()), ("rye", flour)):
        with pytest.raises(ValueError, match=f"^there is a bread '{name}' already, <.*>: choose another name$"):
            known.register(name, other)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks here")
def test_a_child_does_not_wait_for_a_thread_of_its_parent():
    held, done = threading.Event(), threading.Event()

    def hold():
        with registry._locks[0]:
            held.set()
            done.wait()

    thread = threading.Thread(target=hold)
    thread.start()
    held.wait()
    try:
        child = os.fork()
        if child == 0:
            os._exit(0 if registry._locks[0].acquire(timeout=5) else 1)
        assert os.waitpid(child, 0)[1] == 0
    finally:
        done.set()
        thread.join()
