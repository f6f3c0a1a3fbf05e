"""CQ-editor itself, on an X server without a screen; run as a script in a process of its own."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any


def render_in_cq_editor(script: Path, times: int, picture: Path) -> dict[str, Any]:
    """Render a script several times in one window.

    Tracebacks, objects shown, CPU seconds from the run to what is seen, and a picture.
    """
    command = [
        "xvfb-run", "-a", "-s", "-screen 0 1280x900x24",
        sys.executable, __file__, str(script), str(times), str(picture),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    found: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return found


def installed() -> bool:
    """Whether CQ-editor and an X server are here."""
    from importlib.util import find_spec

    return bool(shutil.which("xvfb-run")) and find_spec("cq_editor") is not None


def main(script: str, times: str, picture: str) -> None:
    import os

    os.environ.setdefault("QT_QPA_PLATFORM", "xcb")
    from cq_editor.__main__ import MainWindow
    from PyQt5.QtWidgets import QApplication

    application = QApplication([])
    application.setApplicationName("CQ-editor")
    window = MainWindow(filename=script)
    window.show()
    tracebacks: list[str] = []
    window.components["debugger"].sigTraceback.connect(
        lambda error, _: tracebacks.append(repr(error)) if error is not None else None
    )
    viewer = window.components["viewer"]
    counts, seconds = [], []
    for _ in range(int(times)):
        begun = time.process_time()
        window.components["debugger"].render()
        application.processEvents()
        viewer._get_view().Redraw()
        seconds.append(time.process_time() - begun)
        counts.append(window.components["object_tree"].CQ.childCount())
    viewer.fit()
    application.processEvents()
    viewer._get_view().Dump(picture)
    sys.stdout.write(
        "\n" + json.dumps({"tracebacks": tracebacks, "objects": counts, "seconds": seconds}) + "\n"
    )
    sys.stdout.flush()
    os._exit(0)  # the window asks whether to quit


if __name__ == "__main__":
    main(*sys.argv[1:])
