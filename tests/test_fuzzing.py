"""A short run of the fuzzers, and every text of the kept corpus."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest
from fuzzing import grammar, options, oracles
from hypothesis import given
from hypothesis import strategies as st

KEPT = sorted((Path(__file__).parent / "fuzzing" / "corpus").iterdir())
expressions = st.builds(grammar.expression, st.randoms(use_true_random=False))
templates = st.builds(grammar.template, st.randoms(use_true_random=False))


@given(expressions)
def test_an_expression_is_read_or_refused(text: str) -> None:
    oracles.read(text)


@given(templates)
def test_a_template_is_read_or_refused(text: str) -> None:
    oracles.read_template(text)


@given(st.text(max_size=60))
def test_any_text_is_read_or_refused(text: str) -> None:
    oracles.read(text)
    oracles.read_template(text)


@pytest.mark.parametrize("path", KEPT, ids=lambda path: path.name)
def test_the_kept_corpus_is_read_or_refused(path: Path) -> None:
    data = path.read_bytes()
    text = data[1:].decode("utf-8", errors="surrogateescape")
    (oracles.read_template if data[:1] == b"T" else oracles.read)(text)


def test_the_grammar_makes_good_and_bad_texts() -> None:
    random = Random(1)
    accepted = sum(oracles.read(grammar.expression(random)) for _ in range(400))
    assert 60 < accepted < 340
    accepted = sum(oracles.read_template(grammar.template(random)) for _ in range(400))
    assert 4 < accepted < 340


def test_random_options_and_environments_end_in_a_sentence(tmp_path: Path) -> None:
    codes = options.campaign(30, 1, tmp_path)
    assert codes[2] > 10
    assert codes[0] > 3


@pytest.mark.slow
def test_a_thousand_random_options_and_environments_end_in_a_sentence(tmp_path: Path) -> None:
    assert sum(options.campaign(1000, 2, tmp_path).values()) == 1000
