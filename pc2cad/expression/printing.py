"""Printed forms of expression trees: plain text in the template's own syntax, and LaTeX.

Trees share sub-trees, so a printed form can be exponentially longer than the tree; it is cut where
it passes a limit, with an ellipsis.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Final

from pc2cad.expression.recent import Recent
from pc2cad.expression.tree import Expr, number, piece_rows, walk

_SUM, _PRODUCT, _UNARY, _POWER, _ATOM = range(1, 6)
#: a printed piece and how strongly it binds
_Part = tuple[str, int]


#: at most about so many characters
LONGEST_TEXT: Final = 4000
LONGEST_LATEX: Final = 8000
_texts: Final[Recent[_Part]] = Recent()


def as_text(root: Expr) -> str:
    """Return the tree in the language of the templates, at most about `LONGEST_TEXT` characters."""
    parts: dict[Expr, _Part] = {}

    def below(node: Expr) -> tuple[Expr, ...]:
        known = _texts.get(node)
        if known is None:
            return node.args
        parts[node] = known
        return node.args if node.op == "neg" else ()  # a difference prints what is under the sign

    for node in walk((root,), below):
        if node not in parts:
            parts[node] = _cut(_text(node, parts), LONGEST_TEXT)
            if node.args:
                _texts.keep(node, parts[node])
    return parts[root][0]


def as_latex(root: Expr) -> str:
    """Return the tree as LaTeX mathematics (without dollar signs), cut as text is."""
    parts: dict[Expr, _Part] = {}
    for node in walk((root,)):
        parts[node] = _cut(_latex(node, parts), LONGEST_LATEX)
    return parts[root][0]


def _cut(part: _Part, limit: int) -> _Part:
    text, _ = part
    return part if len(text) <= limit else (text[:limit] + "…", _ATOM)


def _wrap(part: _Part, needed: int, opening: str = "(", closing: str = ")") -> str:
    text, strength = part
    return text if strength >= needed else f"{opening}{text}{closing}"


def _number_text(value: Fraction) -> _Part:
    if value.denominator == 1:
        text = str(value.numerator)
    elif _terminates(value.denominator) and len(repr(float(value))) < 12:
        text = repr(float(value))
    else:
        return f"{value.numerator}/{value.denominator}", _PRODUCT if value > 0 else _SUM
    return text, _ATOM if value >= 0 else _SUM


def _terminates(denominator: int) -> bool:
    for prime in (2, 5):
        while denominator % prime == 0:
            denominator //= prime
    return denominator == 1


def _subtrahend(
    node: Expr, parts: dict[Expr, _Part], form: Callable[[Expr, dict[Expr, _Part]], _Part]
) -> _Part | None:
    """Return x when the node is printed as "- x" behind another term, else None."""
    if node.op == "neg":
        return parts[node.args[0]]
    if node.op == "number" and node.payload < 0:
        return form(number(-node.payload), parts)
    return None


def _sides(
    condition: Expr, parts: dict[Expr, _Part], form: Callable[[Expr, dict[Expr, _Part]], _Part]
) -> tuple[_Part, _Part]:
    """Return what is compared where a tree is not negative: a difference is taken apart."""
    if condition.op == "add":
        first, second = condition.args
        for inner in (first, second, *second.args):  # a known text is not asked for those below it
            if inner not in parts:
                parts[inner] = (as_text(inner), _ATOM)
        taken = _subtrahend(second, parts, form)
        if taken is not None:
            return parts[first], taken
    return parts[condition], ("0", _ATOM)


def _pieces_text(node: Expr, parts: dict[Expr, _Part]) -> str:
    """Return a table as name(a, b), its own arguments in order; else that there are pieces."""
    if node.args[0].op != "within":
        return f"<piecewise polynomial of {parts[node.args[0]][0]}>"
    return f"{node.args[0].payload.name}({', '.join(map(as_text, table_arguments(node)))})"


def table_arguments(node: Expr) -> list[Expr]:
    """Return what the pieces of a table are taken at, outermost first."""
    found: list[Expr] = []
    inner: Expr | None = node
    while inner is not None and inner.args[0].op == "within":
        found.append(inner.args[0].args[0])
        below = (c for c in inner.args[1:] if c.op == "pieces")
        inner = next(below, None)
    return found


def _text(node: Expr, parts: dict[Expr, _Part]) -> _Part:
    op = node.op
    if op == "number":
        return _number_text(node.payload)
    if op in ("symbol", "constant"):
        return node.payload, _ATOM
    if op == "within":
        return f"{node.payload.name}({parts[node.args[0]][0]})", _ATOM
    if op == "pieces":
        return _pieces_text(node, parts), _ATOM
    if op == "fourier":
        angles = ", ".join(parts[arg][0] for arg in node.args)
        return f"<series of {len(node.payload.rows)} waves of {angles}>", _ATOM
    p = [parts[arg] for arg in node.args]
    if op == "add":
        taken = _subtrahend(node.args[1], parts, _text)
        if taken is not None:
            return f"{p[0][0]} - {_wrap(taken, _PRODUCT)}", _SUM
        return f"{p[0][0]} + {_wrap(p[1], _PRODUCT)}", _SUM
    if op == "neg":
        return f"-{_wrap(p[0], _PRODUCT)}", _SUM
    if op == "mul":
        return f"{_wrap(p[0], _PRODUCT)}*{_wrap(p[1], _UNARY)}", _PRODUCT
    if op == "div":
        return f"{_wrap(p[0], _PRODUCT)}/{_wrap(p[1], _POWER)}", _PRODUCT
    if op == "pow":
        return f"{_wrap(p[0], _ATOM)}^{_wrap(p[1], _ATOM)}", _POWER
    if op == "where":
        condition = " >= ".join(text for text, _ in _sides(node.args[0], parts, _text))
        return f"if({condition}, {p[1][0]}, {p[2][0]})", _ATOM
    return f"{op}({', '.join(text for text, _ in p)})", _ATOM


_GREEK = frozenset(
    [
        "alpha",
        "beta",
        "gamma",
        "delta",
        "epsilon",
        "zeta",
        "eta",
        "theta",
        "kappa",
        "lambda",
        "mu",
        "nu",
        "xi",
        "rho",
        "sigma",
        "tau",
        "phi",
        "chi",
        "psi",
        "omega",
        "Gamma",
        "Delta",
        "Theta",
        "Lambda",
        "Xi",
        "Sigma",
        "Phi",
        "Psi",
        "Omega",
    ]
)
_LATEX_FUNCTIONS = {
    "asin": r"\arcsin", "acos": r"\arccos", "atan": r"\arctan", "log": r"\ln",
    "sign": r"\operatorname{sgn}",
    **{f: rf"\{f}" for f in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "min", "max")},
}  # fmt: skip


def name_latex(name: str) -> str:
    """Return a name as LaTeX: Greek letters by name, a tail after ``_`` or of digits below."""
    head, _, tail = name.partition("_")
    if not tail:
        stem = head.rstrip("0123456789")
        head, tail = (stem, head[len(stem) :]) if stem else (head, "")
    if head in _GREEK:
        head = rf"\{head}"
    elif len(head) > 1:
        head = rf"\mathrm{{{head}}}"
    return f"{head}_{{{name_latex(tail) if tail[0].isalpha() else tail}}}" if tail else head


def _group(part: _Part, needed: int) -> str:
    return _wrap(part, needed, r"\left(", r"\right)")


def _latex(node: Expr, parts: dict[Expr, _Part]) -> _Part:
    op = node.op
    if op == "number":
        value: Fraction = node.payload
        if value.denominator == 1:
            return str(value), _ATOM if value >= 0 else _SUM
        sign = "-" if value < 0 else ""
        text = rf"{sign}\frac{{{abs(value.numerator)}}}{{{value.denominator}}}"
        return text, _ATOM if value >= 0 else _SUM
    if op == "constant":
        return (r"\pi" if node.payload == "pi" else r"\mathrm{e}"), _ATOM
    if op == "symbol":
        return name_latex(node.payload), _ATOM
    if op == "within" or (op == "pieces" and node.args[0].op == "within"):
        places = table_arguments(node) if op == "pieces" else node.args[:1]
        name = (node if op == "within" else node.args[0]).payload.name
        given = ", ".join(parts[a][0] for a in places)
        return rf"{name_latex(name.rstrip(chr(39)))}{chr(39) * name.count(chr(39))}" + (
            rf"\left({given}\right)"
        ), _ATOM
    if op == "pieces":
        return rf"p_{{{len(piece_rows(node))}}}\left({parts[node.args[0]][0]}\right)", _ATOM
    if op == "fourier":
        theta, phi = (_group(parts[arg], _POWER) for arg in node.args)
        waves = rf"c_{{mk}} \cos\left(m\,{theta} - k\,{phi} - \delta_{{mk}}\right)"
        return rf"\sum_{{m,k}}^{{{len(node.payload.rows)}}} {waves}", _PRODUCT
    return _latex_operation(node, [parts[arg] for arg in node.args], parts)


def _latex_operation(node: Expr, p: list[_Part], parts: dict[Expr, _Part]) -> _Part:
    op = node.op
    if op == "add":
        taken = _subtrahend(node.args[1], parts, _latex)
        if taken is not None:
            return f"{p[0][0]} - {_group(taken, _PRODUCT)}", _SUM
        return f"{p[0][0]} + {_group(p[1], _PRODUCT)}", _SUM
    if op == "neg":
        return f"-{_group(p[0], _PRODUCT)}", _SUM
    if op == "mul":
        factors = [_group(part, _PRODUCT) for part in p]
        joint = r" \cdot " if factors[1][0].isdigit() or factors[1].startswith(r"\frac") else r"\,"
        return joint.join(factors), _PRODUCT
    if op == "div":
        return rf"\frac{{{p[0][0]}}}{{{p[1][0]}}}", _ATOM
    if op == "pow":
        return f"{_group(p[0], _ATOM)}^{{{p[1][0]}}}", _POWER
    if op == "sqrt":
        return rf"\sqrt{{{p[0][0]}}}", _ATOM
    if op == "abs":
        return rf"\left|{p[0][0]}\right|", _ATOM
    if op == "floor":
        return rf"\left\lfloor {p[0][0]} \right\rfloor", _ATOM
    if op == "where":
        condition = r" \ge ".join(text for text, _ in _sides(node.args[0], parts, _latex))
        rows = rf"{p[1][0]} & \text{{if }} {condition} \\ {p[2][0]} & \text{{else}}"
        return rf"\begin{{cases}} {rows} \end{{cases}}", _ATOM
    name = _LATEX_FUNCTIONS.get(op, rf"\operatorname{{{op}}}")
    return rf"{name}\left({', '.join(text for text, _ in p)}\right)", _ATOM
