"""Arithmetic where arithmetic is a Boolean: M1 + M2 - K instead of two bodies.

    equation.sums   the boundary of the sum is the sum of both boundaries, by algebra
    here            det J of both and of the sum, and that both cover no place twice, as proved for
                    each of them by itself; then the sum is a difference (or a union)

`reduced` puts one equation in the place of each difference of two bodies where all of that is
proved; what is left is cut by the kernel, with the condition that fails.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from pc2cad.equation.point_equation import Expectations, PointEquation, Written
from pc2cad.equation.sums import Sum, as_written, sums
from pc2cad.errors import KernelError, NotASolidError, ToleranceNotReachedError
from pc2cad.part import Body
from pc2cad.report import StepReport
from pc2cad.templates.bodies import Bodies, Operation, Pattern, Tree

#: compiles an equation by itself
Compile = Callable[[PointEquation], Body]
#: what a map that is no solid, or one that cannot be built, raises
_REFUSED = (NotASolidError, ToleranceNotReachedError, KernelError)


@dataclass(frozen=True)
class Finding:
    """What is known of a sum: that it is a Boolean, or which condition fails."""

    #: difference, union, or nothing where it is not proved to be either
    kind: str
    sentence: str


@dataclass(frozen=True)
class Reduced:
    """Bodies, some of which are differences of others in one equation."""

    result: Tree
    parts: Mapping[str, Body]
    #: the differences that are one equation
    steps: tuple[StepReport, ...] = ()
    #: why others are cut by the kernel, by what is cut
    reasons: Mapping[str, str] = field(default_factory=dict)


def reduced(bodies: Bodies, parts: Mapping[str, Body], compile_body: Compile) -> Reduced:
    """Return the bodies with one equation for each difference that is proved to be one."""
    reducing = _Reducing(bodies, parts, compile_body)
    result = reducing.tree(bodies.result)
    left = dict.fromkeys(_leaves(result))
    return Reduced(
        result, {name: reducing.parts[name] for name in left}, tuple(reducing.steps),
        reducing.reasons,
    )  # fmt: skip


def written_findings(body: Body, compile_body: Compile) -> Iterator[Finding]:
    """Give what is known of the sums that a body's equation is written as.

    Of several that the same text may stand for it is the first that is proved, else one sentence on
    all.
    """
    forms = body.equation.written()
    texts = dict.fromkeys(form.text for form in forms)
    for text in texts:
        alike = [form for form in forms if form.text == text]
        found = []
        for form in alike:
            found.append(_of_written(form, body, compile_body))
            if found[-1].kind:
                break
        if found[-1].kind or len(alike) == 1:
            yield found[-1]
        else:
            apexes = ", ".join(form.core_name for form in alike)
            yield Finding("", f"{text} is not shown to be a cone less another for an apex among "
                              f"{apexes}; {found[0].sentence}")  # fmt: skip


def _of_written(form: Written, whole: Body, compile_body: Compile) -> Finding:
    found = as_written(whole.equation, form)
    if found.unmet:
        return Finding("", f"{form.text}: {found.unmet}")
    both = []
    for name, trees in zip(form.names, (form.first, form.second), strict=True):
        equation = replace(
            whole.equation, coordinates=trees, name=name, written=tuple, fields=(), mover=None,
            freer=None, expectations=Expectations(),
        )  # fmt: skip
        try:
            both.append(compile_body(equation))
        except _REFUSED as error:
            return Finding("", f"{form.text}: {name} is no solid: {error}")
    return _finding(found, form.text, form.names, (both[0], both[1], whole))


def _finding(
    found: Sum, text: str, names: tuple[str, str], bodies: tuple[Body, Body, Body]
) -> Finding:
    """Return what two bodies and their sum are, or which condition fails."""
    first, second = names
    for name, body in zip((*names, "the sum"), bodies, strict=True):
        if body.report.determinant != "proved":
            return Finding("", f"{text}: det J of {name} keeps its sign as far as sampled only")
    signs = [body.checked.orientation.sign for body in bodies]
    together = signs[0] == signs[1] * found.turned
    # where the signs differ, the sum winds once or not at all, as its det J keeps its own
    for name, body in zip((*names, "the sum"), bodies[: 2 + together], strict=False):
        if body.report.injectivity != "proved":
            return Finding(
                "", f"{text}: that {name} covers no place twice is sampled only: "
                    f"{body.report.one.overlap_open}"
            )  # fmt: skip
    if signs[2] != signs[0]:
        return Finding("", f"{text}: {first} does not hold {second}: the sum is the rest of that")
    near = max(body.report.overlap_depth for body in bodies)
    within = f", but within {near:.2g} {bodies[2].report.units} of the boundary" if near else ""
    what = (
        f"{first} and {second} together, which share no place inside" if together
        else f"{first} less {second}"
    )  # fmt: skip
    volumes = [body.report.integrals.volume for body in bodies]
    added = f"{volumes[0]:.10g} {'+-'[not together]} {volumes[1]:.10g} = {volumes[2]:.10g}"
    return Finding(
        "union" if together else "difference",
        f"{text} is {what}: proved{within} ({'; '.join(_grounds(found))}); {added}",
    )


def _grounds(found: Sum) -> tuple[str, ...]:
    return f"the core is {found.core[0]} of the one, {found.core[1]} of the other", *found.sides


class _Reducing:
    """Puts one equation in the place of differences of bodies, from the inside out."""

    def __init__(self, bodies: Bodies, parts: Mapping[str, Body], compile_body: Compile) -> None:
        self.parts = dict(parts)
        self.steps: list[StepReport] = []
        self.reasons: dict[str, str] = {}
        self._bodies, self._compile = bodies, compile_body

    def tree(self, tree: Tree) -> Tree:
        """Return a tree without differences: one body, or a cut."""
        if isinstance(tree, str):
            return tree
        if isinstance(tree, Pattern):
            return replace(tree, operand=self.tree(tree.operand))
        first, *others = (self.tree(operand) for operand in tree.operands)
        if tree.kind != "difference":
            return Operation(tree.kind, (first, *others))
        for other in others:
            first = self._difference(first, other)
        return first

    def _difference(self, first: Tree, second: Tree) -> Tree:
        cut = Operation("cut", (first, second))
        if not (isinstance(first, str) and isinstance(second, str)):
            self.reasons[str(cut)] = "no sum of two equations: one of the two is a Boolean itself"
            return cut
        name = f"difference({first}, {second})"
        finding, body = self._sum(name, (first, second))
        if body is None:
            self.reasons[str(cut)] = finding.sentence
            return cut
        a, b, c = (x.report.integrals.volume for x in (self.parts[first], self.parts[second], body))
        self.parts[name] = body
        self.steps.append(StepReport(name, "difference", a, b, b, c, a - b - c, finding.sentence))
        return name

    def _sum(self, name: str, names: tuple[str, str]) -> tuple[Finding, Body | None]:
        """Return what is known of the sums of two bodies, and that which is their difference."""
        first, second = (self.parts[name] for name in names)
        text, finding = f"{names[0]} + {names[1]} - their core", None
        for found in sums(first.equation, second.equation):
            signs = [body.checked.orientation.sign for body in (first, second)]
            if not found.unmet and signs[0] == signs[1] * found.turned:
                continue  # with these parameters it is both together
            if found.unmet:
                finding = finding or Finding("", f"{text}: {found.unmet}")
                continue
            try:
                body = self._compile(self._named(found.equation, name))
            except _REFUSED as error:
                finding = finding or Finding("", f"{text} is no solid: {error}")
                continue
            told = _finding(found, text, names, (first, second, body))
            if told.kind == "difference":
                return told, body
            finding = finding or told
        nothing = "no side of the one is the opposite side of the other, point by point"
        return finding or Finding("", f"{text}: {nothing}"), None

    def _named(self, equation: PointEquation, name: str) -> PointEquation:
        """Return the equation under its name, or that of all where it is the whole result."""
        if name != str(self._bodies.result):
            return replace(equation, name=name)
        whole = self._bodies
        return replace(
            equation, name=whole.name, title=whole.title, about=whole.about,
            parameters=whole.parameters,
        )  # fmt: skip


def _leaves(tree: Tree) -> Iterator[str]:
    if isinstance(tree, str):
        yield tree
        return
    inner: Sequence[Tree] = (tree.operand,) if isinstance(tree, Pattern) else tree.operands
    for operand in inner:
        yield from _leaves(operand)
