"""Libraries that a process must not load twice, kept where the unloading of modules spares them.

CQ-editor drops every module that a script has imported after each render. Pure Python modules are
then loaded anew, but extension modules of NumPy and SciPy refuse that: "cannot load module more
than once per process". So they are kept, and put back before they are asked for again.
"""

from __future__ import annotations

import sys
from types import ModuleType

LIBRARIES = ("lib3mf", "numpy", "scipy", "sympy", "mpmath", "vtkmodules")
#: name of the list on a module that outlives a script
_KEPT = "_pc2cad_kept_modules"


def keep(keeper: ModuleType) -> None:
    """Remember the libraries' modules on `keeper`, a module that stays."""
    kept: dict[str, ModuleType] = vars(keeper).setdefault(_KEPT, {})
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] in LIBRARIES and isinstance(module, ModuleType):
            kept[name] = module


def restore(keeper: ModuleType) -> None:
    """Put remembered modules back that have been dropped since."""
    for name, module in vars(keeper).get(_KEPT, {}).items():
        sys.modules.setdefault(name, module)
