"""What `pc2cad new --from` takes: a kind, and the file that it is read from."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from pc2cad.equation.language import nearest
from pc2cad.errors import InputError
from pc2cad.templates.file import read_template_text
from pc2cad.templates.importers import FORMS
from pc2cad.templates.importers.airfoil import import_airfoil
from pc2cad.templates.importers.net import import_points
from pc2cad.templates.importers.vmec import import_vmec
from pc2cad.templates.shipped import find_template
from pc2cad.trust.names import visible

#: layers of one solid
MOST_LAYERS: Final = 64


def import_template(name: str) -> str:
    """Return the text of a shipped template, or of a template's file."""
    return read_template_text(find_template(name))


#: kind -> what reads it, and the options that it has
KINDS: Final[dict[str, tuple[Callable[..., str], tuple[str, ...]]]] = {
    "vmec": (import_vmec, ("layers", "measured", "periods")),
    "airfoil": (import_airfoil, ("span",)),
    "points": (import_points, ()),
    "template": (import_template, ()),
}


def imported(source: str, options: Mapping[str, Any]) -> str:
    """Return the text of a template from ``kind:file``; raise InputError for what is no such."""
    kind, colon, file = source.partition(":")
    if kind not in KINDS or not colon or not file:
        raise InputError(
            f"--from is {FORMS}; '{visible(source)[:60]}' is none of them{nearest(kind, KINDS)}"
        )
    read, known = KINDS[kind]
    for name in options:
        if name not in known:
            raise InputError(f"--{name} has no meaning for --from {kind}:…")
    return read(file, **options)


def layers_of(text: str) -> dict[str, float | str]:
    """Return names and thicknesses of ``wall=0.1,blanket=thick(u, v)``; raise InputError."""
    found: dict[str, float | str] = {}
    for part in _parted(text):
        name, equals, thickness = (piece.strip() for piece in part.partition("="))
        if not equals or not name or not thickness:
            raise InputError(
                f"layers are written name=thickness,name=thickness, and '{visible(part)[:60]}' "
                "is none"
            )
        if name in found:
            raise InputError(f"two layers have the name '{visible(name)[:60]}'")
        try:
            found[name] = float(thickness)
        except ValueError:
            found[name] = thickness  # an expression in u and v, which the template's reader checks
        if len(found) > MOST_LAYERS:
            raise InputError(f"there are more than {MOST_LAYERS} layers")
    return found


def _parted(text: str) -> list[str]:
    """Return what stands between the commas that are in no brackets."""
    parts, depth = [""], 0
    for character in text:
        depth += (character in "([") - (character in ")]")
        if character == "," and depth <= 0:
            parts.append("")
        else:
            parts[-1] += character
    return parts
