"""Definitions of a template as LaTeX, with points and operators as they are written."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, reduce
from typing import Final

from pc2cad.equation.language import CONSTANTS, FUNCTION_NAMES
from pc2cad.equation.syntax import (
    BinaryNode,
    CallNode,
    ConditionNode,
    IndexNode,
    NameNode,
    NegationNode,
    Node,
    NumberNode,
    PartNode,
    TripleNode,
    parse,
)
from pc2cad.expression.conditions import Condition, both, compared, either
from pc2cad.expression.functions import PUBLIC_FUNCTIONS, REPEATED
from pc2cad.expression.printing import name_latex
from pc2cad.expression.tree import Expr, call, number, symbol
from pc2cad.templates.coordinatewise import Opaque, Symbols

_OPERATIONS: Final[dict[str, Callable[[Expr, Expr], Expr]]] = {
    "+": lambda a, b: a + b, "-": lambda a, b: a - b, "*": lambda a, b: a * b,
    "/": lambda a, b: a / b, "^": lambda a, b: a**b,
}  # fmt: skip
#: operators of points and vectors that have a sign of their own
_FORMS: Final = {
    "length": r"\left|{}\right|",
    "distance": r"\left|{}\,{}\right|",
    "dot": r"\left({} \cdot {}\right)",
    "cross": r"\left({} \times {}\right)",
    "point": r"\left({},\; {},\; {}\right)",
    "vector": r"\left({},\; {},\; {}\right)",
}


def definition_latex(text: str) -> str:
    """Return the LaTeX of a definition's right side; the text is known to be an expression."""
    return _Typesetter().latex(parse(text))


class _Typesetter:
    def __init__(self) -> None:
        self._symbols = Symbols()

    def latex(self, node: Node) -> str:
        return self._symbols.latex(self._tree(node))

    def _tree(self, node: Node) -> Expr:
        """Return a tree in which a point is a symbol like any other."""
        match node:
            case NumberNode():
                return number(node.value)
            case NameNode():
                return CONSTANTS.get(node.name) or symbol(node.name)
            case NegationNode():
                return -self._tree(node.operand)
            case BinaryNode():
                return self._binary(node)
            case TripleNode():
                return self._special("point", node.operands)
            case PartNode():
                return self._below(self.latex(node.operand), node.part, node.operand)
            case IndexNode():
                places = ",".join(self.latex(place) for place in node.places)
                return self._below(name_latex(node.name), places, None)
            case CallNode():
                if node.name == "if" and len(node.operands) == 3:
                    return self._condition(node.operands[0]).choose(
                        self._tree(node.operands[1]), self._tree(node.operands[2])
                    )
                if node.name in REPEATED and len(node.operands) > 1:
                    return reduce(partial(call, node.name), map(self._tree, node.operands))
                if node.name in PUBLIC_FUNCTIONS:
                    return call(node.name, *(self._tree(x) for x in node.operands))
                return self._special(node.name, node.operands)
        raise AssertionError(node)

    def _below(self, latex: str, part: str, operand: Node | None) -> Expr:
        closed = operand is None or isinstance(operand, NameNode)
        head = latex if closed else rf"\left({latex}\right)"
        return self._symbols.make(f"{latex}[{part}]", Opaque(rf"{{{head}}}_{{{part}}}"))

    def _condition(self, node: Node) -> Condition:
        assert isinstance(node, ConditionNode)
        if node.operator == "not":
            return ~self._condition(node.operands[0])
        left, right = node.operands
        if node.operator in ("and", "or"):
            join = both if node.operator == "and" else either
            return join(self._condition(left), self._condition(right))
        return compared(self._tree(left), node.operator, self._tree(right))

    def _binary(self, node: BinaryNode) -> Expr:
        # a sum of a thousand terms leans to the left: walk down its spine without recursion
        spine = [node]
        while isinstance(spine[-1].left, BinaryNode):
            spine.append(spine[-1].left)
        value = self._tree(spine[-1].left)
        for step in reversed(spine):
            value = _OPERATIONS[step.operator](value, self._tree(step.right))
        return value

    def _special(self, name: str, operands: tuple[Node, ...]) -> Expr:
        parts = [self.latex(operand) for operand in operands]
        closed = [
            part if isinstance(operand, NameNode) else rf"\left({part}\right)"
            for part, operand in zip(parts, operands, strict=True)
        ]
        if name == "diff":
            order = f"^{{{parts[2]}}}" if len(parts) == 3 and parts[2] != "1" else ""
            latex = rf"\frac{{\partial{order}}}{{\partial {parts[1]}{order}}} {closed[0]}"
        elif name == "sum" and len(parts) == 4:
            latex = rf"\sum_{{{parts[0]}={parts[1]}}}^{{{parts[2]}}} {closed[3]}"
        elif name in _FORMS:
            takes = closed if name in ("distance", "dot", "cross") else parts
            latex = _FORMS[name].format(*takes)
        else:
            plain = name.replace("_", r"\_")
            head = rf"\operatorname{{{plain}}}" if name in FUNCTION_NAMES else name_latex(name)
            latex = rf"{head}\left({', '.join(parts)}\right)"
        return self._symbols.make(f"{name}({', '.join(parts)})", Opaque(latex))
