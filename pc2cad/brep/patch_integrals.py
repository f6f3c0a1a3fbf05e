"""Integrals over whole spline surfaces: Gauss rules per span, settled on lines across it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import product
from pc2cad.brep.forms import FLUX, Form
from pc2cad.brep.gauss_rules import between, gauss, rules_together
from pc2cad.brep.spline_integrals import ALL, Patch, Stack, project
from pc2cad.brep.spline_tables import Table, bases, part_of
from pc2cad.errors import KernelError
from pc2cad.geometry.splines.turns import turning_limits

#: exact forms have few pieces (a full turn has 4)
MOST_EXACT_PIECES = 64
#: places of the lines on which a rule is settled: uneven, near both ends, for so many spans
_SPANS = 40
_LINES = np.array([0.004, 0.083, 0.207, 0.311, 0.468, 0.547, 0.719, 0.854, 0.934, 0.996])
#: orders of Gauss rules, the last of which the others are held against, and what that is itself
#: held against where spans are halved; and how often these are
_ORDERS, _HIGHEST, DEEPEST = (4, 6, 8), 12, 24
#: what the first order may leave, by the accuracy, for the second to be tried, and to be taken, and
#: what that may leave for this: less, as little more makes it much better
FAR, NEAR, CLOSE = 1e5, 100, 0.02
#: pieces turn by so much at most (radians) before rules are tried on them
FARTHEST_TURN = np.pi / 3
#: how often lines are taken anew; what is sharp beyond that shows in areas that disagree with the
#: equation's
MOST_ROUNDS = 4
#: what may be left open in the end, by the accuracy that each span is settled to
LEFT_OPEN = 100
#: places of a grid that are evaluated at once: what is made of them stays near
TOGETHER = 6_000
#: places on lines that are looked at together
MOST_ON_LINES = 10_000

TINY = float(np.finfo(float).tiny)


def patch_integrals(patches: Sequence[Patch], form: Form = FLUX) -> list[Array]:
    """Return the integrals of a form over each of some patches, by their own normals.

    Those of the same knots, as the sides of a wall have them, are integrated together, with the
    nodes that suit all of them.
    """
    found: list[Array] = [np.empty(0)] * len(patches)
    groups: dict[object, list[int]] = {}
    limits = [_limits(patch) for patch in patches]
    for i, (patch, cuts) in enumerate(zip(patches, limits, strict=True)):
        key = *(row.tobytes() for row in (*patch.knots, *cuts)), patch.degrees, patch.poles.shape
        groups.setdefault(key, []).append(i)
    for members in groups.values():
        cuts = limits[members[0]]
        step = _most_together(cuts)
        for start in range(0, len(members), step):
            part = members[start : start + step]
            rows = _Whole([patches[i] for i in part], cuts).integrate(form)
            for i, row in zip(part, rows, strict=True):
                found[i] = row
    return found


def _most_together(limits: tuple[Array, Array]) -> int:
    """Return how many patches of such pieces may be looked at together."""
    pairs = (limits, limits[::-1])
    places = max(sum(_ORDERS[::2]) * len(ends) * len(_lines(across)) for ends, across in pairs)
    return max(1, MOST_ON_LINES // places)


def _limits(patch: Patch) -> tuple[Array, Array]:
    """Return the ends of the pieces along both directions that rules begin with."""
    first, second = (distinct(knots) for knots in patch.knots)
    if len(first) > 2 and len(second) > 2:
        return first, second
    net = project(patch.poles)[0]
    return (
        turning_limits(first, net.transpose(1, 0, 2), FARTHEST_TURN),
        turning_limits(second, net, FARTHEST_TURN),
    )


#: the basis functions of one direction, and those of the derivative's poles, at some places
_Tables = list[Table]


class _Whole:
    """Patches (w of them) of the same knots, degrees and pieces, integrated together."""

    def __init__(self, patches: Sequence[Patch], limits: tuple[Array, Array]) -> None:
        self._limits, self._stack = limits, Stack(patches)
        pieces = [len(ends) - 1 for ends in limits]
        #: what areas are worth: all digits on few pieces (exact forms), a fit's own on many
        self.accuracy = 1e-13 if pieces[0] * pieces[1] <= MOST_EXACT_PIECES else 1e-10
        far = (self._stack.poles[:3] ** 2).sum(axis=0)
        #: how far each is from the origin, at most, (w,)
        self._reach = np.sqrt(far.reshape(len(far), -1).max(axis=1))
        self._panels = [np.stack((ends[:-1], ends[1:]), axis=1) for ends in limits]
        self._lines = [_lines(ends) for ends in limits]
        nodes, _ = rules_together(_ORDERS)
        #: of each direction the tables on its lines and then at the nodes of all orders
        self._first = [
            self._tables(d, np.concatenate((lines, between(panels, nodes).ravel())))
            for d, (lines, panels) in enumerate(zip(self._lines, self._panels, strict=True))
        ]

    def integrate(self, form: Form) -> Array:
        """Return the integrals (w, columns), with as many nodes as they need, where needed."""
        (s, along_s), (t, along_t) = self._rules()
        seen = self._stack.on_tables(s, t)
        total: Array | float = 0.0
        step = max(1, TOGETHER // (len(along_t) * len(self._reach)))
        for i in range(0, len(along_s), step):
            part = slice(i, i + step)
            values = form.rows(*seen(part))
            total = total + product(product(values, along_t), along_s[part])
        return np.asarray(total).T

    def _rules(self) -> list[tuple[_Tables, Array]]:
        """Return tables and weights along both directions, each settled on lines across it.

        Where spans had to be halved there is something sharp, and it may be sharper between the
        lines of the other direction: these are then taken anew, until no span is halved for it.
        """
        limits = list(self._limits)
        rules: list[tuple[_Tables, Array]] = []
        for _ in range(MOST_ROUNDS):
            before = [len(x) for x in limits]
            rules = []
            for d in (0, 1):
                tables, weights, limits[d] = self._rule(d, self._across(1 - d, limits[1 - d]))
                rules.append((tables, weights))
            if [len(x) for x in limits] == before:
                break
        return rules

    def _tables(self, direction: int, places: Array) -> _Tables:
        return bases(places, self._stack.knots[direction], self._stack.degrees[direction])

    def _across(self, direction: int, limits: Array) -> _Tables:
        """Return the tables on lines at places of a direction with such pieces."""
        if limits is self._limits[direction]:
            part = slice(len(self._lines[direction]))
            return [part_of(table, part) for table in self._first[direction]]
        return self._tables(direction, _lines(limits))

    def _at_first(self, direction: int, orders: tuple[int, ...]) -> _Tables:
        """Return the tables at the nodes of some of `_ORDERS` on the pieces to begin with."""
        own = _own_nodes(orders)
        starts = np.arange(len(self._panels[direction]))[:, None] * sum(_ORDERS)
        rows = (len(self._lines[direction]) + starts + own).ravel()
        return [part_of(table, rows) for table in self._first[direction]]

    def _whole_rule(self, direction: int, order: int) -> tuple[_Tables, Array, Array]:
        """Return what `_rule` does, for one order on all the pieces to begin with."""
        panels, tables = self._panels[direction], self._at_first(direction, (order,))
        return tables, gauss(panels, order)[1], self._limits[direction]

    def _rule(self, direction: int, lines: _Tables) -> tuple[_Tables, Array, Array]:
        """Return tables and weights along a direction, settled on lines across it, and its panels.

        Panels are returned as their limits.
        """
        few, some, high = _ORDERS
        sums, many = self._panel_sums(direction, None, lines, (few, high))
        scale = self._scale(np.abs(many).sum(axis=2))
        gap = _gaps(sums, many, scale).max()
        if gap <= self.accuracy:
            return self._whole_rule(direction, few)
        if gap <= FAR * self.accuracy:
            (sums,) = self._panel_sums(direction, None, lines, (some,))
            left = _gaps(sums, many, scale).max()
            if left <= CLOSE * self.accuracy and gap <= NEAR * self.accuracy:
                return self._whole_rule(direction, some)
            if left <= self.accuracy:
                # the second would do as the first does above, and the last is better
                return self._whole_rule(direction, high)
        return self._rule_of_halves(direction, lines, many)

    def _rule_of_halves(
        self, direction: int, lines: _Tables, few: Array
    ) -> tuple[_Tables, Array, Array]:
        """Return what `_rule` does, where spans of one order do not do; `few` are their sums by it.

        Spans whose integrals change with the order of the rule are halved until they do not: a
        crease much sharper than its span is found, and only there is it resolved.
        """
        panels = self._panels[direction]
        last = panels[-1:, 1]
        done, starts = list[tuple[Array, Array]](), list[Array]()
        sizes = np.zeros((5, len(self._reach), few.shape[-1]))
        for depth in range(DEEPEST):
            orders = (_HIGHEST, _ORDERS[-1])[: 1 if depth == 0 else 2]
            many, *others = self._panel_sums(direction, panels, lines, orders)
            (few,) = others or [few]
            sizes = np.maximum(sizes, np.abs(many).sum(axis=2))
            gaps = _gaps(few, many, self._scale(sizes))
            right = gaps <= self.accuracy
            if depth == 0 and right.all():
                return self._whole_rule(direction, _ORDERS[-1])
            done.append(gauss(panels[right], _ORDERS[-1]))
            starts.append(panels[right, 0])
            panels = panels[~right]
            if len(panels) == 0:
                break
            middle = panels.mean(axis=1)
            panels = np.concatenate((
                np.stack((panels[:, 0], middle), axis=1), np.stack((middle, panels[:, 1]), axis=1)
            ))  # fmt: skip
        if len(panels) and not gaps[~right].sum() <= LEFT_OPEN * self.accuracy:
            raise KernelError(
                f"the integrals over a face do not settle: after halving its spans {DEEPEST} "
                f"times, {gaps[~right].sum():.2g} of them is left open"
            )
        done.append(gauss(panels, _HIGHEST))
        nodes, weights = (np.concatenate([rule[k] for rule in done]) for k in (0, 1))
        order = np.argsort(nodes)
        limits = np.sort(np.concatenate((*starts, panels[:, 0], last)))
        return self._tables(direction, nodes[order]), weights[order], limits

    def _scale(self, sizes: Array) -> Array:
        """Return what integrals (5, w) along lines count against, from sizes (5, w, lines)."""
        # lines near a pole add little: what counts is the largest
        volume, area = sizes[:2].max(axis=2)
        return np.array([volume, area, *[volume * self._reach] * 3]) + TINY

    def _panel_sums(
        self, direction: int, panels: Array | None, lines: _Tables, orders: tuple[int, ...]
    ) -> list[Array]:
        """Return the integrands of `FLUX` along each line over each panel, (5, w, panels, lines).

        Once for each order of a Gauss rule; without panels over the pieces to begin with, by some
        of `_ORDERS`.
        """
        x, weights = rules_together(orders)
        if panels is None:
            panels, nodes = self._panels[direction], self._at_first(direction, orders)
        else:
            nodes = self._tables(direction, between(panels, x).ravel())
        half = (panels[:, 1] - panels[:, 0])[:, None] / 2
        both = (nodes, lines) if direction == 0 else (lines, nodes)
        values = FLUX.rows(*self._stack.on_tables(*both)(ALL))
        shape = len(panels), len(x)
        if direction == 0:
            sums = weights @ values.reshape(*values.shape[:2], *shape, -1)
            return [sums[..., k, :] * half for k in range(len(orders))]
        sums = values.reshape(*values.shape[:2], -1, *shape) @ weights.T
        return [sums[..., k].swapaxes(2, 3) * half for k in range(len(orders))]


@lru_cache(maxsize=8)
def _own_nodes(orders: tuple[int, ...]) -> Integers:
    """Return which of the nodes of all `_ORDERS` together are those of some."""
    weights = rules_together(_ORDERS)[1]
    return np.flatnonzero(weights[[_ORDERS.index(order) for order in orders]].any(axis=0))


def _lines(knots: Array) -> Array:
    """Return places of lines across a direction with these knots.

    They are spread over the spans and not over the parameter: where a fit saw more, there is more
    to see, and a needle lies between lines that are even.
    """
    spans = len(knots) - 1
    parts = -(-spans // _SPANS)
    places = (np.arange(parts)[:, None] + _LINES).ravel() / parts
    return np.asarray(np.interp(places * spans, np.arange(spans + 1), knots))


def _gaps(few: Array, many: Array, scale: Array) -> Array:
    """Return by how much integrals (5, w, panels, lines) of two rules differ on each panel."""
    return np.asarray((np.abs(few - many).max(axis=3) / scale[..., None]).max(axis=(0, 1)))
