"""Registries: objects by name, from nvsdata, from the user's program and from installed packages."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from threading import RLock
from typing import Any, Generic, TypeVar

from nvsdata.common.errors import shown

Thing = TypeVar("Thing")


def entry_points(group: str) -> Iterable[Any]:
    """Return the entry points that installed packages have in a group."""
    # imported here, because it takes 28 ms
    from importlib import metadata

    return metadata.entry_points(group=group)


class Registry(Mapping[str, Thing], Generic[Thing]):
    """Objects by their names, in the order in which they were registered.

    Objects of installed packages come last. They are the entry points of the group `nvsdata.PLURAL`, and are loaded
    when a name isn't found without them, or when all names are requested. An object that can't be loaded causes a
    warning.

    Args:
        singular: word for such an object, for messages.
        plural: word for several of them, which names the group of entry points.
        enter: function that registers an entry point's object, given name and object (default: `register`).
    """

    def __init__(self, singular: str, plural: str, enter: Callable[[str, Any], Any] | None = None) -> None:
        self._singular, self._group = singular, f"nvsdata.{plural}"
        self._enter = enter or self.register
        self._known: dict[str, Thing] = {}
        self._loaded = self._loading = False

    def register(self, name: str, thing: Thing) -> Thing:
        """Register an object under a name; return it.

        A class that is defined again, such as when a cell of a notebook is run again, replaces its earlier version.

        Raises:
            ValueError: another object has the name.
        """
        known = self._known.get(name)
        if known is not None and self._origin(known) != self._origin(thing):
            raise ValueError(f"there is a {self._singular} {name!r} already, {known!r}: choose another name")
        self._known[name] = thing
        return thing

    def __getitem__(self, name: str) -> Thing:
        if name not in self._known:
            self._load()
        return self._known[name]

    def __iter__(self) -> Iterator[str]:
        self._load()
        return iter(list(self._known))

    def __len__(self) -> int:
        self._load()
        return len(self._known)

    def loaded(self) -> Iterable[Thing]:
        """Return the objects known so far, without loading those of installed packages."""
        return tuple(self._known.values())

    def load_installed(self) -> bool:
        """Load the objects of installed packages unless they were loaded before; return whether there are new ones."""
        if self._loaded:
            return False
        before = len(self._known)
        self._load()
        return len(self._known) > before

    def _load(self) -> None:
        if self._loaded:
            return
        # other threads wait; a package that looks up names while it is loaded finds the names known so far
        with _locks[0]:
            if self._loaded or self._loading:
                return
            self._loading = True
            # imported here, because it takes about 20 ms
            from importlib.metadata import entry_points

            failed = []
            try:
                for point in entry_points(group=self._group):
                    try:
                        thing = point.load()
                        if not any(thing is known for known in self._known.values()):
                            self._enter(point.name, thing)
                    except (Exception, SystemExit) as error:  # somebody else's package may raise anything
                        what = f"the {self._singular} {point.name!r} ({point.value}) of an installed package"
                        failed.append(f"{what} can't be used: {type(error).__name__}: {shown(error)}")
                self._loaded = True
            finally:
                self._loading = False
        for reason in failed:
            warnings.warn(reason, stacklevel=3)

    def _origin(self, thing: Any) -> object:
        """Return a value that is equal for two versions of an object: the place where it was defined."""
        if hasattr(thing, "__qualname__"):
            return getattr(thing, "__module__", None), thing.__qualname__
        return id(thing)


_locks = [RLock()]


def _renew_lock() -> None:
    """Replace the lock in a forked process, because a thread of the parent may have held the old one."""
    _locks[0] = RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_lock)
