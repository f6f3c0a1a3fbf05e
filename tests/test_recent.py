"""What is remembered of nodes says what looking at them says."""

from __future__ import annotations

import pytest

import pc2cad as pc
from pc2cad.expression import recent
from pc2cad.expression.recent import Holding
from pc2cad.expression.tree import Expr

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
