"""Coordinate-wise calculation: the point equations of a template written out, a row per axis.

A point equation gives the same scalar formula three times, once in the x, y and z of its points
(paper, eq. (1)). Every definition is read again with the names before it left standing as symbols
x_A, y_A, z_A …, so that each row is as long as its equation and no longer.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from pc2cad.equation.language import PARAMETER_NAMES, Named, read_expression
from pc2cad.equation.points import Combination, Kind, Value, kind_of
from pc2cad.errors import InputError
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.printing import as_latex, as_text, name_latex
from pc2cad.expression.tree import ONE, ZERO, Expr, div, mul, rebuild, substitute, symbol, walk
from pc2cad.templates.header import Definition
from pc2cad.templates.template import Template

AXES: Final = ("x", "y", "z")


@dataclass(frozen=True)
class Row:
    """One scalar equation, ``name = text``, also as LaTeX."""

    name: str
    text: str
    name_latex: str
    latex: str


@dataclass(frozen=True)
class Expansion:
    """A definition of the template and its rows: three for a point or vector, one for a scalar."""

    name: str
    rows: tuple[Row, ...]


def coordinate_system(template: Template) -> tuple[Expansion, ...]:
    """Return the coordinate-wise system: every [let] in its order, and M at the end."""
    return _System(template).expansions()


@dataclass(frozen=True)
class Opaque:
    """A symbol that stands for something: its LaTeX, and its derivative in u, v or w."""

    latex: str
    derivative: Callable[[str], Expr] = lambda _: ZERO


class Symbols:
    """The symbols that were made, by the text that they print as."""

    def __init__(self) -> None:
        self._made: dict[str, Opaque] = {}

    def make(self, text: str, opaque: Opaque) -> Expr:
        """Return the symbol that prints as `text`."""
        self._made.setdefault(text, opaque)
        return symbol(text)

    def total(self, root: Expr, parameter: str) -> Expr:
        """Return the derivative of a tree in which symbols depend on the parameter themselves."""
        (result,) = derivatives((root,), parameter)
        for name in sorted(root.symbols & self._made.keys()):
            inner = self._made[name].derivative(parameter)
            if inner is not ZERO:
                result = result + inner * derivatives((root,), name)[0]
        return result

    def latex(self, root: Expr) -> str:
        """Return a tree as LaTeX, with the forms of the symbols that were made here."""
        # printed first with a word for each symbol, because the printer typesets plain names
        made = sorted(root.symbols & self._made.keys())
        words = {name: f"?{_letters(i)}" for i, name in enumerate(made)}
        forms = {word: self._made[name].latex for name, word in words.items()}
        text = as_latex(substitute((root,), {n: symbol(w) for n, w in words.items()})[0])

        def form(match: re.Match[str]) -> str:
            found = forms[match[1]]
            return rf"\left({found}\right)^" if match[2] else found

        return re.sub(r"\\mathrm\{(\?[a-z]+)\}(\^)?", form, text)


def _letters(index: int) -> str:
    return "".join(chr(ord("a") + int(digit)) for digit in str(index))


class _System:
    def __init__(self, template: Template) -> None:
        self._template = template
        self._symbols = Symbols()
        #: names that symbols of coordinates must not be taken for
        self._taken = {p.name for p in template.parameters} | {d.name for d in template.lets}
        self._names: dict[str, Named] = dict(template.data)
        self._names |= {p.name: symbol(p.name) for p in template.parameters}
        self._names |= {p: symbol(p) for p in PARAMETER_NAMES}
        functions = [*template.curves, *(["depth"] if template.layers else [])]
        self._curves = {name: self._function(name) for name in functions}
        #: scalars of [let] as trees, to be seen through where weights must be added up
        self._scalars: dict[str, Expr] = {}
        for definition in (*template.points, *template.carried):
            self._stand_for(definition)

    def expansions(self) -> tuple[Expansion, ...]:
        result = []
        for definition in self._template.lets:
            value = self._read(definition)
            result.append(self._expansion(definition.name, value))
            if isinstance(value, Expr):
                self._scalars[definition.name] = self._see_through(value)
            self._stand_for(definition)
        return (*result, self._solid())

    def _solid(self) -> Expansion:
        solid = self._template.solid
        if len(solid) == 1:
            return self._expansion("M", self._read(solid[0]))
        rows = [self._row(f"{d.name}_M", self._scalar(d)) for d in solid]
        return Expansion("M", tuple(rows))

    def _scalar(self, definition: Definition) -> Expr:
        value = self._read(definition)
        if isinstance(value, Expr):
            return value
        raise InputError(f"[solid] {definition.name} is not a scalar")

    def _expansion(self, name: str, value: Value) -> Expansion:
        if isinstance(value, Expr):
            return Expansion(name, (self._row(name, value),))
        names = self._coordinate_names(name)
        rows = [
            self._row(row, _as_written(tree, axis))
            for row, axis, tree in zip(names, AXES, value.coordinates, strict=True)
        ]
        return Expansion(name, tuple(rows))

    def _row(self, name: str, tree: Expr) -> Row:
        return Row(name, as_text(tree), name_latex(name.rstrip("_")), self._symbols.latex(tree))

    def _coordinate_names(self, name: str) -> list[str]:
        names = [f"{axis}_{name}" for axis in AXES]
        while not self._taken.isdisjoint(names):
            names = [f"{n}_" for n in names]
        return names

    def _stand_for(self, definition: Definition) -> None:
        """Let the definition's name stand for symbols in what is read from here on."""
        value = definition.value
        if isinstance(value, Expr):
            self._names[definition.name] = self._symbol(definition.name, value.symbols)
            return
        depends = frozenset[str]().union(*(c.symbols for c in value.coordinates))
        x, y, z = (self._symbol(n, depends) for n in self._coordinate_names(definition.name))
        weight = ONE if kind_of(value) is Kind.POINT else ZERO
        self._names[definition.name] = Combination(x, y, z, weight)

    def _symbol(self, name: str, depends: frozenset[str], along: tuple[str, ...] = ()) -> Expr:
        """Return the symbol of a name, or of its partial derivative along parameters."""
        text, latex = name, name_latex(name.rstrip("_"))
        if along:
            for parameter in sorted(set(along)):
                order = along.count(parameter)
                text = f"diff({text}, {parameter}{f', {order}' if order > 1 else ''})"
            order_latex = f"^{{{len(along)}}}" if len(along) > 1 else ""
            below = r"\,".join(rf"\partial {p}" for p in sorted(along))
            latex = rf"\frac{{\partial{order_latex} {latex}}}{{{below}}}"

        def derivative(parameter: str) -> Expr:
            return (
                self._symbol(name, depends, (*along, parameter)) if parameter in depends else ZERO
            )

        return self._symbols.make(text, Opaque(latex, derivative))

    def _function(self, name: str) -> Callable[..., Value]:
        """Return a function of the template; one with points for values has symbols for each."""
        if not getattr(self._template.curves.get(name), "is_point", False):
            return self._curve(name)
        x, y, z = (self._curve(name, axis=axis) for axis in AXES)

        def at(*operands: Expr) -> Combination:
            return Combination(x(*operands), y(*operands), z(*operands), ONE)

        at.arity = getattr(x, "arity", 1)  # type: ignore[attr-defined]
        return at

    def _curve(self, name: str, along: tuple[int, ...] = (), axis: str = "") -> Callable[..., Expr]:
        """Return a function of the template, or its partial derivative along some operands.

        Of one with points for values, the coordinate along an axis.
        """
        arity = getattr(self._template.curves.get(name), "arity", 1)
        own = f"{axis}_{name}" if axis else name
        primes = "'" * len(along) if arity == 1 else ""
        places = "" if arity == 1 or not along else ",".join(str(i + 1) for i in along)

        def at(*operands: Expr) -> Expr:
            listed = ", ".join(self._symbols.latex(x) for x in operands)
            partial = rf"\partial_{{{places}}} " if places else ""
            latex = rf"{partial}{name_latex(own)}{primes}\left({listed}\right)"

            def derivative(parameter: str) -> Expr:
                total = ZERO
                for i, operand in enumerate(operands):
                    inner = self._symbols.total(operand, parameter)
                    if inner is not ZERO:
                        order = tuple(sorted((*along, i)))
                        total = total + inner * self._curve(name, order, axis)(*operands)
                return total

            label = f"d[{places}] {own}" if places else f"{own}{primes}"
            text = f"{label}({', '.join(as_text(x) for x in operands)})"
            return self._symbols.make(text, Opaque(latex, derivative))

        at.arity = arity  # type: ignore[attr-defined]
        return at

    def _read(self, definition: Definition) -> Value:
        try:
            return self._read_with(definition.text, self._names)
        except InputError:
            # a scalar's symbol hides that, say, the weights a and b = 1 - a sum to 1
            value = self._read_with(definition.text, self._names | self._scalars)
        folded = {tree: symbol(name) for name, tree in self._scalars.items() if tree.args}
        if isinstance(value, Expr):
            return _fold((value,), folded)[0]
        return value.map(lambda roots: _fold(roots, folded))

    def _see_through(self, tree: Expr) -> Expr:
        return substitute((tree,), self._scalars)[0]

    def _read_with(self, text: str, names: Mapping[str, Named]) -> Value:
        """Read an expression; its derivatives reach through the symbols."""
        known = dict(names)
        while (found := list(re.finditer(r"\bdiff\s*\(", text))) != []:
            # the last one has none inside
            start, opening = found[-1].start(), found[-1].end()
            end, (operand, parameter, *rest) = _operands(text, opening)
            value = read_expression(operand, known, self._curves)
            for _ in range(int(float(rest[0])) if rest else 1):
                value = self._derivative(value, parameter.strip())
            name = f"_{len(known)}"  # the names of templates begin with a letter
            known[name] = value
            text = f"{text[:start]} {name} {text[end:]}"
        return read_expression(text, known, self._curves)

    def _derivative(self, value: Value, parameter: str) -> Value:
        if isinstance(value, Expr):
            return self._symbols.total(value, parameter)
        return value.map(lambda roots: tuple(self._symbols.total(r, parameter) for r in roots))


def _operands(text: str, opening: int) -> tuple[int, list[str]]:
    """Return where the call ends whose operands begin at `opening`, and the operands."""
    depth, begin, found = 0, opening, []
    for position in range(opening, len(text)):
        character = text[position]
        if character in ",)" and depth == 0:
            found.append(text[begin:position])
            begin = position + 1
            if character == ")":
                return position + 1, found
        depth += (character in "([") - (character in ")]")
    raise InputError("a derivative has no closing bracket")


def _fold(roots: tuple[Expr, ...], names: Mapping[Expr, Expr]) -> tuple[Expr, ...]:
    """Return the trees with every occurrence of a named sub-tree replaced by its name."""
    done: dict[Expr, Expr] = {}
    for node in walk(roots):
        if node in names:
            done[node] = names[node]
        elif node.args:
            done[node] = rebuild(node, tuple(done[arg] for arg in node.args))
        else:
            done[node] = node
    return tuple(done[root] for root in roots)


def _as_written(node: Expr, axis: str) -> Expr:
    """Return one coordinate of a combination with its factors in the order of the equation.

    A combination multiplies its coordinates from the left, (1 - w)*(v*(u*x_A)); an equation is
    written with its points in front, x_A*u*v*(1 - w).
    """
    terms = _terms(node)
    if len(terms) > 1:
        result = _as_written(terms[0], axis)
        for term in terms[1:]:
            result = result + _as_written(term, axis)
        return result
    if node.op == "neg":
        return -_as_written(node.args[0], axis)
    factors = []
    while node.op == "mul" and _is_coordinate(node.args[1], axis):
        factors.append(node.args[0])
        node = node.args[1]
    if not factors:
        return node
    result = _as_written(node, axis)
    for factor in reversed(factors):
        result = _times(result, factor)
    return result


def _terms(node: Expr) -> list[Expr]:
    """Return the terms of a sum, sums within it taken apart."""
    terms, stack = [], [node]
    while stack:
        node = stack.pop()
        if node.op == "add":
            stack += reversed(node.args)
        else:
            terms.append(node)
    return terms


def _is_coordinate(node: Expr, axis: str) -> bool:
    """Say whether the tree has symbols of this axis, x_A or diff(x_N, u)."""
    return any(re.match(rf"(diff\()*{axis}_", name) for name in node.symbols)


def _times(coordinate: Expr, factor: Expr) -> Expr:
    factors = []
    while factor.op == "mul":
        factors.append(factor.args[1])
        factor = factor.args[0]
    for f in (factor, *reversed(factors)):
        if f.op == "div":
            coordinate = div(
                coordinate if f.args[0] is ONE else mul(coordinate, f.args[0]), f.args[1]
            )
        else:
            coordinate = mul(f, coordinate) if f.op == "number" else mul(coordinate, f)
    return coordinate
