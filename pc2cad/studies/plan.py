"""Which variants a study consists of: a grid, a list, a table of values, or a sample.

A variant is a mapping of parameter names to numbers. Everything is checked against the template
before the first one is built, and counted before it is laid out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

from pc2cad.equation.language import nearest
from pc2cad.errors import InputError
from pc2cad.templates.bodies import BodiesTemplate
from pc2cad.templates.ranges import LONGEST, Axis, read_axis
from pc2cad.templates.template import Template

#: no more variants than one parameter may have values
MOST_VARIANTS: Final = LONGEST
#: parameters that vary, and values of all variants together
MOST_AXES: Final = 256
MOST_VALUES: Final = 5_000_000
_SAMPLE: Final = re.compile(r"(lhs|sobol):([0-9]{1,9})\Z")

Variant = Mapping[str, float]


class PlanError(InputError):
    """The variants of a study are not well described."""


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
