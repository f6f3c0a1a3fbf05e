"""A folder of files that are named like modules, each of which leaves a mark when it is run."""

from __future__ import annotations

import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from pkgutil import iter_modules

#: what Python itself looks for, besides modules that somebody asks for
STARTUP = {"sitecustomize", "usercustomize"}
#: packages that are tried, wherever they are installed
OPTIONAL = {
    "gmsh", "h5py", "pyarrow", "matplotlib", "distributed", "dask", "fsspec", "numba", "pandas",
    "IPython", "PIL", "ezdxf", "casadi", "tornado", "yaml", "cloudpickle", "vtk", "vtkmodules",
    "readline", "rich", "lib3mf", "numpy", "scipy", "sympy", "OCP", "cadquery",
}  # fmt: skip


@cache
def names() -> frozenset[str]:
    """Return the names of the standard library and of all that is installed."""
    installed = {module.name for module in iter_modules()}
    found = {*sys.stdlib_module_names, *installed, *STARTUP, *OPTIONAL, "pc2cad"}
    return frozenset(name for name in found if name.isidentifier())


@cache
def read_by_python() -> frozenset[str]:
    """Return what ``python -m pc2cad`` itself looks for before the first line of pc2cad is run."""
    script = "import sys; import runpy; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-I", "-c", script], capture_output=True, text=True)
    return frozenset({*done.stdout.split(), "pc2cad"})


def fill(folder: Path, without: set[str] | frozenset[str] = frozenset()) -> Path:
    """Fill a folder; return the file that the marks go to."""
    folder.mkdir(exist_ok=True)
    marks = folder / "marks.txt"
    for name in names() - without:
        line = f"open({str(marks)!r}, 'a').write({name!r} + '\\n')\nraise ImportError('hostile')\n"
        (folder / f"{name}.py").write_text(line)
    return marks


def marked(marks: Path) -> list[str]:
    """Return the names of the files that were run."""
    return sorted(set(re.findall(r"\w+", marks.read_text()))) if marks.exists() else []
