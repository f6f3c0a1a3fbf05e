"""Coverage-guided fuzzing of the parser and the template reader (pip install atheris).

    python -m fuzzing.atheris_target fuzzing/corpus -max_len=400 -runs=200000

The first byte chooses what the rest is: an expression or a template.
"""

from __future__ import annotations

import sys

import atheris

with atheris.instrument_imports(include=["pc2cad.equation"]):
    from fuzzing import oracles


def test_one_input(data: bytes) -> None:
    """Read one text; any exception but an InputError is a find."""
    text = data[1:].decode("utf-8", errors="surrogateescape")
    if data[:1] == b"T":
        oracles.read_template(text)
    else:
        oracles.read(text)


if __name__ == "__main__":
    atheris.Setup(sys.argv, test_one_input)
    atheris.Fuzz()
