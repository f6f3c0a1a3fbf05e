"""What is remembered of nodes says what looking at them says."""

from __future__ import annotations

from fractions import Fraction

import pytest

import pc2cad as pc
from pc2cad.expression import normal_form as terms
from pc2cad.expression import recent
from pc2cad.expression.monomials import with_multiple
from pc2cad.expression.normal_form import normal_form, tree_of
from pc2cad.expression.recent import Holding
from pc2cad.expression.tree import ONE, Expr, as_expr, call, number, power

U, V, W = pc.parameters()


@pytest.mark.parametrize("most", [recent.MOST, 3])
def test_holding_everywhere(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recent, "MOST", most)
    asked: list[Expr] = []

    def holds(node: Expr) -> bool:
        asked.append(node)
        return node.op != "exp"

    plain = Holding(holds, lambda node: node.args)
    first, second, third = U * V + 1, pc.exp(U * V + 1) * W, (U * V + 1) * W
    assert plain.of((first,))
    before = len(asked)
    assert plain.of((first, first))
    assert len(asked) == before
    for _ in range(2):
        assert not plain.of((third, second))
        assert not plain.of((second,))
        assert plain.of((third,))
    assert plain.of(())


@pytest.mark.parametrize("most", [recent.MOST, 2])
def test_normal_forms_do_not_depend_on_what_was_asked_before(
    most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recent, "MOST", most)
    sine, cosine = pc.sin(U), pc.cos(U)
    product = 3 * (sine * (V * 2)) * (cosine / W) * (V / 7)
    trees = [product, product * sine, sine * sine * (sine * sine), product * (U + V + W)]
    trees += [product - product * 1, (U + V) ** 3 - (V + U) ** 3 + product, product * product]

    def forms(largest: int) -> list[object]:
        return [normal_form(tree, largest) for tree in trees]

    alone = []
    for largest in (3, 50):
        monkeypatch.setattr(terms, "_monomials", recent.Recent())
        alone.append(forms(largest))
    assert alone == [forms(3), forms(50)] == [forms(3), forms(50)]
    assert alone[0][3] is not None
    assert alone[0][5] is None
    assert alone[1][5] == alone[1][0]


def test_coefficients_are_in_lowest_terms_and_add_up_exactly() -> None:
    # numerators and denominators are kept apart while a form is made
    u = as_expr(U)
    terms = [number(Fraction(n + 1, n + 2)) * (u * number(Fraction(n, 6)) + 1) for n in range(1, 7)]
    total = sum(terms, start=u * u)
    form = normal_form(total)
    ones = sum((Fraction(n + 1, n + 2) for n in range(1, 7)), start=Fraction(0))
    firsts = sum((Fraction(n + 1, n + 2) * Fraction(n, 6) for n in range(1, 7)), start=Fraction(0))
    assert form == {(): ones, ((u, 1),): firsts, ((u, 2),): Fraction(1)}
    assert normal_form(total * total - total**2) == {}


def test_multiples_are_added_as_normal_forms_are() -> None:
    u, angle = as_expr(U), as_expr(V)
    sine, atom = call("sin", angle), ONE / (u + 2)
    for share in ({((sine, 2),): Fraction(3)}, {((sine, 1),): Fraction(3), (): Fraction(-1)}):
        for exponent in (0, 2):
            factor = ((atom, exponent),)
            form = normal_form(u + sine + atom * atom)
            assert form is not None
            added = tree_of(form) + tree_of(share) * power(atom, number(exponent))
            expected = normal_form(added)
            assert expected is not None
            found = with_multiple(form, share, factor, 10)
            assert found is not None
            assert [*found.items()] == [*expected.items()]
            assert with_multiple(form, share, factor, 2) is None
