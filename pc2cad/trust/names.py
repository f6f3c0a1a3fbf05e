"""Names: which may stand where, and how texts from outside are shown and stored.

Titles, names and paths come from templates, options and folders that somebody else may have made.
What names something in the language or in a file is checked here when it is read; free texts are
cleaned here; and here are the escapes that files and terminals are written with.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from functools import lru_cache
from typing import Final

from pc2cad.errors import InputError

#: longest name of a layer and of a file, in characters and in bytes
LONGEST_LABEL: Final = 64
LONGEST_FILE_NAME: Final = 255
LABEL_RULE: Final = "a letter, then letters, digits, spaces and _ . + -, 64 characters at most"

_IDENTIFIER: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
_LABEL: Final = re.compile(r"[^\W\d_](?:[\w.+-]|[ ](?![ ]))*(?<![ .])")
_ENDING: Final = re.compile(r"[a-z0-9]{1,16}")
#: what Windows takes for a device, whatever its ending
_DEVICE: Final = re.compile(r"(?:con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³])(?:\..*)?", re.IGNORECASE)
_FORMULA: Final = ("=", "+", "-", "@", "\t", "\r", "＝", "＋", "－", "＠")


class NameNotAllowedError(InputError):
    """A name has characters, a form or a length that names of its kind must not have."""


# -- checks ----------------------------------------------------------------------------------------


def is_identifier(name: str) -> bool:
    """Say whether expressions may use a name: of parameters, points, curves, bodies and [let]."""
    return _IDENTIFIER.fullmatch(name) is not None


def is_label(name: str) -> bool:
    """Say whether files and tables may show a name as it is: that of a layer (`LABEL_RULE`)."""
    return len(name) <= LONGEST_LABEL and name.isprintable() and _LABEL.fullmatch(name) is not None


def check_file_name(name: str) -> str:
    """Return the name of a file in a folder of ours; raise NameNotAllowedError for any other.

    It has one part, so that the file is in that folder, and no form that a system in use takes for
    something else: a device, a hidden file, an option of a command.
    """
    if (
        not name.isprintable()
        or not name.strip(" .") == name != ""
        or set(name) & set('/\\:*?"<>|')
        or name.startswith("-")
        or _DEVICE.fullmatch(name)
        or len(name.encode()) > LONGEST_FILE_NAME
    ):
        raise NameNotAllowedError(
            f"{visible(name)[:80]!r} cannot be the name of a file here: letters, digits, "
            "spaces and _ . + = - only, no folder, 255 bytes at most"
        )
    return name


def is_ending(text: str) -> bool:
    """Say whether a text may be the ending of a file's name, without its dot."""
    return _ENDING.fullmatch(text) is not None


# -- free texts ------------------------------------------------------------------------------------


def clean(text: str, limit: int | None = None) -> str:
    """Return a text on one line of printable characters, at most `limit` of them.

    Runs of spaces, line ends and control characters become one space; characters that only direct
    how others are shown (bidirectional marks, joiners) go; what is no character of Unicode, halves
    of pairs included, becomes U+FFFD.
    """
    return _cleaned(text, limit) if len(text) > LONGEST_KEPT else _kept(text, limit)


def _cleaned(text: str, limit: int | None) -> str:
    if not text.isprintable():
        text = "".join(c if c.isprintable() else _substitute(c) for c in text)
    line = " ".join(text.split())
    if limit is None or len(line) <= limit:
        return line
    return line[: limit - 1].rstrip() + "…"


#: titles and names are asked for anew by each variant; longer texts are not kept
LONGEST_KEPT: Final = 256
_kept: Final = lru_cache(maxsize=256)(_cleaned)


def clean_lines(text: str) -> str:
    """Return a text of several lines, each as `clean` leaves it."""
    return "\n".join(clean(line) for line in text.splitlines())


def _substitute(character: str) -> str:
    from unicodedata import category

    kind = category(character)
    return {"Cf": "", "Cs": "\ufffd", "Cn": "\ufffd", "Co": "\ufffd"}.get(kind, " ")


# -- escapes ---------------------------------------------------------------------------------------


def visible(text: str) -> str:
    r"""Return a text for a terminal, what is not printable, line ends too, as ``\n``, ``\x1b``."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def percent(
    text: str,
    unsafe: str,
    *,
    limit: int,
    plain: bool = True,
    words: Collection[str] = (),
) -> str:
    """Return a text in which ``%``, `unsafe` and control characters are ``%XX``, byte by byte.

    That is the escape of addresses: `urllib.parse.unquote` gives the text back, unless it was cut
    at `limit` bytes. `plain` makes it ASCII; of the `words`, which the format's readers take for
    their own wherever they stand, the first letter is escaped.
    """
    starts = {m.start() for word in words for m in re.finditer(re.escape(word), text, re.I)}
    result, size = [], 0
    for place, c in enumerate(text):
        keeps = c.isprintable() and c not in unsafe and c != "%" and (c.isascii() or not plain)
        raw = c.encode("utf-8", "replace")
        piece = c if keeps and place not in starts else "".join(f"%{byte:02X}" for byte in raw)
        size += len(piece.encode())
        if size > limit:
            break
        result.append(piece)
    return "".join(result)


def told_apart(
    names: Iterable[str], limit: int, unsafe: str = "", *, plain: bool = True
) -> dict[str, str]:
    """Return `percent` of each name; those that are cut and become one differ by a number."""
    used: set[str] = set()
    found: dict[str, str] = {}
    for name in dict.fromkeys(names):
        number, text = 1, percent(name, unsafe, limit=limit, plain=plain)
        while text in used:
            number += 1
            end = f"~{number}"
            text = percent(name, unsafe, limit=limit - len(end), plain=plain) + end
        used.add(text)
        found[name] = text
    return found


def words(names: Iterable[str], taken: Iterable[str] = (), longest: int = 72) -> dict[str, str]:
    """Return for each name one of ASCII letters, digits and underscores that begins with a letter.

    ``u=-1`` becomes ``u_m1``, a letter outside ASCII its number in hexadecimal digits. They differ
    from one another, and from what is `taken`, in more than capitals.
    """
    used = {word.lower() for word in taken}
    found: dict[str, str] = {}
    for name in dict.fromkeys(names):
        text = re.sub(r"-(?=[\d.])", "m", name)
        text = re.sub(r"[^\x00-\x7f]", lambda m: f"_{ord(m[0]):X}_", text)
        text = re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_")[:longest]
        text = text if text[:1].isalpha() else f"N_{text}".rstrip("_")
        number, word = 1, text
        while word.lower() in used:
            number += 1
            word = f"{text}_{number}"
        used.add(word.lower())
        found[name] = word
    return found


def cell(text: str) -> str:
    """Return a text for a cell of a table: one line that no spreadsheet takes for a formula.

    Where it would, an apostrophe stands before it, as one types it there.
    """
    line = clean(text)
    return f"'{line}" if line.startswith(_FORMULA) else line
