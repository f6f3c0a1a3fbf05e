"""Voxels as a stack of pictures: PNG, one across z each, in one .zip or within a 3MF file.

The first row of a picture is the one with the largest y, as one sees it from above. Numbers of a
field take 16 bits, from its least to its largest value.
"""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from typing import TYPE_CHECKING

import numpy as np

from pc2cad.arrays import AnyArray, Array

if TYPE_CHECKING:
    from pc2cad.sampling.voxels import Voxels

#: the earliest time that a .zip can hold: the same part gives the same bytes
_TIME = (1980, 1, 1, 0, 0, 0)


def stack(voxels: Voxels, units: str) -> bytes:
    """Return a .zip of pictures across z, from below: ``inside/0000.png`` and a folder per field.

    ``slices.json`` tells the voxels' size and place, and the values that 0 and 65535 stand for.
    """
    about = {
        "units": units, "voxel": voxels.step, "low": voxels.low,
        "columns_rows_sheets": voxels.inside.shape[::-1],
        "fields": {
            name: dict(zip(("low", "high"), limits(rows), strict=True))
            for name, rows in voxels.values.items()
        },
    }  # fmt: skip
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        _add(archive, "slices.json", f"{json.dumps(about, indent=2)}\n".encode())
        for k, sheet in enumerate(voxels.inside):
            _add(archive, f"inside/{k:04}.png", png(sheet[::-1].astype(np.uint8) * 255))
        for name, rows in voxels.values.items():
            for k, sheet in enumerate(sheets(rows, *limits(rows))):
                _add(archive, f"{name}/{k:04}.png", png(sheet))
    return stream.getvalue()


def _add(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    archive.writestr(zipfile.ZipInfo(name, _TIME), data)


def limits(values: Array) -> tuple[float, float]:
    """Return the values that 0 and 65535 stand for."""
    return float(values.min()), float(values.max())


def sheets(values: Array, low: float, high: float) -> AnyArray:
    """Return values as pictures of 16 bits, the lowest first and each with its last row first.

    0 and 65535 stand for `low` and `high`.
    """
    share = (values - low) / (high - low) if high > low else np.zeros_like(values)
    return np.asarray(np.round(65535 * share).astype(np.uint16)[:, ::-1])


def png(rows: AnyArray) -> bytes:
    """Return a grey picture of 8 or 16 bits as PNG (ISO/IEC 15948)."""
    height, width = rows.shape
    depth = 8 * rows.dtype.itemsize
    raw = np.ascontiguousarray(rows, dtype=rows.dtype.newbyteorder(">")).view(np.uint8)
    lines = np.concatenate((np.zeros((height, 1), dtype=np.uint8), raw.reshape(height, -1)), axis=1)
    chunks = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, depth, 0, 0, 0, 0)),
        (b"IDAT", zlib.compress(lines.tobytes(), 9)),
        (b"IEND", b""),
    )
    parts = [b"\x89PNG\r\n\x1a\n"]
    for name, data in chunks:
        parts.append(struct.pack(">I", len(data)) + name + data)
        parts.append(struct.pack(">I", zlib.crc32(name + data)))
    return b"".join(parts)
