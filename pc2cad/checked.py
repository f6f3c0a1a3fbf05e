"""What is known of a map before anything is represented: the value that all ways out begin with.

    PointEquation  ─sample→     SampledSides    M over the unit box, finite on its sides
                   ─orient→     Orientation     the sign of det J, or a fold
                   ─analyse→    Analysis        which sides collapse, coincide, bound
                   ─integrate→  MassProperties  volume, area, centroid of the equation
                   ─solidity→   Question        no overlap: by samples, or left to the faces
                                ⇒ CheckedMap    ⇒ B-rep, volume splines, meshes, points

Each stage takes the results before it and returns one frozen value. The limits of a channel say
what is near to break it. Where it is proved that nothing does they are worked out when asked for;
where something is sampled they are looked at as well (*limits*), and where a stage refuses the map
they are the closer reason. So are overlaps that samples show, where these were left to a proof.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

from pc2cad.bounds.extremes import Extreme, largest_value, least_value
from pc2cad.channels.depths import check_depth, find_depth
from pc2cad.channels.limits import Limit, check_limits, describe, find_limits, loose_ends
from pc2cad.domain.analysis import Analysis, derive, sample_sides
from pc2cad.domain.cuts import halved as cut_in_halves
from pc2cad.domain.cuts import parted as cut_apart
from pc2cad.domain.family_sides import own_boundary
from pc2cad.domain.map import Mapping3
from pc2cad.equation.degrees import degrees_remark
from pc2cad.equation.point_equation import PointEquation
from pc2cad.errors import NotASolidError, PointCadError, ToleranceNotReachedError
from pc2cad.expression.carried import begin_build
from pc2cad.expression.identity import Verdict
from pc2cad.expression.tree import ValueDomainError
from pc2cad.geometry.scale import Scale
from pc2cad.integrals.mass_properties import MassProperties, integrate
from pc2cad.options import DEFAULTS, CompileOptions
from pc2cad.solidity.orientation import Orientation, find_orientation
from pc2cad.solidity.over_ranges.boxes import ProvedBox
from pc2cad.solidity.solidity import Question, Solidity, ask_solidity

if TYPE_CHECKING:
    from pc2cad.integrals.fields import FieldIntegral
    from pc2cad.integrals.inertia import Mass
    from pc2cad.integrals.sensitivity import Sensitivity

#: told the name of each stage as it begins
Progress = Callable[[str], None]
#: refuses integrals that a receiver cannot hold
Accept = Callable[[MassProperties], None]
Result = TypeVar("Result")

#: of the part's size, and of a slender part's thickness 2V/A
OF_SIZE, OF_THICKNESS = 1e-7, 1e-6


@dataclass(frozen=True, eq=False)
class CheckedMap:
    """A map whose image is one solid, and all that is known of it before it is represented."""

    analysis: Analysis
    orientation: Orientation
    #: how deep layers may be, where that is known
    depths: tuple[Limit, ...]
    mass: MassProperties
    #: whether samples show an overlap
    question: Question

    @property
    def solidity(self) -> Solidity:
        """What samples show of overlaps; raises NotASolidError for one when it is first asked."""
        return self.question.answer

    @cached_property
    def limits(self) -> tuple[Limit, ...]:
        """Of a channel: how far it is from breaking, by search when it is first asked for."""
        return (*find_limits(self.equation), *self.depths)

    @property
    def equation(self) -> PointEquation:
        """The point equation."""
        return self.analysis.equation

    @property
    def map(self) -> Mapping3:
        """M and its derivatives on arrays, over the unit box."""
        return self.analysis.map

    @property
    def scale(self) -> Scale:
        """Size and place of the solid."""
        return self.analysis.scale

    def mass_properties(self, density: float | str | Mapping[str, float] | None = None) -> Mass:
        """Return mass, centre of mass and inertia for a density, or one for each layer by name.

        A text names the field that is the density; without any it is the field ``density``, or 1.
        The mass is in the density's own unit times units^3. Raises InputError for a density that is
        not positive, and for names of no layer or field.
        """
        from pc2cad.integrals.weighing import weighed

        return weighed(self.analysis, self.mass, density)

    def field_figures(self, name: str) -> FieldFigures:
        """Return integral, mean, least and largest value of a field; raise InputError."""
        from pc2cad.domain.fields import local_field
        from pc2cad.integrals.fields import integrate_field

        field = local_field(self.analysis, name)
        whole = integrate_field(self.analysis, self.mass, field)
        limits = [
            sorted({0.0, *row, 1.0, *bounds})
            for row, bounds in zip(field.breaks, self.analysis.bounds, strict=True)
        ]
        least = [least_value(tree, limits) for tree in field.trees]
        largest = [largest_value(tree, limits) for tree in field.trees]
        return FieldFigures(name, field.field.kind, whole, tuple(least), tuple(largest))

    def sensitivity(
        self, name: str, density: float | str | Mapping[str, float] | None = None
    ) -> Sensitivity:
        """Return d/dp of volume, area, centroid, mass and inertia for one parameter.

        The density is that of `mass_properties`. Raises InputError for a name of no parameter, and
        NotDifferentiableError where the solid does not change smoothly with it.
        """
        from pc2cad.integrals.weighing import derived

        variation = self.equation.variation(name)
        return derived(self.analysis, self.orientation.sign, self.mass, density, variation)


@dataclass(frozen=True)
class FieldFigures:
    """What is known of a field over the whole solid, component by component."""

    name: str
    kind: str
    whole: FieldIntegral
    #: seen at places, and bounded by a proof where its `bound` is finite
    least: tuple[Extreme, ...]
    largest: tuple[Extreme, ...]

    @property
    def evidence(self) -> str:
        """Whether least and largest values are bounded by a proof, or sampled."""
        bounds = [extreme.bound for extreme in (*self.least, *self.largest)]
        return "bounded" if all(math.isfinite(bound) for bound in bounds) else "sampled"

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON; a bound that is not proved is None."""
        return {
            "kind": self.kind, "integral": list(self.whole.integral), "mean": list(self.whole.mean),
            "error": self.whole.error, "source": self.whole.source, "evidence": self.evidence,
            "least": [_extreme(e) for e in self.least],
            "largest": [_extreme(e) for e in self.largest],
        }  # fmt: skip


def _extreme(extreme: Extreme) -> dict[str, float | None]:
    bound = extreme.bound if math.isfinite(extreme.bound) else None
    return {"seen": extreme.seen, "bound": bound}


class Stages:
    """Runs stages in turn, tells their names as they begin and notes their seconds.

    A check that another stage may make needless is `put_off`. It is made when it is asked for, and
    first of all where a later stage raises: what it raises is the closer reason.
    """

    def __init__(self, progress: Progress | None = None) -> None:
        self._progress = progress
        self.times: dict[str, float] = {}
        #: what is put behind the message where the map is refused or has no value, worked out then;
        #: a remark that knows a closer reason raises it
        self.remarks: list[Callable[[], str]] = []
        self._waiting: dict[str, Callable[[], object]] = {}
        self._remarked: Exception | None = None

    def put_off(self, name: str, run: Callable[[], object]) -> None:
        """Make a stage later, if it has to be made."""
        self._waiting[name] = run

    def make_up(self) -> None:
        """Run what was put off."""
        while self._waiting:
            self(*self._waiting.popitem())

    def __call__(self, name: str, run: Callable[[], Result]) -> Result:
        """Return the result of a stage."""
        if self._progress is not None:
            self._progress(name)
        start = time.perf_counter()
        try:
            result = run()
        except (PointCadError, ValueDomainError) as error:
            self.make_up()
            if isinstance(error, NotASolidError | ValueDomainError):
                self._remark(error)
            raise
        self.times[name] = self.times.get(name, 0.0) + time.perf_counter() - start
        return result

    def _remark(self, error: Exception) -> None:
        """Put the remarks behind the message of an error, once."""
        if error is not self._remarked:
            said = "; ".join(filter(None, (remark() for remark in self.remarks)))
            if said:
                error.args = (f"{error} ({said})",)
            self._remarked = error


def check_map(
    equation: PointEquation,
    options: CompileOptions = DEFAULTS,
    stages: Stages | None = None,
    accept: Accept | None = None,
    faces: bool = False,
    known: ProvedBox | None = None,
) -> CheckedMap:
    """Return what is known of a point equation whose image is a solid; raise NotASolidError.

    What cannot be had is refused before the dear stages: a tolerance that double precision does not
    hold (ToleranceNotReachedError), and integrals that `accept`, the receiver's word, refuses.
    Where `faces` are made of the map, it is they that are proved to meet nowhere (`embed`).
    What is `known` for a box of parameters, in which those of the equation lie, is not asked again.
    """
    begin_build()
    run = stages or Stages()
    run.remarks += (lambda: _limits_remark(equation), lambda: degrees_remark(equation))
    depths = run("depth", lambda: find_depth(equation)) if equation.depth is not None else ()
    check_depth(depths)
    sides = run("sample", lambda: sample_sides(equation))
    sign, boundary = (known.sign, known.boundary) if known else (0, None)
    orientation = run("orient", lambda: find_orientation(sides.map, sign))
    analysis = run("analyse", lambda: derive(sides, own_boundary(sides, boundary)))
    _tolerance(analysis.scale, options.tolerance)
    mass = run("integrate", lambda: integrate(analysis, orientation.is_proved))
    if accept is not None:
        accept(mass)
    question = run("solidity", lambda: ask_solidity(analysis, orientation, faces))
    checked = CheckedMap(analysis, orientation, depths, mass, question)
    if not (faces and orientation.verdict is Verdict.PROVED):
        run("limits", lambda: check_limits(checked.limits))
    return checked


def _limits_remark(equation: PointEquation) -> str:
    """Return the limits of a channel; raise ChannelLimitError where they are why it is no solid."""
    limits = find_limits(equation)
    check_limits(limits)
    ends = loose_ends(equation)
    return ends or (f"limits of the channel: {describe(limits)}" if limits else "")


def halved(checked: CheckedMap) -> CheckedMap:
    """Return the same map with each direction in which the solid closes cut in the middle.

    None of its faces comes round to itself. Where nothing closes, the map itself.
    """
    analysis = cut_in_halves(checked.analysis)
    if analysis is checked.analysis:
        return checked
    return replace(
        checked, analysis=analysis, mass=integrate(analysis, checked.orientation.is_proved)
    )


def parted(checked: CheckedMap, direction: int) -> CheckedMap:
    """Return the same map with each piece of a direction cut in the middle, plane faces as well."""
    analysis = cut_apart(checked.analysis, direction)
    return replace(
        checked, analysis=analysis, mass=integrate(analysis, checked.orientation.is_proved)
    )


def resolve_tolerance(checked: CheckedMap, options: CompileOptions = DEFAULTS) -> float:
    """Return the tolerance of all that is represented, in model units.

    The default is 1e-7 of the part's size, and of a slender part (whose thickness 2V/A is less
    than a tenth of that) 1e-6 of the thickness: its volume is then right to 1e-6. Raises
    ToleranceNotReachedError where double precision cannot hold it.
    """
    return _tolerance(checked.scale, options.tolerance, checked.mass.thickness)


def _tolerance(scale: Scale, tolerance: float | None, thickness: float = float("inf")) -> float:
    least = scale.least_tolerance
    if tolerance is None:
        usual = OF_SIZE * scale.size
        tolerance = max(min(usual, least), min(usual, OF_THICKNESS * thickness))
    if tolerance < least:
        raise ToleranceNotReachedError(
            f"a tolerance of {tolerance:.3g} is below what double precision holds for this part "
            f"({least:.3g}); move it nearer to the origin or allow more"
        )
    return tolerance
