"""What lines of a journal say: what the study is, and outcomes; who wrote them is not known."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Mapping
from typing import Any, Final

from pc2cad.export.version import __version__
from pc2cad.studies.plan import Plan
from pc2cad.studies.table import COLUMNS
from pc2cad.studies.variant import BUILT, STATUS, Outcome, Task, file_name
from pc2cad.trust.names import clean, is_ending, is_identifier, visible

#: what JSON holds
Plain = Mapping[str, Any] | str
_KEY: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.=+-]{0,63}")
_HASH: Final = re.compile(r"[0-9a-f]{64}")
_FIELDS: Final = ("key", "status", "reason", "figures", "files", "hashes", "times")
#: of these only that they differ is told
_HASHES: Final = {"template": "the template's text differs", "order": "the variants differ"}


def described(task: Task, plan: Plan) -> dict[str, Any]:
    """Return what a study is as plain data: what any of its parts changes makes it another one."""
    columns = zip(plan.names, zip(*plan.variants, strict=True), strict=True)
    order = hashlib.sha256(json.dumps([plan.names, plan.variants]).encode()).hexdigest()
    return {
        "pc2cad": __version__,
        "template": hashlib.sha256(task.template.encode()).hexdigest(),
        "name": task.name,
        "formats": list(task.formats),
        "tolerance": task.tolerance,
        "degree": task.degree,
        "max degree": task.max_degree,
        "profile": task.profile,
        "thumbnails": task.thumbnails,
        "verify": task.verify,
        **{f"-s {name}": value for name, value in sorted(task.fixed.items())},
        "variants": len(plan),
        **{f"values of {name}": _summary(values) for name, values in columns},
        "order": order,
    }


def _summary(values: tuple[float, ...]) -> str:
    kinds = len(set(values))
    return f"{kinds} from {min(values)!r} to {max(values)!r}" if kinds > 1 else repr(values[0])


def differences(before: Any, now: Plain) -> list[str]:
    """Return how what a journal says of its study differs from what is asked for, in words."""
    if before == now:
        return []
    if not isinstance(before, Mapping) or not isinstance(now, Mapping):
        return ["another version of pc2cad began it"]
    found = [
        _HASHES.get(name) or f"{name}: it was {_shown(before, name)}, now {_shown(now, name)}"
        for name in dict.fromkeys((*now, *before))
        if before.get(name) != now.get(name)
    ]
    # that the order differs says nothing where the values do
    plan = [name for name in now if name == "variants" or name.startswith("values of ")]
    if any(before.get(name) != now.get(name) for name in plan):
        found = [words for words in found if words != _HASHES["order"]]
    return [visible(words)[:300] for words in found[:12]] or ["its first line differs"]


def _shown(study: Mapping[str, Any], name: str) -> str:
    value = study.get(name)
    if value is None:
        return "not given"
    return ", ".join(map(str, value)) or "none" if isinstance(value, list) else str(value)


def read_outcome(data: Mapping[str, Any]) -> Outcome | None:
    """Return the outcome that a line holds, None where it is not one that pc2cad writes."""
    if not {"key", "status"} <= set(data) <= set(_FIELDS):
        return None
    key, status, reason = (data.get(name, "") for name in ("key", "status", "reason"))
    if not (isinstance(key, str) and _KEY.fullmatch(key) and isinstance(reason, str)):
        return None
    if status not in (BUILT, *STATUS.values()):
        return None
    parts = [data.get(name, {}) for name in ("figures", "files", "hashes", "times")]
    if not all(isinstance(part, dict) for part in parts):
        return None
    figures, files, hashes, times = parts
    good = (
        all(_is_figure(name, value) for name, value in figures.items())
        and all(_is_file(key, kind, name) for kind, name in files.items())
        and set(hashes) <= set(files)
        and all(isinstance(value, str) and _HASH.fullmatch(value) for value in hashes.values())
        and all(is_identifier(name) and _is_number(value) for name, value in times.items())
    )
    if not good:
        return None
    return Outcome(key, status, clean(reason), figures, files, times, hashes)


def _is_figure(name: str, value: object) -> bool:
    kind = dict(COLUMNS).get(name)
    if kind is str:
        return isinstance(value, str) and value == clean(value, 200)
    return kind is not None and _is_number(value) and (kind is float or isinstance(value, int))


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return abs(value) < 2**63 if isinstance(value, int) else math.isfinite(value)


def _is_file(key: str, kind: str, name: object) -> bool:
    return is_ending(kind) and name == file_name(key, kind)
