"""Text of the equation language to a syntax tree: lexer and precedence-climbing parser.

Nothing is ever handed to Python's own evaluator. The text is ASCII; its length, its number of
tokens and its depth are limited, so that no input can exhaust time or memory.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Final, NamedTuple

from pc2cad.errors import InputError
from pc2cad.expression.exact import decimal

LONGEST_TEXT: Final = 4000
MOST_TOKENS: Final = 2000
DEEPEST_NESTING: Final = 60
LONGEST_NUMBER: Final = 40
LONGEST_NAME: Final = 64
#: characters of texts whose trees are kept for a while
LONGEST_KEPT: Final = 400
#: what writes who thinks in degrees
RADIANS: Final = "angles are in radians: 30 degrees are 30*pi/180"
#: modules whose functions are meant by their names here
_MODULES: Final = ("math", "cmath", "np", "numpy", "sp", "sympy", "pc")


class ExpressionSyntaxError(InputError):
    """The text is not an expression of the language; `column` counts from 1."""

    def __init__(self, message: str, column: int) -> None:
        super().__init__(f"column {column}: {message}")
        self.column = column


@dataclass(frozen=True, eq=False)
class Node:
    """A syntax node and the column (from 1) where it begins."""

    column: int


@dataclass(frozen=True, eq=False)
class NumberNode(Node):
    """A number, exact."""

    value: Fraction


@dataclass(frozen=True, eq=False)
class NameNode(Node):
    """A name that stands alone."""

    name: str


@dataclass(frozen=True, eq=False)
class NegationNode(Node):
    """Unary minus."""

    operand: Node


@dataclass(frozen=True, eq=False)
class BinaryNode(Node):
    """One of ``+ - * / ^`` with its operands; `column` is the operator's."""

    operator: str
    left: Node
    right: Node


@dataclass(frozen=True, eq=False)
class ConditionNode(Node):
    """One of ``< <= > >= and or not`` with its operands (one for ``not``)."""

    operator: str
    operands: tuple[Node, ...]


@dataclass(frozen=True, eq=False)
class PartNode(Node):
    """A coordinate of a point, ``P.x``."""

    operand: Node
    part: str


@dataclass(frozen=True, eq=False)
class IndexNode(Node):
    """An entry of a list of [data], ``name[i]`` or ``name[i, j]``."""

    name: str
    places: tuple[Node, ...]


@dataclass(frozen=True, eq=False)
class CallNode(Node):
    """A function with its operands."""

    name: str
    operands: tuple[Node, ...]


@dataclass(frozen=True, eq=False)
class TripleNode(Node):
    """A point by its coordinates, ``[x, y, z]``."""

    operands: tuple[Node, ...]


_decimal: Final = lru_cache(maxsize=1024)(decimal)


class _Token(NamedTuple):
    kind: str  # number, name, operator, end
    text: str
    column: int


_SPACE: Final = " \t\r\n"
_TOKEN: Final = re.compile(
    r"[ \t\r\n]*+(?:"
    r"(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z_0-9]*)"
    r"|(?P<operator>\*\*|[<>]=?|[-+*/^(),.\[\]])"
    r"|(?P<end>\Z))"
)


def _tokens(text: str) -> list[_Token]:
    if len(text) > LONGEST_TEXT:
        raise ExpressionSyntaxError(
            f"the expression has {len(text)} characters, more than {LONGEST_TEXT}; "
            "split it into [let] entries", LONGEST_TEXT + 1,
        )  # fmt: skip
    tokens: list[_Token] = []
    position = 0
    while True:
        match = _TOKEN.match(text, position)
        if match is None:
            left = text[position:].lstrip(_SPACE)
            raise ExpressionSyntaxError(_unknown_character(left[0]), len(text) - len(left) + 1)
        kind = str(match.lastgroup)
        piece, column, position = match[kind], match.start(kind) + 1, match.end()
        if kind == "end":
            tokens.append(_Token(kind, "", len(text) + 1))
            return tokens
        if kind == "number":
            _check_number(piece, text[position : position + 1], column)
        if kind == "name" and len(piece) > LONGEST_NAME:
            raise ExpressionSyntaxError(f"a name is longer than {LONGEST_NAME} characters", column)
        kind = "operator" if piece in WORDS else kind
        tokens.append(_Token(kind, "^" if piece == "**" else piece, column))
        if len(tokens) > MOST_TOKENS:
            raise ExpressionSyntaxError(f"the expression has over {MOST_TOKENS} tokens", column)


def _check_number(piece: str, following: str, column: int) -> None:
    if len(piece) > LONGEST_NUMBER:
        raise ExpressionSyntaxError(f"a number is longer than {LONGEST_NUMBER} characters", column)
    if following.lower() == "d":
        raise ExpressionSyntaxError(
            f"'{piece}{following}' is neither a number nor a name; {RADIANS}, "
            f"and '{piece}*{following}…' is a product", column,
        )  # fmt: skip
    if following.isalpha() or following == "_":
        raise ExpressionSyntaxError(
            f"'{piece}{following}' is neither a number nor a name; "
            f"write '{piece}*{following}…' for a product", column,
        )  # fmt: skip
    if "e" in piece.lower() and abs(int(piece.lower().split("e")[1])) > 60:
        raise ExpressionSyntaxError(f"{piece} is outside the range 1e-60 to 1e60", column)


def _unknown_character(character: str) -> str:
    shown = repr(character) if character.isprintable() else f"U+{ord(character):04X}"
    hints = {
        "=": "; an equation's right side alone is written", "'": "; w̄ is written (1 - w)",
        "&": "; conditions are joined by 'and'", "|": "; conditions are joined by 'or'",
        "!": "; a condition is turned round by 'not'", "%": "; a remainder is mod(x, m)",
    }  # fmt: skip
    if character in "°º˚":
        return f"{shown} has no meaning here; {RADIANS}"
    if not character.isascii():
        return f"the character {shown} is not ASCII; write names and operators in plain letters"
    return f"the character {shown} has no meaning here{hints.get(character, '')}"


#: operators that are words
WORDS: Final = ("and", "or", "not")
_COMPARED: Final = 3
_PRECEDENCE: Final = {
    "or": 1, "and": 2, **dict.fromkeys(("<", "<=", ">", ">="), _COMPARED),
    "+": 4, "-": 4, "*": 5, "/": 5, "^": 7,
}  # fmt: skip
_NOT: Final = 2  # binds what is compared, but not what "and" joins
_UNARY: Final = 6  # below ^: -u^2 is -(u^2)


class _Parser:
    def __init__(self, text: str) -> None:
        self._rest = iter(_tokens(text))
        self._next = next(self._rest)
        self._depth = 0

    def _take(self) -> _Token:
        token = self._next
        self._next = next(self._rest, token)  # the end stays
        return token

    def _expect(self, text: str, purpose: str) -> None:
        token = self._take()
        if token.text != text or token.kind == "end":
            raise ExpressionSyntaxError(f"expected '{text}' {purpose}, found {_shown(token)}",
                                        token.column)  # fmt: skip

    def whole(self) -> Node:
        node = self._expression(0)
        if self._next.kind != "end":
            token = self._next
            hint = (
                "; write * for a product"
                if token.kind in ("number", "name") or (token.text in "([")
                else ""
            )
            raise ExpressionSyntaxError(
                f"expected an operator or the end, found {_shown(token)}{hint}", token.column
            )
        return node

    def _expression(self, strength: int) -> Node:
        self._depth += 1
        if self._depth > DEEPEST_NESTING:
            raise ExpressionSyntaxError(
                f"the expression is nested deeper than {DEEPEST_NESTING}", self._next.column
            )
        left = self._operand(strength)
        while self._next.kind == "operator":
            operator = self._next
            precedence = _PRECEDENCE.get(operator.text, 0)
            if precedence <= strength:
                break
            self._take()
            # ^ binds to the right: 2^3^2 is 2^(3^2)
            right = self._expression(precedence - 1 if operator.text == "^" else precedence)
            if precedence > _COMPARED:
                left = BinaryNode(operator.column, operator.text, left, right)
                continue
            if precedence == _COMPARED and _is_comparison(left):
                raise ExpressionSyntaxError(
                    "comparisons are joined by 'and': write a < b and b < c", operator.column
                )
            left = ConditionNode(operator.column, operator.text, (left, right))
        self._depth -= 1
        return left

    def _operand(self, strength: int) -> Node:
        node = self._plain_operand(strength)
        while self._next.text == "." and self._next.kind == "operator":
            point = self._take()
            part = self._take()
            if part.text not in ("x", "y", "z"):
                if isinstance(node, NameNode) and node.name in _MODULES:
                    name = f"{part.text}(…)" if self._next.text == "(" else part.text
                    raise ExpressionSyntaxError(
                        f"names stand alone: write {name} instead of {node.name}.{name}",
                        node.column,
                    )
                raise ExpressionSyntaxError(
                    f"a point has the coordinates .x, .y and .z, not .{part.text}", point.column
                )
            node = PartNode(point.column, node, part.text)
        return node

    def _plain_operand(self, strength: int) -> Node:
        token = self._take()
        if token.kind == "number":
            return NumberNode(token.column, _decimal(token.text))
        if token.kind == "name":
            if self._next.text == "(" and self._next.kind == "operator":
                self._take()
                return CallNode(token.column, token.text, self._list(")", f"to end {token.text}("))
            if self._next.text == "[" and self._next.column == token.column + len(token.text):
                self._take()
                places = self._list("]", f"to end {token.text}[")
                return IndexNode(token.column, token.text, places)
            return NameNode(token.column, token.text)
        if token.text == "not":
            return ConditionNode(token.column, "not", (self._expression(_NOT),))
        if token.text == "-":
            # -a*b is -(a*b), but 2^-a*b is (2^-a)*b
            reach = _PRECEDENCE["+"] if strength < _PRECEDENCE["*"] else _UNARY
            return NegationNode(token.column, self._expression(reach))
        if token.text == "(":
            node = self._expression(0)
            self._expect(")", f"to match the '(' at column {token.column}")
            return node
        if token.text == "[":
            operands = self._list("]", f"to match the '[' at column {token.column}")
            if len(operands) != 3:
                raise ExpressionSyntaxError(
                    f"a point has 3 coordinates [x, y, z], here are {len(operands)}", token.column
                )
            return TripleNode(token.column, operands)
        raise ExpressionSyntaxError(
            f"expected a number, a name or '(', found {_shown(token)}", token.column
        )

    def _list(self, closing: str, purpose: str) -> tuple[Node, ...]:
        operands: list[Node] = []
        if self._next.text == closing:
            self._take()
            return ()
        while True:
            operands.append(self._expression(0))
            if self._next.text == ",":
                self._take()
                continue
            self._expect(closing, purpose)
            return tuple(operands)


def _is_comparison(node: Node) -> bool:
    return isinstance(node, ConditionNode) and node.operator in ("<", "<=", ">", ">=")


def _shown(token: _Token) -> str:
    return "the end" if token.kind == "end" else f"'{token.text}'"


def parse(text: str) -> Node:
    """Return the syntax tree of an expression; raise ExpressionSyntaxError with the column."""
    if not text.strip():
        raise ExpressionSyntaxError("the expression is empty", 1)
    return _kept(text) if len(text) <= LONGEST_KEPT else _Parser(text).whole()


@lru_cache(maxsize=256)
def _kept(text: str) -> Node:
    """Return the syntax tree: a template's texts are read anew for each variant."""
    return _Parser(text).whole()


def operand_texts(text: str, node: CallNode) -> tuple[str, ...]:
    """Return the operands of a call as they are written."""
    depth, begin, found = 0, 0, []
    for token in _tokens(text):
        at = token.column - 1
        if at < node.column - 1 + len(node.name):
            continue
        if token.text in (",", ")") and depth == 1:
            found.append(text[begin:at].strip())
            begin = at + 1
            if token.text == ")":
                break
        if token.text in ("(", "["):
            begin = begin if depth else at + 1
            depth += 1
        elif token.text in (")", "]"):
            depth -= 1
    return tuple(found)
