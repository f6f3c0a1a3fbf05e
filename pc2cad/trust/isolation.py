"""Where code may come from: never from the folder in which somebody happens to stand.

Python puts that folder first on its path for ``-m`` and ``-c``, and for every empty or relative
entry of PYTHONPATH; a file ``json.py`` in a folder of templates would be run. This module imports
only what Python has loaded before it looks anywhere (`sys`, and `os`, which is frozen), since all
else would come from there. Hence no `from __future__` either.
"""

import os
import sys

#: where the kernel would look for its messages; without a folder it takes the current one
_MESSAGES = ("CSF_XSMessage", "CSF_SHMessage")
#: begins a process that imports from where its parent does, and takes pc2cad from the same place:
#: `path` without the current folder, unless Python itself, told to leave it out, looks there
_BEGIN = """\
import os, sys
path, home, module = {path!r}, {home!r}, {module!r}
try:
    here = os.path.realpath(os.getcwd())
except OSError:
    here = None
sys.path[:] = [p for p in path if p in sys.path or os.path.realpath(p) != here]
from importlib import import_module
from importlib.machinery import PathFinder
from importlib.util import module_from_spec
spec = PathFinder.find_spec("pc2cad", [home])
package = sys.modules["pc2cad"] = module_from_spec(spec)
spec.loader.exec_module(package)
import_module(module).main()
"""


def is_command() -> bool:
    """Say whether this process is the command: ``pc2cad``, or ``python -m pc2cad``."""
    given, whole = getattr(sys, "argv", []), sys.orig_argv
    if given[:1] != ["-m"] or len(whole) < len(given):  # so it stands while -m is looked for
        return os.path.basename(given[0] if given else "") in ("pc2cad", "pc2cad.exe")
    named = whole[len(whole) - len(given)]
    if named.startswith("-"):
        named = named.partition("m")[2]
    return named.partition(".")[0] == "pc2cad"


def forget_current_folder() -> None:
    """Import nothing from the current folder any more; only for a process that is the command's."""
    floating = _floating()
    if sys.argv[:1] == ["-m"] and not sys.flags.safe_path and sys.path[0] == _here():
        del sys.path[0]
    sys.path[:] = [p for p in sys.path if os.path.isabs(p) and p not in floating]
    for name in _MESSAGES:
        os.environ.setdefault(name, os.devnull)


def interpreter() -> list[str]:
    """Return the command of a Python that does not look in the current folder by itself.

    It wants the `environment` besides.
    """
    # -I would be too much: it forgets PYTHONHOME, and what PYTHONPATH says with good reason
    flags = [*["-E"] * sys.flags.ignore_environment, *["-s"] * sys.flags.no_user_site]
    return [sys.executable, "-P", *flags]


def environment() -> dict[str, str]:
    """Return the environment for a fresh Python: nothing in it depends on the current folder."""
    result = {**dict.fromkeys(_MESSAGES, os.devnull), **os.environ}
    entries = result.pop("PYTHONPATH", "").split(os.pathsep)
    if kept := [entry for entry in entries if os.path.isabs(entry)]:
        result["PYTHONPATH"] = os.pathsep.join(kept)
    if not os.path.isabs(result.get("PYTHONUSERBASE", os.sep)):
        del result["PYTHONUSERBASE"]
    return result


def running(module: str) -> list[str]:
    """Return the arguments with which an `interpreter` calls `main` of one of pc2cad's modules."""
    floating = _floating()
    path = [p for p in sys.path if isinstance(p, str) and os.path.isabs(p) and p not in floating]
    home = os.path.abspath(__file__)
    for _ in __name__.split("."):
        home = os.path.dirname(home)
    return ["-c", _BEGIN.format(path=path, home=home, module=module)]


def _floating() -> set[str]:
    """Return the folders on the path by entries of PYTHONPATH that name no certain place."""
    given = "" if sys.flags.ignore_environment else os.environ.get("PYTHONPATH", "")
    entries = given.split(os.pathsep) if given else []
    return {os.path.normpath(os.path.join(_here(), e)) for e in entries if not os.path.isabs(e)}


def _here() -> str:
    """Return the current folder, '' where it has been deleted."""
    try:
        return os.getcwd()
    except OSError:
        return ""
