"""What is known of trees while the faces of a part are compared with their splines."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import prod
from typing import TYPE_CHECKING, Final

import numpy as np

from pc2cad.arrays import Array
from pc2cad.bounds.cells import Cells
from pc2cad.bounds.courses import Course
from pc2cad.bounds.taylor_models import Model, Place, apart
from pc2cad.expression.carried import Carried, earlier_trees, meet
from pc2cad.expression.evaluation import Program
from pc2cad.expression.tree import Expr

if TYPE_CHECKING:
    from pc2cad.bounds.discs import Discs

#: models of two parameters by the places that they hold for, as many of them as are kept; and the
#: boxes up to which they are: models on more would fill the memory
MOST_GRIDS, MOST_BOXES = 6, 512
#: arrays of places of which values of functions of one parameter are kept
MOST_PLACES: Final = 6
#: bytes of models that are carried from one build to the next, and how much of a model is found out
#: besides its terms, radius and error when it is asked for
MOST_CARRIED, SIZES = 1 << 25, 2

Key = tuple[object, ...]
#: models of one kind of trees, by tree
Store = dict[Expr, Model]
_carried: Final[Carried[Model]] = Carried(MOST_CARRIED)


class Known:
    """Models by the places that they hold for: the faces and edges of a part share many.

    Two walls of a channel are made of the same roots and lengths of two parameters; all that runs
    along one side shares what depends on the parameter along it alone.
    """

    def __init__(self) -> None:
        self._stores: dict[Key, Store] = {}
        self._grids: dict[Key, Store] = {}
        #: cells by a parameter's name and the cells first tried: what is hard for one function of
        #: a parameter is hard for its others
        self.finer: dict[tuple[str, int, bytes], Cells] = {}
        #: functions of a parameter beside their fits: two walls share those along the guide
        self.courses: dict[Key, Course] = {}
        #: discs round boxes of a parameter: two walls have the same along the guide
        self.discs: dict[Key, Discs] = {}
        #: trees of two parameters as sums of products, by those and a name
        self.products: dict[Key, list[tuple[tuple[Expr, ...], Expr]] | None] = {}
        #: trees in one parameter, by its name, that will be asked for where others are: with them
        self.expected: dict[str, dict[Expr, None]] = {}
        #: values of trees in one parameter, by its name and the places
        self._values: dict[tuple[str, bytes], dict[Expr, Array]] = {}

    def values(self, trees: Sequence[Expr], name: str, places: Array) -> list[Array]:
        """Return the values of trees in one parameter at places (n), (n) each; not to be changed.

        With them come those that are expected, in one program.
        """
        key = name, places.tobytes()
        found = self._values.pop(key, {})
        if not all([tree in found for tree in trees]):
            every = dict.fromkeys(trees) | self.expected.get(name, {})
            missing = tuple([tree for tree in every if tree not in found])
            for tree, value in zip(missing, Program(missing)({name: places}), strict=True):
                found[tree] = np.broadcast_to(value, places.shape)
        self._values[key] = found
        if len(self._values) > MOST_PLACES:
            del self._values[next(iter(self._values))]
        return [found[tree] for tree in trees]

    def at(self, names: Sequence[str], places: Sequence[Place], order: int) -> Models:
        """Return the models known for the product of some places, to be added to."""
        keys = [
            (order, axis, name, place.error, place.centre.shape,
             *(x.tobytes() for x in (place.centre, place.half, place.radius)))
            for axis, (name, place) in enumerate(zip(names, places, strict=True))
        ]  # fmt: skip
        alone = {
            name: self._stores.setdefault(key, {}) for name, key in zip(names, keys, strict=True)
        }
        grid: Store = {}
        if len(keys) > 1 and prod(place.centre.size for place in places) <= MOST_BOXES:
            # the walls of one piece are proved one after the other
            grid = self._grids.pop(tuple(keys), grid)
            self._grids[tuple(keys)] = grid
            if len(self._grids) > MOST_GRIDS:
                del self._grids[next(iter(self._grids))]
        own: dict[frozenset[str], Key] = {
            frozenset((name,)): key for name, key in zip(names, keys, strict=True)
        }
        return Models(alone, grid, {frozenset(names): tuple(keys), **own})


@dataclass(frozen=True, eq=False)
class Models:
    """Models on the product of some places: of trees of one parameter each, and of the others."""

    alone: dict[str, Store]
    grid: Store
    #: by the parameters of trees: what tells the places of their models; none are carried without
    places: Mapping[frozenset[str], Key] = field(default_factory=dict)

    def of(self, node: Expr) -> Store:
        """Return the models among which a tree's belongs."""
        if len(node.symbols) > 1:
            return self.grid
        # a constant is one of any parameter
        return self.alone.get(next(iter(node.symbols or self.alone)), self.grid)

    def stored(self, node: Expr) -> Model | None:
        """Return the model of a tree, None where there is none yet."""
        return self.of(node).get(node)

    def carried(self, node: Expr) -> Model | None:
        """Return the model of a tree of an earlier build, None where it has been lost."""
        return _carried.get((node, self.places.get(node.symbols)))

    def store(self, found: Store) -> None:
        """Take models in."""
        if len(self.alone) == 1:
            ((_, store),) = self.alone.items()
            store |= found
            return
        for node, model in found.items():
            self.of(node)[node] = model

    def carry(
        self,
        roots: Sequence[Expr],
        found: Store,
        fresh: Sequence[Expr],
        below: Callable[[Expr], tuple[Expr, ...]],
    ) -> None:
        """Leave to later builds what occurred in an earlier one and new trees are made of.

        `fresh` are the trees whose models were not there, and `below` says what they are made of.
        """
        earlier = earlier_trees()
        new = [node for node in fresh if node not in earlier]
        among = set(new)
        kept = {arg for node in new for arg in below(node)} | set(roots)
        for node in kept - among:
            place = self.places.get(node.symbols)
            if place is not None and node.op != "symbol":
                model = found[node]
                size = model.terms.nbytes + model.radius.nbytes + model.error.nbytes
                _carried.keep((node, place), apart(model), SIZES * size)
        meet([node for node in fresh if node.symbols])
