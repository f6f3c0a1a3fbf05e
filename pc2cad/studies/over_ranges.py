"""What is proved over the ranges of parameters: for whoever asks, and for who builds many variants.

A study of many variants is proved once, before its workers begin; who does not know how many there
will be, as `adjust` and sliders do not, once as many were asked for. A variant whose values lie in
a proved box need not be asked again for the sign of det J, nor which sides collapse and coincide.
"""

from __future__ import annotations

import base64
import os
import pickle
import zlib
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

from pc2cad.errors import InputError, PointCadError
from pc2cad.studies.plan import Plan
from pc2cad.templates.bodies import BodiesTemplate
from pc2cad.templates.file import read_template
from pc2cad.templates.header import Header
from pc2cad.templates.ranges import read_axis
from pc2cad.templates.template import Template

if TYPE_CHECKING:
    from pc2cad.equation.family import Family
    from pc2cad.solidity.over_ranges.boxes import ProvedBox, RangeProof

#: variants of a study below which a proof is not worth its time, and those for which it may take
#: all of its effort: a variant is built 0.6 to 2.7 ms sooner; what proves is loaded in 0.12 s, and
#: proves elementary solids in 5 to 20 ms at any effort, channels in some tenths of a second
FEWEST: Final = 250
MANY: Final = 2000
#: variants after which it is asked for where nobody knows how many there will be
LATER: Final = 50


def prove_over(
    template: Template | BodiesTemplate | str | os.PathLike[str],
    over: Mapping[str, str | Sequence[float]],
    values: Mapping[str, Any] | None = None,
    *,
    effort: float = 1.0,
) -> RangeProof:
    """Return for which values within ranges a solid is proved to keep its orientation and sides.

        pc.prove_over("torus", {"r": "1:4.5"}).is_whole

    A range is a text ``LOW:HIGH``, or lower and upper limit, both included. `values` sets other
    parameters and points, as `bind` does. `effort` multiplies the operations that may be spent,
    which are about a second. What stays open is not refuted. Raises InputError, and RangeError for
    a range that is none.
    """
    from pc2cad.solidity.over_ranges.search import prove_over as prove_family

    whole = (
        template if isinstance(template, (Template, BodiesTemplate)) else read_template(template)
    )
    if isinstance(whole, BodiesTemplate):
        raise InputError(f"{whole.name} has several bodies: ranges are proved of one equation")
    if not over:
        raise InputError("say over which ranges, for example r=1:4.5")
    if not effort > 0:
        raise InputError(f"the effort of a proof is a positive number, and {effort:g} was given")
    ranges = {name: _limits(name, given) for name, given in over.items()}
    family = whole.family(list(ranges), values)
    for name, limits in ranges.items():
        for limit in limits:
            whole.values({**(values or {}), name: limit})  # within min and max
    return prove_family(family, ranges, effort)


def _limits(name: str, given: str | Sequence[float]) -> tuple[float, float]:
    axis = read_axis(name, given)
    if isinstance(given, str) and axis.range is None:
        raise InputError(f"--over '{name}={given[:80]}': write NAME=LOW:HIGH")
    if axis.range is None and len(axis.values) != 2:
        raise InputError(f"the range of {name} has two limits, and another upper than lower one")
    low, high = axis.range or axis.values
    return low, high


def proof_of_plan(
    template: Template | BodiesTemplate, plan: Plan, fixed: Mapping[str, Any]
) -> RangeProof | None:
    """Return what is proved over the ranges of a study's parameters; None where it does not pay.

    Values that the template does not allow are of variants that will not be built.
    """
    if len(plan) < FEWEST or isinstance(template, BodiesTemplate):
        return None
    limits = {parameter.name: parameter.limits for parameter in template.parameters}
    ends = dict[str, tuple[float, float]]()
    for name, row in zip(plan.names, zip(*plan.variants, strict=True), strict=True):
        allowed = [x for x in row if limits[name][0] <= x <= limits[name][1]]
        if not allowed:
            return None
        ends[name] = min(allowed), max(allowed)
    over = {name: (low, high) for name, (low, high) in ends.items() if low < high}
    alike = {name: low for name, (low, _) in ends.items() if name not in over}
    if not over:
        return None
    return attempted(lambda: template.family(list(over), {**fixed, **alike}), over, len(plan))


def attempted(
    family: Callable[[], Family], over: Mapping[str, tuple[float, float]], count: int
) -> RangeProof | None:
    """Return what is proved for that many variants, None where nothing can be asked."""
    from pc2cad.solidity.over_ranges.search import prove_over as prove_family

    try:
        return prove_family(family(), over, min(1.0, count / MANY))
    except (PointCadError, RecursionError):
        return None  # variants say what is wrong, each for itself


class ProvedLater:
    """What is proved over ranges for variants of which nobody knows how many there will be.

    It is asked for when there were so many that as many more would pay for it.
    """

    def __init__(
        self,
        template: Template | BodiesTemplate,
        over: Mapping[str, tuple[float, float]],
        fixed: Mapping[str, Any],
    ) -> None:
        self._template, self._over, self._fixed = template, dict(over), fixed
        self._asked = 0
        self._proof: RangeProof | None = None

    def at(self, values: Mapping[str, Any]) -> ProvedBox | None:
        """Return the proved box in which the next variant lies, None where none is known of.

        Nothing is known where something else is set than what runs, a point for example.
        """
        template, over, fixed = self._template, self._over, self._fixed
        if isinstance(template, BodiesTemplate) or not values.keys() <= over.keys():
            return None
        self._asked += 1
        if self._asked == LATER:
            self._proof = attempted(lambda: template.family(list(over), fixed), over, LATER)
        if self._proof is None:
            return None
        return self._proof.at(template.values({**fixed, **values})[0])


def packed(proof: RangeProof | None) -> str:
    """Return a proof as a text that workers get with their task; nothing where none is of use."""
    if proof is None or not proof.proved:
        return ""
    return base64.b64encode(zlib.compress(pickle.dumps(proof))).decode()


@lru_cache(maxsize=2)
def _unpacked(text: str) -> RangeProof:
    # it comes from the process that started this one
    proof: RangeProof = pickle.loads(zlib.decompress(base64.b64decode(text)))
    return proof


def known_at(text: str, template: Header, values: Mapping[str, Any]) -> ProvedBox | None:
    """Return the proved box of a packed proof that a variant lies in, or None."""
    return _unpacked(text).at(template.values(values)[0])
