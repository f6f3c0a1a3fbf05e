"""What one build leaves to the next: the same bits, of trees that occur again, and not too many."""

from __future__ import annotations

import numpy as np
import pytest

from pc2cad.bounds.taylor_evaluation import enclose
from pc2cad.bounds.taylor_models import Model, Place
from pc2cad.expression import carried, evaluation
from pc2cad.expression.carried import Carried, begin_build
from pc2cad.expression.evaluation import Program
from pc2cad.expression.tree import Expr, call, symbol

U, V = np.linspace(0, 1, 7)[:, None], np.linspace(0, 1, 5)[None, :]
u, v = symbol("u"), symbol("v")


@pytest.fixture(autouse=True)
def _nothing_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(carried, "_trees", carried._Trees())
    monkeypatch.setattr(evaluation, "_carried", Carried(evaluation.MOST_CARRIED))


def shared() -> Expr:
    inner = call("sin", u) ** 2 * call("cos", v) ** 2 + u**3 * call("exp", v)
    return call("sqrt", 2 + inner + call("atan", u * v) + call("cos", u + v))


def variant(wall: float) -> tuple[Expr, ...]:
    return shared() * wall + u, shared() / (2 + u * wall), shared()


def test_variants_have_the_bits_of_a_program_of_their_own() -> None:
    walls = (0.25, 0.5, 0.75, 1.25)
    for wall in walls:
        begin_build()
        trees = variant(wall)
        alone = Program(trees, carry=False)({"u": U, "v": V})
        for _ in range(2):
            found = Program(trees)({"u": U, "v": V})
            assert [x.tobytes() for x in found] == [x.tobytes() for x in alone]
            for x in found:
                x += 1.0  # nobody else has it
    assert len(evaluation._carried._recent) == 1


def test_numbers_and_other_layouts_are_worked_out_anew() -> None:
    for wall in (0.25, 0.5, 0.75):
        begin_build()
        trees = variant(wall)
        program, alone = Program(trees), Program(trees, carry=False)
        turned = np.asfortranarray(np.arange(12.0).reshape(3, 4))
        cases = (0.5, 0.25), (turned, turned + 1), (turned.T.copy().T, 2.0)
        assert len(cases) == 3
        for a, b in cases:
            found, wanted = program({"u": a, "v": b}), alone({"u": a, "v": b})
            assert [np.asarray(x).tolist() for x in found] == [
                np.asarray(x).tolist() for x in wanted
            ]


def test_one_build_keeps_nothing() -> None:
    begin_build()
    tree = call("sin", 1234 * u + v)
    for k in range(20):
        tree = call("exp", call("atan", tree * u + 4321 * v + k))
    for _ in range(3):
        Program((tree, tree * u))({"u": U, "v": V})
    assert not evaluation._carried._recent


def test_models_are_those_of_one_build() -> None:
    centre = np.linspace(0.1, 0.9, 4)
    place = Place(centre, np.full(4, 0.1), np.full(4, 0.2))

    def bits(models: tuple[Model, ...]) -> list[bytes]:
        return [x.tobytes() for m in models for x in (m.terms, m.radius, m.error)]

    first = bits(enclose(variant(0.5), ("u", "v"), (place, place), 4))
    for wall in (0.25, 0.75, 0.5):
        begin_build()
        again = bits(enclose(variant(wall), ("u", "v"), (place, place), 4))
    assert again == first


def test_only_so_many_bytes_are_kept() -> None:
    kept: Carried[int] = Carried(100)
    for k in range(50):
        kept.keep(k, k, 30)
        assert kept.get(0) == 0  # asked for all the time
    found = [k for k in range(1, 50) if k in kept._recent or k in kept._older]
    assert len(found) <= 6
    assert kept.get(49) == 49
    assert kept.get(1) is None
