"""Which variants a study consists of: a grid, a list, a table of values, or a sample.

A variant is a mapping of parameter names to numbers. Everything is checked against the template
before the first one is built, and counted before it is laid out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from typing import Final

from pc2cad.equation.language import nearest, read_expression
from pc2cad.errors import InputError
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr
from pc2cad.templates.bodies import BodiesTemplate
from pc2cad.templates.template import Template

#: more variants than this are taken for a slip of the pen
MOST_VARIANTS: Final = 1_000_000
#: parameters that vary, and values of all variants together
MOST_AXES: Final = 256
MOST_VALUES: Final = 5_000_000
#: a plain decimal number, which is read without an expression
_DECIMAL: Final = re.compile(r"-?[0-9]{1,20}(?:\.[0-9]{0,20})?(?:[eE][+-]?[0-9]{1,2})?\Z")
_SAMPLE: Final = re.compile(r"(lhs|sobol):([0-9]{1,9})\Z")

Variant = Mapping[str, float]


class PlanError(InputError):
    """The variants of a study are not well described."""


@dataclass(frozen=True)
class Axis:
    """One parameter that varies: its values in order, or a range that a sample is drawn from."""

    name: str
    values: tuple[float, ...] = ()
    range: tuple[float, float] | None = None


@dataclass(frozen=True)
class Plan:
    """The variants of a study, in order; every one sets the same parameters."""

    names: tuple[str, ...]
    variants: tuple[tuple[float, ...], ...]

    def __len__(self) -> int:
        return len(self.variants)

    def values(self, index: int) -> dict[str, float]:
        """Return the parameters that a variant sets."""
        return dict(zip(self.names, self.variants[index], strict=True))


def read_axis(name: str, given: str | Sequence[float]) -> Axis:
    """Return the axis of a parameter: its values, or a text that describes them.

    ``0.1:0.9:17`` stands for 17 values, ends included; ``0.2,0.5`` for these; ``0.1:0.9`` for a
    range that a sample is drawn from. Each number may be a constant expression such as ``1/3``.
    Raises PlanError.
    """
    where = f"values of {name[:80]}"
    if not isinstance(given, str):
        return Axis(name, tuple(dict.fromkeys(read_number(where, repr(float(v))) for v in given)))
    parts = given.split(":")
    if len(parts) == 1:
        if given.count(",") >= MOST_VARIANTS:
            raise PlanError(f"{where}: there are more than {MOST_VARIANTS}")
        values = tuple(read_number(where, part) for part in given.split(","))
        return Axis(name, tuple(dict.fromkeys(values)))
    if len(parts) > 3:
        raise PlanError(f"{where}: '{given[:80]}' has more than FROM:TO:COUNT")
    low, high = (read_number(where, part) for part in parts[:2])
    if len(parts) == 2:
        if not low < high:
            raise PlanError(f"{where}: the range {low:g}:{high:g} is empty")
        return Axis(name, range=(low, high))
    count = parts[2].strip()
    if not re.fullmatch(r"[0-9]{1,15}", count) or int(count) < 1:
        raise PlanError(
            f"{where}: the third part of '{given[:80]}' is the count of values, a whole "
            "number from 1 on"
        )
    return Axis(name, _spread(name, low, high, int(count)))


def read_axes(vary: Mapping[str, str | Sequence[float]]) -> list[Axis]:
    """Return the axes of several parameters (see `read_axis`); raise PlanError for too many."""
    axes: list[Axis] = []
    values = 0
    for name, given in vary.items():
        axes.append(read_axis(name, given))
        values += len(axes[-1].values)
        check_names(len(axes))
        if values > MOST_VARIANTS + MOST_AXES:
            raise PlanError(f"the axes have {values} values and more; a study has {MOST_VARIANTS}")
    return axes


def _spread(name: str, low: float, high: float, count: int) -> tuple[float, ...]:
    if count > MOST_VARIANTS:
        raise PlanError(f"values of {name}: {count} are more than {MOST_VARIANTS}")
    if (count == 1) != (low == high):
        raise PlanError(
            f"values of {name}: {count} from {low:g} to {high:g}; one value needs equal ends, "
            "several need different ones"
        )
    if count == 1:
        return (low,)
    # exact steps rounded once, so that 0.1:0.9:17 holds 0.5 and not its neighbour: the values are
    # whole numbers over one denominator, and Python rounds such a quotient right
    first, last = Fraction(repr(low)), Fraction(repr(high))
    step = (last - first) / (count - 1)
    below = math.lcm(first.denominator, step.denominator)
    begin, by = int(first * below), int(step * below)
    return tuple((begin + by * i) / below for i in range(count))


def read_number(where: str, text: str) -> float:
    """Return the finite number that a constant expression stands for; raise PlanError."""
    if _DECIMAL.match(text):
        number = float(text) + 0.0  # no negative zero
        if number == 0.0 or 1e-60 < abs(number) < 1e60:
            return number
    try:
        tree = read_expression(text.strip(), {})
        value = evaluate(tree, {}) if isinstance(tree, Expr) else math.nan
    except InputError as error:
        raise PlanError(f"{where}: '{text.strip()[:80]}': {error}") from error
    if not math.isfinite(value):
        raise PlanError(f"{where}: '{text.strip()[:80]}' is no finite number")
    return value


def grid(axes: Sequence[Axis]) -> Plan:
    """Return every combination of the axes' values, the last axis running fastest."""
    for axis in axes:
        if axis.range is not None:
            low, high = axis.range
            raise PlanError(
                f"{axis.name}={low:g}:{high:g} is a range; a grid needs a count, "
                f"{axis.name}={low:g}:{high:g}:5, or a sample with --sample"
            )
    _check_axes(axes)
    check_count(math.prod(len(axis.values) for axis in axes), len(axes))
    return Plan(tuple(axis.name for axis in axes), tuple(product(*(axis.values for axis in axes))))


def sample(axes: Sequence[Axis], method: str, seed: int = 1) -> Plan:
    """Return a sample of the axes' ranges: ``lhs:500`` (Latin hypercube) or ``sobol:512``.

    An axis with values takes each of them about equally often. The same seed gives the same sample
    (scipy.stats.qmc).
    """
    import numpy as np
    from scipy.stats import qmc

    match = _SAMPLE.match(method)
    if match is None:
        raise PlanError(f"the sample '{method[:80]}': write lhs:COUNT or sobol:COUNT")
    kind, count = match[1], int(match[2])
    _check_axes(axes)
    check_count(count, len(axes))
    if seed < 0:
        raise PlanError(f"the seed of a sample is 0 or more, and {seed} was given")
    if kind == "sobol" and count & (count - 1):
        below = 1 << (count.bit_length() - 1)
        raise PlanError(
            f"{method}: a Sobol sequence is balanced for powers of two only; take "
            f"sobol:{below} or sobol:{2 * below}"
        )
    generator = (qmc.LatinHypercube if kind == "lhs" else qmc.Sobol)(len(axes), rng=seed)
    unit = generator.random(count)
    columns = []
    for axis, share in zip(axes, unit.T, strict=True):
        if axis.range is not None:
            low, high = axis.range
            columns.append(low + (high - low) * share)
        else:
            places = np.minimum((share * len(axis.values)).astype(int), len(axis.values) - 1)
            columns.append(np.array(axis.values)[places])
    rows = np.column_stack(columns)
    return Plan(tuple(axis.name for axis in axes), tuple(map(tuple, rows.tolist())))


def _check_axes(axes: Sequence[Axis]) -> None:
    if not axes:
        raise PlanError("a study varies at least one parameter, for example p=0.1:0.9:17")
    names = [axis.name for axis in axes]
    check_names(len(names))
    for name in names:
        if names.count(name) > 1:
            raise PlanError(f"the parameter {name} is varied twice")


def check_names(count: int) -> None:
    """Raise PlanError where too many parameters vary."""
    if count > MOST_AXES:
        raise PlanError(f"{count} parameters vary; at most {MOST_AXES} may")


def check_count(count: int, axes: int) -> None:
    """Raise PlanError for more variants, or values of them, than a study has."""
    if not 1 <= count <= MOST_VARIANTS:
        raise PlanError(f"the study would have {count} variants; it may have 1 to {MOST_VARIANTS}")
    if count * axes > MOST_VALUES:
        raise PlanError(
            f"the study would set {axes} parameters in {count} variants; it may set at most "
            f"{MOST_VALUES} in all"
        )


def check_plan(plan: Plan, template: Template | BodiesTemplate) -> None:
    """Raise PlanError for a parameter that the template does not have."""
    known = [parameter.name for parameter in template.parameters]
    for name in plan.names:
        if name not in known:
            listed = ", ".join(known) or "none"
            raise PlanError(
                f"{template.name} has no parameter '{name[:80]}' (it has: {listed})"
                f"{nearest(name, known)}"
            )
