"""Tables in which equal things are one object while somebody has it, and a while longer."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from typing import Final, Generic, TypeVar
from weakref import ref

Thing = TypeVar("Thing")
#: things that are kept though nobody has them: the next variant of a template asks for many again
MOST_KEPT: Final = 1 << 15


class _Place(ref[Thing]):
    """Where a thing is found as long as it lives; Python's own weak tables take twice as long."""

    __slots__ = ("key",)

    key: Hashable


class Interned(Generic[Thing]):
    """The one thing of each key."""

    def __init__(self) -> None:
        #: where each thing is found; who looks there makes no other use of them
        self.places: dict[Hashable, _Place[Thing]] = {}
        self._kept: deque[Thing] = deque(maxlen=MOST_KEPT)
        self._forget_place = self._forget  # one method for all places

    def get(self, key: Hashable) -> Thing | None:
        """Return the thing of a key, None where there is none."""
        place = self.places.get(key)
        return None if place is None else place()

    def keep(self, key: Hashable, thing: Thing) -> Thing:
        """Let a new thing be the one of its key, and return it."""
        place = _Place(thing, self._forget_place)
        place.key = key
        self.places[key] = place
        self._kept.append(thing)
        return thing

    def _forget(self, dead: _Place[Thing]) -> None:
        if self.places.get(dead.key) is dead:
            del self.places[dead.key]
