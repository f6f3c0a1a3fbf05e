"""A look at the text of a template before it is parsed, and at what was parsed before it is read.

Parsers of TOML take quadratic time and memory for keys of many parts, and a level of their own
stack for every bracket. One pass over the text, which knows strings and comments and nothing else,
refuses such texts first.
"""

from __future__ import annotations

import re
from typing import Any, Final

from pc2cad.expression.tree import LARGEST_CONSTANT
from pc2cad.templates.header import TemplateError
from pc2cad.templates.tables import shown

#: parts of a key, a.b.c; brackets within brackets
MOST_PARTS: Final = 8
DEEPEST: Final = 32

_TOKEN: Final = re.compile(
    r"(?P<blank>[ \t]++)"
    r"|(?P<key>[A-Za-z0-9_-]++)"
    r"|(?P<dot>\.)"
    r"|(?P<comment>\#[^\n]*+)"
    r'|(?P<text>"{3}(?s:[^\\"]|\\.|"{1,2}+(?!"))*+"{3,5}'
    r"|'{3}(?:[^']|'{1,2}+(?!'))*+'{3,5}"
    r'|(?:"(?!"")(?:[^\\"\n]|\\.)*+"|' + r"'(?!'')[^'\n]*+'))"
    r"|(?P<open>[\[{])"
    r"|(?P<close>[\]}])"
    r"|(?P<other>[^][{}.#\"'A-Za-z0-9_ \t-]++)"
    r"|(?P<stray>[\"'])"
)


def check_text(text: str, file: str) -> None:
    """Raise TemplateError for a TOML text with longer keys or more brackets than the format has.

    Takes time and memory that go with the text's length. What comes after a mistake in the text is
    not looked at: a parser does not get there either.
    """
    if not _may_be_deep(text):
        return
    parts = depth = 0
    dotted = False
    for token in _TOKEN.finditer(text):
        kind = token.lastgroup
        if kind == "blank":
            continue
        if kind == "stray":  # a text without an end, where a parser ends as well
            return
        if kind in ("key", "text"):
            parts = parts + 1 if dotted else 1
            if parts > MOST_PARTS:
                raise _at(file, text, token, f"a key has more than {MOST_PARTS} parts")
        elif kind == "open":
            depth += 1
            if depth > DEEPEST:
                raise _at(file, text, token, f"brackets are nested deeper than {DEEPEST}")
        elif kind == "close":
            depth -= 1
        dotted = kind == "dot"


def _may_be_deep(text: str) -> bool:
    """Say whether a text has brackets, or points on one line, enough for what is refused.

    Where strings have several lines, keys may.
    """
    return (
        text.count("[") + text.count("{") > DEEPEST
        or any(line.count(".") >= MOST_PARTS for line in text.split("\n"))
        or '"""' in text
        or "'''" in text
    )


def _at(file: str, text: str, token: re.Match[str], what: str) -> TemplateError:
    line = text.count("\n", 0, token.start()) + 1
    return TemplateError(f"{file}: line {line}: {what}: the format goes no deeper than four")


def check_numbers(data: dict[str, Any], file: str) -> None:
    """Raise TemplateError for a whole number that is larger than any constant may be.

    They are let in as hexadecimal numbers of any length, and could not even be printed.
    """
    if _has_giant(data):
        where = next(key for key, value in data.items() if _has_giant({key: value}))
        raise TemplateError(
            f"{file}: {shown(where)}: a whole number is larger than any constant may be, 1e60"
        )


def _has_giant(data: dict[str, Any]) -> bool:
    stack: list[Any] = [data]
    while stack:
        value = stack.pop()
        for inner in value.values() if isinstance(value, dict) else value:
            if isinstance(inner, (dict, list)):
                stack.append(inner)
            elif isinstance(inner, int) and abs(inner) > LARGEST_CONSTANT:
                return True
    return False


_PLACE: Final = re.compile(r"\(at line (\d+), column (\d+)\)")
#: what stands between a value's beginning and its end, outside quotes
_EXPRESSION: Final = re.compile(r"[A-Za-z0-9_.+*/^()<>, -]*[A-Za-z+*/^(][A-Za-z0-9_.+*/^()<>, -]*")


def unquoted_expression(text: str, error: str) -> str:
    """Return what is wrong where a parser of TOML stopped at an expression without quotes, or ''.

    `error` is the parser's sentence, which ends with the place.
    """
    place = _PLACE.search(error)
    if place is None:
        return ""
    number, column = int(place[1]), int(place[2])
    line = text.split("\n")[number - 1][:200]
    start = max(line.rfind(mark, 0, column) for mark in "=[{,") + 1
    value = line[start:].partition("#")[0]
    alone = line[start - 1 : start] == "=" and "{" not in line[:start]
    value = (value if alone else re.split(r"[],}]", value)[0]).strip()
    if not _EXPRESSION.fullmatch(value) or (start and "=" not in line[:start]):
        return ""
    key = shown(line[:start]) + " " if alone else ""
    return f'line {number}: an expression stands in quotes: {key}"{value}"'
