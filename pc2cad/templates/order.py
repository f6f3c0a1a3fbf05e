"""In which order the entries of a template are read: each after what it mentions.

Guides, curves, tables and layers may use entries of `[let]`, and these may use them. Entries of one
table keep the order of the file, and mention earlier ones only.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from typing import Any, Final, NoReturn

_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z_0-9]*", re.ASCII)
#: names that stand for a curve's own parameter in its formulas
_OWN: Final = frozenset(("t", "phi", "u"))
#: the points that a frame defines
FRAME_NAMES: Final = frozenset(("R", "Q"))
#: what tables define as a whole; others define one name, or three, per entry
_WHOLE: Final = {"guide": ("N",), "frame": ("R", "Q"), "layers": ("depth",)}


@dataclass(frozen=True)
class Entry:
    """An entry of a table, or (`whole`) a table that is read at once."""

    section: str
    name: str
    raw: Any
    whole: bool = False

    @property
    def key(self) -> str:
        """The entry as messages name it."""
        return f"[{self.section}] {self.name}".rstrip()

    @property
    def defines(self) -> tuple[str, ...]:
        """The names that it defines."""
        if self.whole:
            return _WHOLE[self.section]
        if self.section == "curves":
            return self.name, f"{self.name}_x", f"{self.name}_y"
        return (self.name,)

    def mentions(self) -> set[str]:
        """Return the names in its expressions."""
        found: set[str] = set()
        stack = [self.raw]
        while stack:
            value = stack.pop()
            if isinstance(value, str):
                found.update(_NAME.findall(value))
            elif isinstance(value, dict):
                stack += value.values()
            elif isinstance(value, list):
                stack += value
        return found - _OWN if self.section == "curves" else found


def entries(sections: Mapping[str, Mapping[str, Any]]) -> list[Entry]:
    """Return the entries of tables, in the order of the tables given."""
    found = []
    for section, table in sections.items():
        if section in _WHOLE:
            found.append(Entry(section, "", table, whole=True))
        else:
            found += [Entry(section, name, raw) for name, raw in table.items()]
    return found


def in_order(listed: list[Entry], complain: Callable[[str, str], NoReturn]) -> Iterator[Entry]:
    """Yield entries, each after those it mentions, as early in the given order as that allows.

    `complain` is called with a key and a message where entries mention one another.
    """
    owner = {name: i for i, entry in reversed(list(enumerate(listed))) for name in entry.defines}
    needs: list[set[int]] = []
    for i, entry in enumerate(listed):
        wanted = {owner[name] for name in entry.mentions() if name in owner}
        if entry.section == "frame":
            wanted |= {k for k, other in enumerate(listed) if other.section == "guide"}
        # a later entry of the same table is no entry yet: it will be complained of as unknown
        needs.append({k for k in wanted if k < i or listed[k].section != entry.section})
    users: dict[int, list[int]] = {}
    for i, wanted in enumerate(needs):
        for k in wanted:
            users.setdefault(k, []).append(i)
    ready = [i for i, wanted in enumerate(needs) if not wanted]
    heapify(ready)
    left = set(range(len(listed)))
    while ready:
        i = heappop(ready)
        left.remove(i)
        yield listed[i]
        for user in users.get(i, ()):
            needs[user].discard(i)
            if not needs[user]:
                heappush(ready, user)
    if left:
        first = _in_circle(needs, min(left))
        other = listed[min(needs[first])]
        complain(listed[first].key, f"is made of {other.key}, which is made of it in turn")


def _in_circle(needs: list[set[int]], start: int) -> int:
    """Return an entry that is made of itself, in the end."""
    seen: set[int] = set()
    while start not in seen:
        seen.add(start)
        start = min(needs[start])
    return start
