"""The command ``pc2cad``: reads the arguments, runs a verb, turns errors into one sentence.

Exit codes: 0 done, 2 bad input, 3 not a solid, 4 tolerance not reached, 5 kernel or file trouble,
6 a file that is not verified; 130 interrupted, 141 nobody reads the output.
"""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any, Final, NoReturn

from pc2cad.cli.guard import add_limits, guard
from pc2cad.cli.interruption import expect_interruptions, ignore_interruptions, insistent
from pc2cad.cli.output import complain, complain_at_length, say, tolerate_encodings
from pc2cad.errors import InputError, PointCadError
from pc2cad.trust.isolation import forget_current_folder
from pc2cad.trust.processes import collect_rarely, keep_freed_memory, leave_without_collecting

INTERRUPTED: Final = 130
BROKEN_PIPE: Final = 141
#: verb, which is also the name of its module -> what it does
VERBS: Final = {
    "build": "compile a template into a solid and write it to files",
    "check": "compile a template and show what is known of the solid; write nothing",
    "sensitivities": "show how volume, area, centroid, mass and inertia change with parameters",
    "adjust": "find parameters for which a solid has a wanted volume, mass or other figure",
    "study": "build many variants of a template, with a table of what became of each",
    "mesh": "mesh a template with hexahedra or tetrahedra for finite elements",
    "render": "compile a template and write pictures of it, PNG or SVG",
    "view": "compile a template into a page to turn it on, or serve that page live",
    "points": "sample the solid's interior",
    "spline": "write the volume itself as trivariate splines for isogeometric analysis",
    "verify": "hold a STEP file against itself, and against a template, without a kernel",
    "show": "show the point equation and its coordinate-wise system",
    "templates": "list the shipped templates",
    "new": "write a commented template to start from",
    "completion": "print a script that completes verbs, options and templates in a shell",
}


#: verbs whose work is done by a process that is watched; `study` watches its own workers
GUARDED: Final = (
    "build", "check", "sensitivities", "adjust", "mesh", "render", "view", "points", "spline",
    "verify",
)  # fmt: skip
#: verbs with arrays so small that further threads would only wait, and of NumPy alone
SMALL: Final = ("verify",)


class UsageError(InputError):
    """The arguments of the command do not fit together."""


class _Parser(argparse.ArgumentParser):
    """Raises instead of printing the usage and leaving."""

    def print_help(self, file: Any = None) -> None:
        say(self.format_help().rstrip())

    def error(self, message: str) -> NoReturn:
        verb = self.prog.partition(" ")[2]
        hint = ""
        if "expected one argument" in message:
            hint = " (a file name that begins with '-' is written ./-name)"
        elif "unrecognized" in message and "=" in message:
            hint = " (each parameter has its own -s)"
        raise UsageError(f"{verb + ': ' if verb else ''}{message}{hint}; see '{self.prog} --help'")


class _Version(argparse.Action):
    """Prints the versions of pc2cad and of what it stands on, without loading them."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        from importlib.metadata import PackageNotFoundError, version

        from pc2cad.export.version import __version__

        parts = []
        for package in ("cadquery", "cadquery-ocp"):
            try:
                parts.append(f"{package} {version(package)}")
            except PackageNotFoundError:
                parts.append(f"{package} not installed")
        python = ".".join(str(part) for part in sys.version_info[:3])
        say(f"pc2cad {__version__} ({', '.join(parts)}, Python {python})")
        parser.exit()


def make_parser(only: str | None = None) -> argparse.ArgumentParser:
    """Return the parser of all verbs; the arguments of one alone are read where it is named."""
    parser = _Parser(
        prog="pc2cad",
        description="Compiles a point equation M(u,v,w) into one closed, exact B-rep solid.",
        epilog="Exit codes: 0 done, 2 bad input, 3 not a solid, 4 tolerance not reached, 5 kernel "
        "or file trouble, 6 a file not verified. PC2CAD_DEBUG=1 shows where an error arose.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the versions and exit")
    verbs = parser.add_subparsers(prog=parser.prog, metavar="VERB", dest="verb", required=True)
    for name, purpose in VERBS.items():
        if only not in (None, name):
            continue
        verb = verbs.add_parser(
            name, help=purpose, description=f"{purpose[0].upper()}{purpose[1:]}.",
            allow_abbrev=False,
        )  # fmt: skip
        module = import_module(f"pc2cad.cli.{name}")
        module.add_arguments(verb)
        if name in GUARDED:
            add_limits(verb)
        verb.set_defaults(run=module.run)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code; ``argv`` is without the command's name."""
    try:
        if argv is None:
            expect_interruptions()
            forget_current_folder()
        tolerate_encodings()
        if argv is None and not sys.warnoptions and not _debugging():
            # stderr is for our own sentences
            warnings.simplefilter("ignore")
        code = _run(argv)
        if sys.stdout is not None:
            sys.stdout.flush()
        return code
    except BrokenPipeError:
        _drop_stdout()
        return BROKEN_PIPE
    except (KeyboardInterrupt, Exception) as error:
        if argv is None:
            ignore_interruptions()
        if _debugging():
            complain_at_length(error)
        sentence, code = _verdict(error)
        complain(sentence)
        return code


def _debugging() -> bool:
    return os.environ.get("PC2CAD_DEBUG") == "1"


def _run(argv: Sequence[str] | None) -> int:
    given = sys.argv[1:] if argv is None else argv
    try:
        arguments = make_parser(given[0] if given and given[0] in VERBS else None).parse_args(argv)
    except SystemExit as leaving:  # --help and --version
        return int(leaving.code or 0)
    if arguments.verb in (*GUARDED, "study"):
        _check_epoch()
    if argv is not None:  # within a program that calls `main`, the process is not ours
        return int(arguments.run(arguments))
    ended = guard(arguments)
    if ended is not None:
        return ended
    collect_rarely()
    if arguments.verb in SMALL:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        keep_freed_memory()
    elif not sys.warnoptions and not _debugging():
        import logging  # which libraries load that a small verb does not need

        logging.disable()
    try:
        with insistent():
            return int(arguments.run(arguments))
    finally:
        leave_without_collecting()


def _check_epoch() -> None:
    """Look at SOURCE_DATE_EPOCH first: libraries that are loaded later fail on what it may not be.

    Empty, it means nothing, which some of them do not know.
    """
    from pc2cad.export.epoch import NAME, stated_time

    if stated_time() is None:
        os.environ.pop(NAME, None)


def _verdict(error: BaseException) -> tuple[str, int]:
    """Return the sentence that tells a user what happened, and the exit code."""
    if _is_interruption(error):
        error = KeyboardInterrupt()
    match error:
        case PointCadError():
            return str(error), error.exit_code
        case KeyboardInterrupt():
            return "interrupted; files that were being written are as they were before", INTERRUPTED
        case MemoryError():
            return "there is not enough memory for this solid", PointCadError.exit_code
        case RecursionError():
            return "an expression is nested too deeply", InputError.exit_code
        case OSError() if error.filename is None and error.strerror:
            _drop_stdout()
            return f"the output cannot be written: {error.strerror}", PointCadError.exit_code
    what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return (
        f"an unexpected error, please report it ({what}); PC2CAD_DEBUG=1 shows where it arose",
        PointCadError.exit_code,
    )


def _is_interruption(error: BaseException | None) -> bool:
    """Say whether Ctrl-C is behind the error: an import that it stops ends in ImportError."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__cause__ or error.__context__
    return False


def _drop_stdout() -> None:
    """Point stdout to nowhere, so that the interpreter does not fail again as it ends."""
    with suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


if __name__ == "__main__":
    sys.exit(main())
