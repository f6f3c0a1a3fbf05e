"""What FreeCAD finds in STEP files; its Python is reached through freecadcmd only."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

_SCRIPT = """
import json, sys
import Part
found = {}
for path in json.load(open(PATHS)):
    try:
        shape = Part.read(path)
        complaint = ""
        try:
            shape.check(True)  # with the Boolean checker, which is stricter
        except Exception as error:
            # a rational circle is C0 in its parameter and smooth in space: no fault
            text = str(error) or repr(error)
            said = [line.strip() for line in text.splitlines() if "GeomAbs_C0" not in line]
            lines = [line for line in said if line and "found the following" not in line]
            complaint = "; ".join(lines)
        found[path] = {"valid": shape.isValid() and not complaint, "complaint": complaint[:500],
                       "volume": shape.Volume, "solids": len(shape.Solids),
                       "shells": len(shape.Shells), "faces": len(shape.Faces)}
    except Exception as error:
        found[path] = {"valid": False, "complaint": repr(error)[:500]}
json.dump(found, open(RESULT, "w"))
"""


def freecad() -> str | None:
    """The command, or None where it is not installed."""
    return next((c for c in ("freecadcmd", "FreeCADCmd") if shutil.which(c)), None)


def read_in_freecad(paths: list[Path], folder: Path) -> list[dict[str, Any]]:
    """Read files in one process: validity, complaint, volume (mm³) and counts of each."""
    listed, result, script = (folder / name for name in ("in.json", "out.json", "read.py"))
    listed.write_text(json.dumps([str(path) for path in paths]))
    script.write_text(f"PATHS, RESULT = {str(listed)!r}, {str(result)!r}\n{_SCRIPT}")
    subprocess.run(
        [freecad() or "", "-c", f"exec(open({str(script)!r}).read())"],
        capture_output=True, text=True, timeout=400, check=True, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    return list(json.loads(result.read_text()).values())
