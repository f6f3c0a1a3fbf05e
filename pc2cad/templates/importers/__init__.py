"""Importers: files of strangers to texts of templates, read as data, within limits."""

from __future__ import annotations

from typing import Final

#: what `pc2cad new --from` takes, for its help and its messages
FORMS: Final = (
    "vmec:FILE (an input file of VMEC), airfoil:FILE (coordinates, .dat), points:FILE (a net, "
    ".csv), template:NAME (a copy of a shipped one)"
)
#: how layers on a boundary are measured: in the planes of its sections, or along its normal
MEASURED: Final = ("plane", "normal")
