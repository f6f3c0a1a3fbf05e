"""The page: one HTML file that needs no network."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from typing import Any

#: bare names that the page's script imports, and the files behind them
LIBRARY = {
    "three": "three.module.min.js",
    "three/addons/controls/OrbitControls.js": "OrbitControls.js",
    **{
        f"pc2cad/{name}": f"{name}.js"
        for name in ("part", "stage", "views", "section", "measure", "panel")
    },
}

#: what a file's name does without
_WORD = re.compile(r"[^A-Za-z0-9]+")


@dataclass(frozen=True)
class Slider:
    """A parameter that the page lets vary: over precomputed values, or live between limits."""

    name: str
    about: str
    #: value at which the page opens
    value: float
    #: precomputed values, ascending; empty when the page is served live
    values: tuple[float, ...] = ()
    low: float = 0.0
    high: float = 1.0


@dataclass(frozen=True)
class Variant:
    """What stands behind one position of the sliders: a payload, or why there is none."""

    data: bytes | None
    problem: str = ""


def page(
    title: str,
    sliders: Sequence[Slider],
    variants: Sequence[Variant],
    live: bool,
    files: Sequence[str] = (),
) -> bytes:
    """Return the page.

    `variants` are in the order of the sliders' values, the last slider fastest; a page that is
    served live has one, for the values at which it opens. `files` are the endings of the files that
    its server writes.
    """
    scripts = [
        f'<script type="application/octet-stream" id="variant-{i}">{_text(variant.data)}</script>'
        for i, variant in enumerate(variants)
        if variant.data is not None
    ]
    state = {
        "live": live,
        "name": _WORD.sub("-", title).strip("-").lower()[:60] or "part",
        "files": list(files),
        "sliders": [vars(slider) for slider in sliders],
        "problems": {i: v.problem for i, v in enumerate(variants) if v.data is None},
    }
    parts = {
        "TITLE": escape(title),
        "CONNECT": "'self'" if live else "'none'",
        "STYLE": _asset("page.css"),
        "LIBRARY": _json({"imports": {name: _url(file) for name, file in LIBRARY.items()}}),
        "STATE": _json(state),
        "VARIANTS": "\n".join(scripts),
        "LICENCE": _asset("LICENSE-three.txt").replace("--", "- -"),
        "SCRIPT": _asset("page.js"),
    }
    pieces = _asset("page.html").split("@@")
    # names and texts stand in turn, so that no text is searched for another's name
    return "".join(parts[p] if i % 2 else p for i, p in enumerate(pieces)).encode()


def _asset(name: str) -> str:
    return files("pc2cad.viewer").joinpath("assets", name).read_text(encoding="utf-8")


def _url(name: str) -> str:
    return f"data:text/javascript;base64,{_text(_asset(name).encode())}"


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode()


def _json(value: Any) -> str:
    """Return JSON that cannot end the script it stands in."""
    return json.dumps(value, allow_nan=False).replace("<", "\\u003c")
