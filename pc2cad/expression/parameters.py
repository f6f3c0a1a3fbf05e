"""The three parameters of a point equation M(u, v, w), in their order."""

from __future__ import annotations

from typing import Final

PARAMETERS: Final = ("u", "v", "w")
