"""Text of a STEP exchange structure, ISO 10303-21: strings, numbers, header.

The kernel's writer is given only plain marks for names; the real names are put in here, because
the kernel passes control directives in a user's text through, writes raw bytes for other letters
and appends counters. Its numbers are asked for with 17 digits and shortened here to the shortest
text that reads as the same double.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

from pc2cad.errors import KernelError
from pc2cad.export.shortest import holds, shorten, shortest
from pc2cad.trust.names import clean

#: Longest name in characters; the standard allows 256 in the header.
NAME_LIMIT = 200
#: Longest string of the header's description, and how many of them are kept.
LINE_LIMIT = 250
LINES_LIMIT = 40

#: printf format that keeps every double, and one that is short enough for any exponent: the
#: kernel's buffer holds 23 characters.
EXACT_FORMAT = "%#.17G"
SAFE_FORMAT = "%#.16G"
EXACT_RANGE = (1e-99, 1e99)

_NOT_FINITE = re.compile(rb"[(,]\s*-?(?:NAN|INF)|E\+\d{3}")
_COLOUR = re.compile(rb"(COLOUR_RGB\('',)([^)]*)\)")
_MARK = re.compile(rb"'@(\w+)@'")
_SCHEMA = re.compile(rb"FILE_SCHEMA\s*\(\(\s*'([^']*)'\s*\)\)")
_PROCESSOR = re.compile(rb"STEP\s+processor\s+([\d.]+)")


@dataclass(frozen=True)
class Header:
    """What the header section says besides the schema, as plain text."""

    name: str
    description: Sequence[str]
    time_stamp: str
    system: str


def mark(key: str) -> str:
    """Return the mark that stands for the string `key` while the kernel writes."""
    return f"@{key}@"


def one_line(text: str, limit: int = NAME_LIMIT) -> str:
    """Return `text` on one line, without control characters, of at most `limit` characters."""
    return clean(text, limit)


def lines(text: str) -> list[str]:
    """Return the lines of `text`, each short enough for the header; always at least one."""
    found: list[str] = []
    for raw in text.splitlines():
        line = one_line(raw, limit=max(len(raw), 2))
        while len(line) > LINE_LIMIT:
            cut = line.rfind(" ", 1, LINE_LIMIT)
            cut = LINE_LIMIT if cut < 0 else cut
            found.append(line[:cut].rstrip())
            line = line[cut:].lstrip()
        if line:
            found.append(line)
    if len(found) > LINES_LIMIT:
        found = [*found[: LINES_LIMIT - 1], "…"]
    return found or [""]


@lru_cache(maxsize=512)
def string(text: str) -> bytes:
    r"""Return `text` as a quoted string, pure ASCII, that no reader can misunderstand.

    Letters outside ASCII become ``\X2\…\X0\`` (``\X4\`` above U+FFFF) and control characters
    ``\X\hh``. An apostrophe is doubled, but written as ``\X\27`` where a delimiter follows,
    because the kernel's own reader takes ``'',`` for the end of the string.
    """
    encoded: list[str] = []
    for run in re.findall(r"[ -~]+|[\x00-\x1f\x7f]+|[\x80-\uffff]+|[\U00010000-\U0010ffff]+", text):
        first = ord(run[0])
        if 0x20 <= first < 0x7F:
            safe = run.replace("\\", "\\\\").replace("'", "''")
            encoded.append(re.sub(r"''(?![A-Za-z0-9 ])", r"\\X\\27", safe))
        elif first < 0x80:
            encoded.extend(f"\\X\\{ord(letter):02X}" for letter in run)
        elif first < 0x10000:
            units = (ord(letter) for letter in run)
            # half of a pair is no character: U+FFFD stands for it
            words = (0xFFFD if 0xD800 <= unit < 0xE000 else unit for unit in units)
            encoded.append("\\X2\\" + "".join(f"{word:04X}" for word in words) + "\\X0\\")
        else:
            encoded.append("\\X4\\" + "".join(f"{ord(letter):08X}" for letter in run) + "\\X0\\")
    return ("'" + "".join(encoded) + "'").encode("ascii")


def real(text: bytes) -> bytes:
    """Return the shortest text that reads as the same double as `text`.

    >>> real(b"0.10000000000000001"), real(b"1.0000000000000000E-07"), real(b"60.000000000")
    (b'0.1', b'1.E-07', b'60.')
    """
    return shortest([text])[text]


def finish(kernel_text: bytes, strings: Mapping[str, str], header: Header) -> bytes:
    """Turn the kernel's text, full of marks, into the final file.

    Args:
        kernel_text: the whole file as the kernel wrote it.
        strings: text for each mark that was given to the kernel.
        header: contents of the header section.

    Raises:
        KernelError: the text has numbers that are not finite, or marks are missing or unknown.

    """
    schema = _SCHEMA.search(kernel_text)
    start = kernel_text.find(b"DATA;")
    if schema is None or start < 0:
        raise KernelError("the kernel's STEP text has no schema or no data section")
    processor = _PROCESSOR.search(kernel_text, 0, start)
    data = kernel_text[start:]
    # the plain searches are much faster, and nearly always all that is needed
    suspects = b"+" in data or holds(data, b"NAN", 1) or holds(data, b"INF", 2)
    if suspects and _NOT_FINITE.search(data):
        raise KernelError("the solid has coordinates that are not finite; nothing was written")
    data = _name(_shorten(data), strings)
    version = processor.group(1).decode("ascii") if processor else ""
    return _header(header, schema.group(1), f"OCCT {version}".strip()) + data


def _shorten(data: bytes) -> bytes:
    # zeros are the most frequent numbers and need no search
    data = data.replace(b"0.000000000000000,", b"0.,").replace(b"0.000000000000000)", b"0.)")
    return _COLOUR.sub(_colour, shorten(data))


def _colour(found: re.Match[bytes]) -> bytes:
    """Take the noise of the kernel's single-precision colours away."""
    shares = (real(b"%.6f" % float(part)) for part in found.group(2).split(b","))
    return found.group(1) + b",".join(shares) + b")"


def _name(data: bytes, strings: Mapping[str, str]) -> bytes:
    """Put the strings where the kernel left their marks."""
    encoded = {key.encode("ascii"): string(text) for key, text in strings.items()}
    met: set[bytes] = set()

    def replace(found: re.Match[bytes]) -> bytes:
        met.add(found.group(1))
        return encoded[found.group(1)]

    try:
        data = _MARK.sub(replace, data)
    except KeyError as unknown:
        raise KernelError(f"the kernel's STEP text has an unknown mark {unknown}") from None
    if len(met) != len(encoded):
        lost = sorted(key.decode("ascii") for key in set(encoded) - met)
        raise KernelError(f"the kernel did not write these names into the STEP file: {lost}")
    return data


def _header(header: Header, schema: bytes, preprocessor: str) -> bytes:
    description = b",\n  ".join(string(line) for line in header.description)
    return b"".join(
        (
            b"ISO-10303-21;\nHEADER;\n",
            b"FILE_DESCRIPTION((" + description + b"),'2;1');\n",
            b"FILE_NAME(" + string(header.name) + b"," + string(header.time_stamp) + b",\n",
            b"  (''),('')," + string(preprocessor) + b"," + string(header.system) + b",'');\n",
            b"FILE_SCHEMA(('" + schema + b"'));\nENDSEC;\n",
        )
    )
