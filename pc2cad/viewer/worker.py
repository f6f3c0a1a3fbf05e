"""The process that makes a page's parts: asked on stdin, answers on stdout, one after another.

Started by `recompute`. Questions and answers are pickles of our own making, after their lengths.
The kernel prints to file descriptor 1, so that one is pointed to nowhere and the answers go through
a copy of it.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO

from pc2cad.errors import KernelError, PointCadError
from pc2cad.trust.processes import end_with_parent, keep_what_is_loaded


@dataclass(frozen=True)
class Download:
    """A file of the part at some values of its parameters; `ending` says which."""

    ending: str
    values: Mapping[str, str]


#: values of parameters, for what the page shows of the part, or a file of it
Question = Mapping[str, str] | Download


def send(stream: BinaryIO, thing: Any) -> None:
    """Write a thing."""
    data = pickle.dumps(thing)
    stream.write(len(data).to_bytes(8, "little") + data)
    stream.flush()


def receive(stream: BinaryIO) -> Any:
    """Read what `send` wrote; raise EOFError when the other process has ended."""
    length = stream.read(8)
    data = stream.read(int.from_bytes(length, "little"))
    if len(length) < 8 or len(data) < int.from_bytes(length, "little"):
        raise EOFError
    return pickle.loads(data)


def main() -> None:
    """Answer requests until nobody asks any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what Ctrl-C means
    end_with_parent()
    answers = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    questions = sys.stdin.buffer
    answer: bytes | PointCadError
    try:
        make, first = receive(questions), True
        while True:
            question = receive(questions)
            try:
                answer = make(question)
            except PointCadError as error:
                answer = error
            except MemoryError:
                answer = KernelError("there is not enough memory for this solid")
            except Exception as error:  # one part must not end the page
                answer = KernelError(f"an unexpected error: {type(error).__name__}: {error}")
            send(answers, answer)
            if first:
                keep_what_is_loaded()
                first = False
    except (EOFError, BrokenPipeError):
        return
