"""Reading template files (TOML) strictly: every mistake is named with file, key and column."""

from __future__ import annotations

import os
import tomllib
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import Final

from pc2cad.expression.budget import bounded
from pc2cad.templates.bodies import BodiesTemplate, read_bodies
from pc2cad.templates.header import TemplateError
from pc2cad.templates.reader import read_tables
from pc2cad.templates.scan import check_numbers, check_text, unquoted_expression
from pc2cad.templates.shipped import find_template
from pc2cad.templates.template import Template
from pc2cad.trust.files import FileNotReadError, read_regular
from pc2cad.trust.names import clean

LARGEST_FILE: Final = 256 * 1024
#: templates that are kept as they were read
MOST_KEPT: Final = 16


def read_template(path: str | os.PathLike[str]) -> Template | BodiesTemplate:
    """Read a template of one solid or of several bodies: a file's, or a shipped one by its name.

        duct = pc.read_template("duct").bind({"wall": 2})

    Raises TemplateError for any mistake, UnknownTemplateError where there is no such template.
    """
    found, name = Path(path), os.fspath(path)
    # a bare word is a name; what looks like a file and is none says so
    if found.name == name and not found.suffix:
        found = find_template(name)
    return parse_template(read_template_text(found), found.stem, str(found))


def parse_template(text: str, name: str, file: str = "template") -> Template | BodiesTemplate:
    """Return the template that a TOML text holds; `file` is named in messages."""
    return _parsed(text, clean(name) or "unnamed", file)


@lru_cache(maxsize=MOST_KEPT)  # a variant's template has most often been read for the one before
def _parsed(text: str, name: str, file: str) -> Template | BodiesTemplate:
    check_text(text, file)
    try:
        # as_float keeps decimals exact: 0.1 is one tenth
        data = tomllib.loads(text, parse_float=_decimal)
    except tomllib.TOMLDecodeError as error:
        unquoted = unquoted_expression(text, str(error))
        raise TemplateError(f"{file}: {unquoted or f'not valid TOML: {error}'}") from error
    except ValueError as error:  # Python converts no decimals of over 4300 digits
        raise TemplateError(f"{file}: a number has thousands of digits") from error
    except (RecursionError, MemoryError) as error:
        raise TemplateError(f"{file}: the TOML is nested too deeply") from error
    check_numbers(data, file)
    with bounded():
        if "bodies" in data or "result" in data:
            return read_bodies(name, file, data)
        return read_tables(name, file, data, {}, {})


def read_template_text(path: Path) -> str:
    """Return the text of a template file; raise TemplateError where it is no such file."""
    try:
        return read_regular(path, LARGEST_FILE).decode("utf-8").replace("\r\n", "\n")
    except FileNotReadError as error:
        raise TemplateError(f"{path}: {error}") from error
    except UnicodeDecodeError as error:
        raise TemplateError(f"{path}: not UTF-8 (byte {error.start})") from error


def _decimal(text: str) -> Fraction | float:
    text = text.replace("_", "")
    mantissa, _, exponent = text.lower().partition("e")
    if mantissa.lstrip("+-") in ("inf", "nan") or abs(int(exponent or 0)) > 60 or len(text) > 60:
        return float(text)
    return Fraction(text)
