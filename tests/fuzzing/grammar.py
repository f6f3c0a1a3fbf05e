"""Random expressions and templates: mostly well formed, often wrong in one place."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random

from pc2cad.expression.functions import PUBLIC_FUNCTIONS

#: numbers that have made parsers and computer algebra hang
NUMBERS = (
    "0", "1", "2", "3", "10", "0.5", "1/3", "1e-300", "1e300", "1e60", "1e999", "1e-60", "9", "64",
    "65", "1000", "100000", "0.1", ".5", "5.", "1e", "1e+3", "0x10", "1_000", "7", "-1", "1j",
)  # fmt: skip
NAMES = ("u", "v", "w", "pi", "e", "p", "q", "A", "B", "C", "D", "oo", "nan", "x_1", "uu")
POINT_CALLS = (
    "dot", "cross", "length", "unit", "distance", "det", "metric", "translate", "exit_from_plane",
    "point", "vector", "diff",
)  # fmt: skip
PARAMETERS = ("u", "v", "w")
CONSTANTS = ("pi", "e", "1")
SCALAR_CALLS = tuple(name for name in PUBLIC_FUNCTIONS if name not in ("atan2", "min", "max"))
OPERATORS = ("+", "-", "*", "/", "^", "**", " + ", "*-", "/ ")
ODD = (
    "__import__('os')", "u.real", "lambda u: u", "[u]", "{u}", "'u'", "u;v", "\x00", "ｕ", "𝐬𝐢𝐧(u)",
    "\u202e", "\u200b", "u if v else w", "u<v", "u%v", "u//v", "1,5", "2u", "u v", "#", "\\", '"',
    "eval", "print(1)", "=", ":=", "$", "@", "~u", "!u", "u!", "٣", "\ud800", "\r", "\t", "((",
    "))",
)  # fmt: skip


def expression(random: Random, depth: int = 5) -> str:
    """Return a random expression; about one in three is not well formed."""
    text = _expression(random, random.randint(0, depth))
    match random.randrange(9):
        case 0:
            at = random.randrange(len(text) + 1)
            return text[:at] + random.choice(ODD) + text[at:]
        case 1:
            at = random.randrange(len(text) + 1)
            return text[:at] + text[at + random.randint(1, 3) :]
        case 2:
            return "".join(random.choice((*NAMES, *OPERATORS, "(", ")", ",", *NUMBERS))
                           for _ in range(random.randint(0, 40)))  # fmt: skip
    return text


def _expression(random: Random, depth: int) -> str:
    if depth == 0:
        if random.random() < 0.08:
            return random.choice((*NAMES, *NUMBERS))
        return random.choice(("u", "v", "w", "p", "pi", "A-B", "2", "3", "0.5", "1/3", "10"))
    kind = random.random()
    if kind < 0.5:
        a, b = _expression(random, depth - 1), _expression(random, random.randrange(depth))
        return f"{a}{random.choice(OPERATORS)}{b}"
    if kind < 0.7:
        return f"{random.choice(tuple(PUBLIC_FUNCTIONS))}({_expression(random, depth - 1)})"
    if kind < 0.8:
        name = random.choice((*POINT_CALLS, *PUBLIC_FUNCTIONS))
        operands = (_expression(random, depth - 1) for _ in range(random.randint(0, 4)))
        return f"{name}({', '.join(operands)})"
    if kind < 0.85:
        return f"-{_expression(random, depth - 1)}"
    if kind < 0.9:
        return f"[{', '.join(_expression(random, depth - 1) for _ in range(random.randint(2, 4)))}]"
    return f"({_expression(random, depth - 1)})"


def template(random: Random) -> str:
    """Return a random template; about two in three are wrong in one place or another."""

    def rarely(odd: Sequence[str], usual: str) -> str:
        return random.choice(odd) if random.random() < 0.07 else usual

    parts = ["title = " + rarely(("'a'", '""', "7", r'"a\nb"'), '"T"')]
    if random.random() < 0.3:
        parts.append("units = " + rarely(('"furlong"', "1"), '"m"'))
    parameter = rarely(("u", "pi", "p-1", "é", "__class__", "p" * 70), "p")
    number = rarely((*NUMBERS, "true", "nan", "inf", "[1]", "2026-11-21"), '"1/2"')
    parts.append(f"[parameters]\n{parameter} = {{ default = {number} }}")
    parts.append("[points]")
    for name in "ABCD":
        numbers = (rarely(NUMBERS, str(random.randint(-9, 9))) for _ in range(3))
        parts.append(f"{name} = [{', '.join(numbers)}]")
    if random.random() < 0.3:
        parts.append(f"[domain]\nu = [0, {_quoted(random, CONSTANTS, 1)}]")
    known = (*PARAMETERS, "p")
    if random.random() < 0.5:
        parts.append(f"[let]\nf = {_quoted(random, known, 3)}\ng = {_quoted(random, known, 2)}")
        known = (*known, "f", "g")
    parts.append(_solid(random, known))
    if random.random() < 0.2:
        parts.append(f"[expect]\nvolume = {_quoted(random, ('p', *CONSTANTS), 1)}")
    text = "\n".join(parts) + "\n"
    if random.random() < 0.3:
        at = random.randrange(len(text) + 1)
        text = text[:at] + random.choice((*ODD, "[[", "]", "\n[let]\n", "x=1\n")) + text[at:]
    return text


def _solid(random: Random, known: Sequence[str]) -> str:
    if random.random() < 0.3:
        weights = (_well_formed(random, known, 1) for _ in range(2))
        a, b = weights
        return f'[solid]\nM = "D + (A-D)*({a}) + (B-D)*({b}) + (C-D)*w*u"'
    return "[solid]\n" + "\n".join(f"{axis} = {_quoted(random, known, 3)}" for axis in "xyz")


def _quoted(random: Random, names: Sequence[str], depth: int) -> str:
    text = expression(random, depth) if random.random() < 0.05 else _well_formed(
        random, names, depth
    )  # fmt: skip
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _well_formed(random: Random, names: Sequence[str], depth: int) -> str:
    """Return a scalar of the language (that may still have no value)."""
    if depth == 0:
        return random.choice((*names, *names, "2", "0.5", "3", "1/3"))
    a = _well_formed(random, names, depth - 1)
    kind = random.random()
    if kind < 0.3:
        return f"{random.choice(SCALAR_CALLS)}({a})"
    if kind < 0.4:
        return f"({a})^{random.choice(('2', '3', '-1', '1/2', '0'))}"
    return f"({a}){random.choice('+-*/')}({_well_formed(random, names, random.randrange(depth))})"
