"""Text of a STEP exchange structure, ISO 10303-21, to records: strict and bounded.

Every instance is read, whether anything refers to it or not; nothing is repaired. What exceeds the
limits below is refused before it costs memory.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pc2cad.trust.files import FileNotReadError, read_regular
from pc2cad.verify.defects import StepUnreadableError

#: bytes of a file, instances in it, lists within lists, characters of a number, and its size
LARGEST_FILE: Final = 1 << 29
MOST_INSTANCES: Final = 4_000_000
DEEPEST: Final = 16
LONGEST_NUMBER: Final = 64
LARGEST_NUMBER: Final = 1e100
LARGEST_ID: Final = 10**15

# a comment ends at its first '*/' and nowhere else, so that there is one way to match it
_SPACE = r"(?:\s|/\*(?:[^*]|\*(?!/))*\*/)*"
_REAL = r"[+-]?\d+\.\d*(?:E[+-]?\d+)?"
#: one of no more than `LONGEST_NUMBER` characters
_SHORT = r"[+-]?\d{1,25}\.\d{0,30}(?:E[+-]?\d{1,3})?"
_TOKEN = re.compile(
    rf"{_SPACE}(?:(?P<number>[+-]?\d+(?:\.\d*(?:E[+-]?\d+)?)?)|#(?P<ref>\d+)|"
    r"(?P<mark>[(),;=$*])|'(?P<text>(?:[^'\x00-\x08\x0b\x0c\x0e-\x1f]|'')*)'|"
    r"\.(?P<enum>[A-Z_][A-Z0-9_]*)\.|(?P<word>!?[A-Z_][A-Z0-9_\-]*)|\"(?P<binary>[0-9A-F]*)\")",
    re.DOTALL,
)
#: most instances of a file: a point or a direction without a name
_POINT = re.compile(
    rf"\s*#(\d{{1,15}})\s*=\s*(CARTESIAN_POINT|DIRECTION)\s*\(\s*''\s*,\s*"
    rf"\(\s*({_SHORT})\s*,\s*({_SHORT})\s*(?:,\s*({_SHORT})\s*)?\)\s*\)\s*;"
)
#: and most lists: poles by their numbers, and knots or weights
_REFERENCES = re.compile(r"\s*\(\s*#\d{1,15}(?:\s*,\s*#\d{1,15})*\s*\)")
_REALS = re.compile(rf"\s*\(\s*{_REAL}(?:\s*,\s*{_REAL})*\s*\)")
_DIRECTIVE = re.compile(
    r"\\X2\\((?:[0-9A-Fa-f]{4})*)\\X0\\|\\X4\\((?:[0-9A-Fa-f]{8})*)\\X0\\|"
    r"\\X\\([0-9A-Fa-f]{2})|\\S\\(.)|\\P[A-I]\\|(\\\\)"
)


class Ref(int):
    """A reference to an instance; printed as in the file."""

    def __str__(self) -> str:
        """Return it as the file writes it."""
        return f"#{int(self)}"

    __repr__ = __str__


class Enumeration(str):
    """The name of an enumeration, without its points."""


@dataclass(frozen=True)
class Typed:
    """A parameter with the name of its type."""

    name: str
    values: tuple[Any, ...]


#: the parameter '*', which is derived in a subtype
DERIVED: Final = Enumeration("*")
#: keyword of each partial entity -> its parameters; simple instances have one
Parts = dict[str, tuple[Any, ...]]


@dataclass(frozen=True)
class Exchange:
    """The header's records and all instances of a file."""

    header: Parts
    instances: dict[int, Parts]


def read_exchange(path: str | os.PathLike[str]) -> Exchange:
    """Read a file; raise StepUnreadableError where it is no exchange structure or too large."""
    return parse_exchange(read_bytes(path))


def read_bytes(path: str | os.PathLike[str]) -> bytes:
    """Return the bytes of a regular file of a bounded size."""
    try:
        return read_regular(Path(path), LARGEST_FILE)
    except FileNotReadError as error:
        raise StepUnreadableError(f"{os.fspath(path)}: {error}") from error


def parse_exchange(data: bytes) -> Exchange:
    """Return the records of an exchange structure; raise StepUnreadableError."""
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise StepUnreadableError(f"not the text of a STEP file (byte {error.start})") from error
    reader = _Reader(text)
    try:
        return reader.file()
    except RecursionError as error:  # pragma: no cover - lists are counted
        raise StepUnreadableError("lists are nested too deeply") from error


class _Reader:
    """Reads tokens from left to right."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        #: the instances that others refer to
        self._wanted: set[int] = set()

    def fail(self, what: str) -> StepUnreadableError:
        line = self._text.count("\n", 0, self._at) + 1
        near = " ".join(self._text[self._at : self._at + 40].split())
        return StepUnreadableError(f"line {line}: {what}" + (f", near '{near}'" if near else ""))

    def file(self) -> Exchange:
        self._literal("ISO-10303-21")
        self._literal("HEADER")
        header: Parts = {}
        while not self._ends("ENDSEC"):
            word = self._word()
            header[word] = self._list()
            self._mark(";")
        if "FILE_SCHEMA" not in header:
            raise self.fail("the header has no FILE_SCHEMA")
        instances: dict[int, Parts] = {}
        self._wanted.clear()
        self._literal("DATA")
        self._data(instances)
        while not self._ends("END-ISO-10303-21"):
            self._literal("DATA")
            self._data(instances)
        if self._text[self._at :].strip():
            raise self.fail("text after the end of the file")
        missing = self._wanted - instances.keys()
        if missing:
            raise StepUnreadableError(
                f"the file refers to #{min(missing)}, which it does not contain"
                + (f" (and to {len(missing) - 1} more)" if len(missing) > 1 else "")
            )
        return Exchange(header, instances)

    def _data(self, instances: dict[int, Parts]) -> None:
        while True:
            self._points(instances)
            if self._ends("ENDSEC"):
                return
            token = self._next()
            if token.lastgroup != "ref":
                raise self.fail(f"'#' and a number are needed, not '{token.group().strip()[:20]}'")
            self._mark("=")
            self._add(instances, self._id(token["ref"]), self._parts())

    def _points(self, instances: dict[int, Parts]) -> None:
        """Read points and directions, as long as one follows another."""
        match, text = _POINT.match, self._text
        while found := match(text, self._at):
            key, word, x, y, z = found.groups()
            row = (float(x), float(y)) if z is None else (float(x), float(y), float(z))
            if max(row) > LARGEST_NUMBER or min(row) < -LARGEST_NUMBER:
                raise self.fail("a number that is too large")
            self._add(instances, self._id(key), {word: ("", row)})
            self._at = found.end()

    def _add(self, instances: dict[int, Parts], key: int, parts: Parts) -> None:
        if key in instances:
            raise self.fail(f"#{key} is there twice")
        if len(instances) >= MOST_INSTANCES:
            raise StepUnreadableError(f"more than {MOST_INSTANCES} instances")
        instances[key] = parts

    def _parts(self) -> Parts:
        token = self._next()
        if token.lastgroup == "word":
            parts = {token["word"]: self._list()}
        elif token["mark"] == "(":
            parts = {}
            while (token := self._next()).lastgroup == "word":
                if token["word"] in parts:
                    raise self.fail(f"{token['word']} is there twice")
                parts[token["word"]] = self._list()
            if token["mark"] != ")" or not parts:
                raise self.fail("a complex instance that is not closed")
        else:
            raise self.fail("the name of an entity is needed")
        self._mark(";")
        return parts

    def _list(self, depth: int = 0, *, opened: bool = False) -> tuple[Any, ...]:
        """Read a list in brackets."""
        if depth > DEEPEST:
            raise self.fail(f"lists nested more than {DEEPEST} deep")
        # a list that has been opened begins where its bracket is
        begin = self._at - opened
        for pattern, read in ((_REFERENCES, self._references), (_REALS, self._reals)):
            found = pattern.match(self._text, begin)
            if found:
                values = read(found.group().strip()[1:-1])
                self._at = found.end()
                return values
        if not opened:
            self._mark("(")
        items: list[Any] = []
        token = self._next()
        if token["mark"] == ")":
            return ()
        while True:
            items.append(self._value(token, depth))
            token = self._next()
            if token["mark"] == ")":
                return tuple(items)
            if token["mark"] != ",":
                raise self.fail("',' or ')' is needed")
            token = self._next()

    def _value(self, token: re.Match[str], depth: int) -> Any:
        match token.lastgroup:
            case "ref":
                return self._reference(token["ref"])
            case "number":
                return self._number(token["number"])
            case "text":
                return _decoded(token["text"])
            case "enum":
                return Enumeration(token["enum"])
            case "word":
                return Typed(token["word"], self._list(depth + 1))
            case "binary":
                return token["binary"]
        match token["mark"]:
            case "$":
                return None
            case "*":
                return DERIVED
            case "(":
                return self._list(depth + 1, opened=True)
        raise self.fail(f"a value is needed, not '{token['mark']}'")

    def _number(self, text: str) -> int | float:
        if "." in text:
            return self._reals(text)[0]
        if len(text) > 18:
            raise self.fail("a whole number of more than 18 digits")
        return int(text)

    def _reals(self, row: str) -> tuple[float, ...]:
        texts = row.split(",")
        if max(map(len, texts)) > LONGEST_NUMBER:
            texts = [text.strip() for text in texts]
        if max(map(len, texts)) <= LONGEST_NUMBER:
            values = tuple(map(float, texts))
            if max(map(abs, values)) <= LARGEST_NUMBER:
                return values
        raise self.fail("a number that is too large")

    def _references(self, row: str) -> tuple[Ref, ...]:
        found = tuple(map(Ref, row.replace("#", "").split(",")))
        if not min(found) > 0:
            raise self.fail("an instance's number that is out of range")
        self._wanted.update(found)
        return found

    def _reference(self, text: str) -> Ref:
        found = Ref(self._id(text))
        self._wanted.add(found)
        return found

    def _id(self, text: str) -> int:
        if len(text) > 15 or not 0 < int(text) < LARGEST_ID:
            raise self.fail("an instance's number that is out of range")
        return int(text)

    def _next(self) -> re.Match[str]:
        found = _TOKEN.match(self._text, self._at)
        if found is None:
            ended = not self._text[self._at :].strip()
            raise self.fail("the file ends too early" if ended else "no token of a STEP file")
        self._at = found.end()
        return found

    def _word(self) -> str:
        token = self._next()
        if token.lastgroup != "word":
            raise self.fail("a keyword is needed")
        return token["word"]

    def _mark(self, mark: str) -> None:
        if self._next()["mark"] != mark:
            raise self.fail(f"'{mark}' is needed")

    def _ends(self, word: str) -> bool:
        """Say whether a section ends here, and go past the word and its ';' if so."""
        found = _TOKEN.match(self._text, self._at)
        if found is None or found["word"] != word:
            return False
        self._at = found.end()
        self._mark(";")
        return True

    def _literal(self, word: str) -> None:
        found = _TOKEN.match(self._text, self._at)
        if found is None or found["word"] != word:
            raise self.fail(f"'{word};' is needed")
        self._at = found.end()
        self._mark(";")


def _decoded(text: str) -> str:
    """Return a string without the control directives of ISO 10303-21."""
    text = re.sub(r"\s*\n\s*", "", text).replace("''", "'")
    return _DIRECTIVE.sub(_letters, text) if "\\" in text else text


def _letters(found: re.Match[str]) -> str:
    words, longs, byte, shifted, slash = found.groups()
    if words is not None:
        return bytes.fromhex(words).decode("utf-16-be", "replace")
    if longs is not None:
        return bytes.fromhex(longs).decode("utf-32-be", "replace")
    if byte is not None:
        return chr(int(byte, 16))
    if shifted is not None:
        return chr((ord(shifted) + 128) % 0x110000)
    return "\\" if slash else ""
