"""Trees modulo a prime: what tells at once that a function is no square of a polynomial in atoms.

Every atom of a normal form gets a residue, such that all holds that normal forms use: a sine and a
cosine of one angle lie on a circle, a root squared is what it is taken of, a quotient is one. A
number times a square g² then has residues that are, over all places, all squares times that number
or none: two that differ refute it, without any polynomial being multiplied out.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from itertools import islice
from typing import Final

from pc2cad.expression.tree import Expr, walk

#: primes p with p mod 4 = 3, so that roots are powers: a root that one has not another may have
_PRIMES: Final = ((1 << 31) - 1, (1 << 31) - 61, (1 << 31) - 69)
#: places that are looked at, and values among them from which on all alike are taken for a square
_PLACES, _ENOUGH = 16, 8


def may_be_square(root: Expr) -> bool:
    """Say whether residues leave it open that a tree is a number times a square."""
    below = [(node, node.op, _operands(node)) for node in walk((root,), _operands)]
    for prime in _PRIMES:
        kinds = []
        for value in islice(_values(below, prime), _ENOUGH):
            kinds.append(pow(value, prime // 2, prime))
            if kinds[-1] != kinds[0]:
                return False
        if len(kinds) > 1:
            break
    return True


def _values(below: list[tuple[Expr, str, tuple[Expr, ...]]], prime: int) -> Iterator[int]:
    """Yield the residues of the last of some nodes, where they have one other than 0."""
    value = 0
    try:
        store = {node: _of_number(node.payload, prime) for node, op, _ in below if op == "number"}
    except ValueError:  # the prime divides a denominator
        return
    rest = [row for row in below if row[1] != "number"]
    for place in range(_PLACES):
        try:
            for node, op, args in rest:
                if op == "mul":
                    a, b = args
                    value = store[a] * store[b] % prime
                elif op == "add":
                    a, b = args
                    value = (store[a] + store[b]) % prime
                else:
                    value = _residue(node, [store[arg] for arg in args], place, prime)
                store[node] = value
        except (ValueError, _NoResidueError):  # a division by zero, or a root that there is not
            continue
        if value:
            yield value


def _of_number(value: Fraction, prime: int) -> int:
    return value.numerator * pow(value.denominator, -1, prime) % prime


class _NoResidueError(Exception):
    pass


def _operands(node: Expr) -> tuple[Expr, ...]:
    """Return the operands that a residue is made of: none for an atom."""
    if node.op in ("add", "neg", "mul", "div", "sqrt"):
        return node.args
    whole = node.op == "pow" and node.args[1].op == "number"
    if node.op == "within" or (whole and node.args[1].payload.denominator == 1):
        return node.args[:1]
    return ()


def _residue(node: Expr, args: list[int], place: int, prime: int) -> int:
    """Return the residue of a node that is no number, sum or product from its operands'."""
    op = node.op
    if op == "neg":
        return -args[0] % prime
    if op == "div":
        return args[0] * pow(args[1], -1, prime) % prime
    if op == "within":
        return args[0]
    if op == "pow" and args:
        return pow(args[0], int(node.args[1].payload), prime)
    if op == "sqrt":
        root = pow(args[0], (prime + 1) // 4, prime)
        if root * root % prime != args[0]:
            raise _NoResidueError
        return root if _scattered(node, place) % 2 else -root % prime
    if op in ("sin", "cos"):
        tangent = _scattered(node.args[0], place) % prime  # of half the angle
        share = pow(1 + tangent * tangent, -1, prime)
        return (2 * tangent if op == "sin" else 1 - tangent * tangent) * share % prime
    return _scattered(node, place) % prime


def _scattered(atom: Expr, place: int) -> int:
    """Return some number for an atom, from its content alone: every process takes the same."""
    mixed = (atom.rank + 1 + 0x9E3779B97F4A7C15 * (place + 1)) & 0xFFFFFFFFFFFFFFFF
    mixed = (mixed ^ mixed >> 30) * 0xBF58476D1CE4E5B9 & 0xFFFFFFFFFFFFFFFF
    mixed = (mixed ^ mixed >> 27) * 0x94D049BB133111EB & 0xFFFFFFFFFFFFFFFF
    return mixed ^ mixed >> 31
