"""Square roots and quotients that cancel: lengths that turn out constant, unit vectors of them.

|KN| of a circle is a root of squares of sines and cosines; its normal form is a constant. Here
roots of constants and of perfect squares are taken, and quotients whose denominator divides what
stands above it are carried out, all in exact arithmetic: what does not cancel stays as it is.
|KN| of any section does not depend on the frame, whose vectors are of length 1 and at right
angles: parameters on which a root turns out not to depend are taken out of it.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache

from pc2cad.expression.identity import ROUNDING, seems_constant
from pc2cad.expression.linear_terms import cancel_terms
from pc2cad.expression.monomials import (
    Rank,
    halved,
    lowered,
    order_of,
    over,
    quotient,
    times,
    with_multiple,
)
from pc2cad.expression.normal_form import Monomial, NormalForm, normal_form, tree_of, with_square
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.polynomials import constant_sums
from pc2cad.expression.residues import may_be_square
from pc2cad.expression.rewriting import among, has_more, rewrite
from pc2cad.expression.scalar import evaluate, values_of
from pc2cad.expression.separable_sums import product_of, products, without_number
from pc2cad.expression.sign_changes import sign_changes
from pc2cad.expression.tree import (
    ONE,
    ZERO,
    Expr,
    call,
    div,
    number,
    ops_of,
    rebuild,
    symbol,
    walk,
)

#: forms with more terms than this are left alone
LARGEST = 150
#: and so are trees with more operations, unless samples find them constant
MOST_NODES = 80
#: roots of squares with more terms are not looked for
LONGEST_ROOT = 12


@lru_cache(maxsize=8)
def simplified(roots: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return equal trees without the terms, roots and quotients that cancel (see `cancel`)."""
    return cancel(cancel_terms(roots))


def cancel(roots: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return equal trees without the roots and quotients that cancel.

    u, v and w are local parameters and run from 0 to 1, other symbols anywhere: a root of a square
    is taken only where the sign of what was squared is certain.
    """
    roots = _constant_sums(roots)
    held = ops_of(roots)
    if "sqrt" in held:
        roots = rewrite(roots, "sqrt", _root, keep=True)
    return tuple(_divided(root) for root in roots) if "div" in held else roots


def _constant_sums(roots: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Return equal trees with the sums that turn out constant as constants.

    N'·N' of a helix is one, and so is N''·N', which is 0.
    """
    steady = constant_sums(roots)
    if steady is not None and not steady:
        return roots
    nodes = walk(roots)
    if steady is None:
        names = sorted(frozenset().union(*(root.symbols for root in roots)))
        steady = {node for node in nodes if node.op == "add" and node.symbols}
        first: dict[Expr, float] = {}
        for x in (0.13, 0.37, 0.58):
            if not steady:
                break
            table = values_of(nodes, {n: x + 0.11 * i for i, n in enumerate(names)})
            first = first or table
            steady = {node for node in steady if _is_steady(node, first, table)}
    if not steady:
        return roots
    done: dict[Expr, Expr] = {}
    for node in nodes:
        args = tuple([done[arg] for arg in node.args])
        done[node] = node if args == node.args else rebuild(node, args)
        if node in steady and done[node].symbols:
            form = _form(done[node])
            if form is not None and not any(a.symbols for m in form for a, _ in m):
                done[node] = tree_of(form)
    return tuple(done[root] for root in roots)


def _is_steady(node: Expr, here: dict[Expr, float], there: dict[Expr, float]) -> bool:
    """Say whether a sum has one value at two places, but for rounding of its terms."""
    size = max([abs(table[arg]) for table in (here, there) for arg in node.args])
    return abs(there[node] - here[node]) <= ROUNDING * size


@lru_cache(maxsize=512)
def _root(node: Expr) -> Expr:
    radicand = without_idle(node.args[0])
    node = call("sqrt", radicand)
    if node.op != "sqrt":
        return node
    # algebra is dear: a few values tell whether there is a constant to be proved
    steady = bool(node.symbols) and seems_constant(radicand, _value(radicand))
    if not node.symbols or not (steady or (_is_short(radicand) and may_be_square(radicand))):
        return node
    form = _form(radicand)
    if form is None:
        return node
    if all(not atom.symbols for monomial in form for atom, _ in monomial):
        return call("sqrt", tree_of(form))
    return _root_of_square(form) or node


def without_idle(root: Expr) -> Expr:
    """Return an equal tree without the parameters on which it does not depend, where proved."""
    if len(root.symbols) < 2:
        return root
    for name in sorted(root.symbols):
        if not _seems_idle(root, name):
            continue
        sums = products((root,), name)
        steady = sums and {f: _constant(c) for f, c in sums[0].items()}
        if steady and all(c is not None for c in steady.values()):
            terms = (product_of(f) * c for f, c in steady.items() if c is not None)
            return without_idle(sum(terms, start=ZERO))
    return root


def _seems_idle(root: Expr, name: str) -> bool:
    """Say whether values at a few places hide a parameter."""
    rest = {other: 0.37 + 0.11 * i for i, other in enumerate(sorted(root.symbols))}
    nodes = walk((root,))
    first = values_of(nodes, {**rest, name: 0.21})[root]
    others = (values_of(nodes, {**rest, name: x})[root] for x in (0.47, 0.88))
    return all(abs(value - first) <= ROUNDING * abs(first) for value in others)


def _constant(coefficient: Expr) -> Expr | None:
    """Return the constant that a tree in one parameter is, or None.

    It is looked for without the number that the tree is a multiple of: that is what differs from
    one variant of a template to the next.
    """
    factor, rest = without_number(coefficient)
    if (found := _plain_constant(rest)) is not None and found.op == "number":
        return number(factor) * found
    return _plain_constant(coefficient)


@lru_cache(maxsize=512)
def _plain_constant(coefficient: Expr) -> Expr | None:
    """Return the constant that a tree in one parameter is, or None.

    Vectors of unknown direction are enough to know that unit vectors are of length 1, and that a
    vector is at right angles to its products with others.
    """
    if not coefficient.symbols:
        return coefficient
    # no values are asked first: the sum of which it is a coefficient seems not to depend on it
    return _without_symbols(_with_unknown_vectors(coefficient))


@lru_cache(maxsize=512)  # with unknown vectors the same for all numbers of a guide
def _without_symbols(tree: Expr) -> Expr | None:
    """Return a tree whose normal form holds no symbols as that form, or None."""
    form = _form(tree)
    if form is None or any(atom.symbols for monomial in form for atom, _ in monomial):
        return None
    return tree_of(form)


def _with_unknown_vectors(root: Expr) -> Expr:
    """Return the tree with symbols for what is squared under its roots, and for what holds none."""
    nodes = walk((root,))
    squared = {
        base
        for node in nodes
        if node.op == "sqrt"
        for base in _squared(node.args[0])
        if base.symbols
    }
    if not squared:
        return root
    inner, holds = set[Expr](), set[Expr]()
    for node in nodes:
        if not holds.isdisjoint(node.args):
            holds.add(node)
        elif node in squared:  # and nothing below it is
            inner.add(node)
            holds.add(node)
    done: dict[Expr, Expr] = {}
    for node in walk((root,), lambda n: () if n in inner or n not in holds else n.args):
        if node in inner or node not in holds:
            # values of unknown vectors need no names that could meet the equation's own
            done[node] = symbol(f"{len(done)}") if node.symbols else node
        else:
            done[node] = rebuild(node, tuple(done[arg] for arg in node.args))
    return done[root]


def _squared(radicand: Expr) -> list[Expr]:
    """Return the trees whose squares a radicand adds up."""
    if radicand.op == "add":
        return [base for arg in radicand.args for base in _squared(arg)]
    if radicand.op == "pow" and radicand.args[1].op == "number" and radicand.args[1].payload == 2:
        return [radicand.args[0]]
    if radicand.op == "mul" and radicand.args[0] is radicand.args[1]:
        return [radicand.args[0]]
    return []


@lru_cache(maxsize=512)
def _divided(root: Expr) -> Expr:
    if "div" not in root.ops or not _is_short(root):
        return root
    quotients = among((root,), lambda n: "div" in n.ops)
    if not any(node.op == "div" and node.args[1].symbols for node in quotients):
        return root
    plain = normal_form(root, LARGEST)
    form = _settled(plain)
    return root if form is None or form == plain else tree_of(form)


def _value(root: Expr) -> float:
    """Return the value at one place."""
    return evaluate(root, {name: 0.37 + 0.11 * i for i, name in enumerate(sorted(root.symbols))})


def _is_short(root: Expr) -> bool:
    return not has_more(root, MOST_NODES, leaves=False)


# -- normal forms in which things cancel -----------------------------------------------------------


def _form(root: Expr) -> NormalForm | None:
    """Return the normal form with squares of roots and exact quotients carried out."""
    return _settled(normal_form(root, LARGEST))


def _settled(form: NormalForm | None) -> NormalForm | None:
    """Return a form with all that it holds of them carried out; itself where it holds none."""
    while form is not None:
        changed = _without_squares(form)
        if changed is None:
            changed = _without_quotient(form)
        if changed is None:
            return form
        form = changed if len(changed) <= LARGEST else None
    return None


def _without_squares(form: NormalForm) -> NormalForm | None:
    """Replace the square of one root (or of the reciprocal of one); None if there is none."""
    for monomial in form:
        for atom, exponent in monomial:
            if exponent < 2:
                continue
            if atom.op == "sqrt":
                return _replaced(form, atom, atom.args[0])
            if atom.op == "div" and atom.args[0] is ONE and atom.args[1].op == "sqrt":
                return _replaced(form, atom, div(ONE, atom.args[1].args[0]))
    return None


def _replaced(form: NormalForm, atom: Expr, square: Expr) -> NormalForm | None:
    squared = normal_form(square, LARGEST)
    return None if squared is None else with_square(form, atom, squared, LARGEST)


def _without_quotient(form: NormalForm) -> NormalForm | None:
    """Carry out one exact division; None where no denominator divides what stands above it."""
    atoms = {atom: None for monomial in form for atom, _ in monomial if atom.op == "div"}
    for atom in atoms:
        if not (divisor := normal_form(atom.args[1], LARGEST)):
            continue
        highest = max(e for monomial in form for a, e in monomial if a is atom)
        above = {lowered(m, atom, highest): c for m, c in form.items() if (atom, highest) in m}
        if (exact := quotient(above, divisor, 2 * LARGEST)) is not None:
            rest = {m: c for m, c in form.items() if (atom, highest) not in m}
            return with_multiple(rest, exact, ((atom, highest - 1),), LARGEST)
    return None


# -- roots of perfect squares ----------------------------------------------------------------------


def _root_of_square(form: NormalForm) -> Expr | None:
    """Return the root of a perfect square of known sign, or None."""
    for write in (lambda f: f, _in_sines):
        square = write(form)
        order = order_of(square)
        lead = max(square, key=order)
        content = square[lead]
        half = halved(lead)
        if half is None or content < 0:
            continue
        root = _completed(square, half, content, order, write)
        if root is None:
            continue
        sign = _sign(root)
        if sign:
            return call("sqrt", number(content)) * (sign * tree_of(root))
    return None


def _sign(form: NormalForm) -> int:
    """Return 1 or -1 for a polynomial that is proved to have one sign inside the box, else 0."""
    low, high = _bounds(form)
    if low > 0 or high < 0:
        return 1 if low > 0 else -1
    tree = tree_of(form)
    one = len(tree.symbols) == 1 and tree.symbols.issubset(PARAMETERS)
    changes = sign_changes(tree) if one else None
    return changes.signs[0] if changes is not None and not changes.places else 0


def _completed(
    square: NormalForm,
    half: Monomial,
    content: Fraction,
    order: Callable[[Monomial], Rank],
    write: Callable[[NormalForm], NormalForm],
) -> NormalForm | None:
    """Return g with content · g² = square, its leading term `half`, term by term."""
    root: NormalForm = {half: Fraction(1)}
    while len(root) <= LONGEST_ROOT:
        tree = tree_of(root)
        form = normal_form(tree_of(square) - number(content) * tree * tree, 4 * LARGEST)
        if form is None:
            return None
        rest = write(form)
        if not rest:
            return root
        top = max(rest, key=order)
        share = over(top, half)
        if share is None or share in root:
            return None
        root[share] = rest[top] / (2 * content)
    return None


def _in_sines(form: NormalForm) -> NormalForm:
    """Write squares of cosines as 1 - sin², where normal forms do the reverse."""
    result: NormalForm = {}
    stack = list(form.items())
    while stack:
        monomial, coefficient = stack.pop()
        cosine = next((a for a, e in monomial if a.op == "cos" and e > 1), None)
        if cosine is None:
            total = result.get(monomial, Fraction(0)) + coefficient
            if total:
                result[monomial] = total
            else:
                result.pop(monomial, None)
            continue
        lower = lowered(monomial, cosine, 2)
        sine = ((call("sin", cosine.args[0]), 2),)
        stack += [(lower, coefficient), (times(lower, sine), -coefficient)]
    return result


def _bounds(form: NormalForm) -> tuple[float, float]:
    """Return what a polynomial lies between while u, v and w run from 0 to 1, term by term."""
    low = high = 0.0
    for monomial, coefficient in form.items():
        a = b = float(coefficient)
        for atom, exponent in monomial:
            if not atom.symbols:
                ends = [evaluate(atom, {}) ** exponent] * 2
            elif atom.op == "symbol" and atom.payload in PARAMETERS:
                ends = [0.0, 1.0]
            elif atom.op in ("sin", "cos"):
                ends = [0.0 if exponent % 2 == 0 else -1.0, 1.0]
            else:
                return -float("inf"), float("inf")
            products = [x * y for x in (a, b) for y in ends]
            a, b = min(products), max(products)
        low, high = low + a, high + b
    margin = 1e-12 * sum(abs(float(c)) for c in form.values())
    return low - margin, high + margin
