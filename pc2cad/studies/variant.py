"""One variant of a study: what identifies it, how it is built, and what is kept of it."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

from pc2cad.errors import PointCadError
from pc2cad.export.version import __version__
from pc2cad.options import CompileOptions
from pc2cad.studies.store import open_store
from pc2cad.trust.names import visible

if TYPE_CHECKING:
    from pc2cad.part import Part
    from pc2cad.report import Report
    from pc2cad.templates.bodies import BodiesTemplate
    from pc2cad.templates.template import Template

#: what a refusal is called in the table, by its exit code
STATUS = {
    2: "bad input", 3: "not a solid", 4: "tolerance not reached", 5: "failed", 6: "not verified",
}  # fmt: skip
BUILT = "built"
#: characters of a reason: messages quote what they are about
LONGEST_REASON = 4000
#: endings of files that are not called by theirs
ENDINGS = {"thumbnail": "png"}
THUMBNAIL_SIZE = (240, 180)
#: characters of a key that is made of parameters; where they are more, it is the hash alone
LONGEST_KEY = 64


@dataclass(frozen=True)
class Task:
    """What all variants of a study have in common."""

    template: str
    name: str
    #: file name endings without the dot
    formats: tuple[str, ...]
    #: folder or address that files go to
    store: str
    tolerance: float | None = None
    degree: int | None = None
    max_degree: int | None = None
    profile: str = "compact"
    #: a picture of every part goes to the store as well
    thumbnails: bool = False
    #: STEP files are held against the equation before they are stored
    verify: bool = False
    #: parameters that do not vary and points that are replaced: numbers, or texts as -s takes them
    fixed: Mapping[str, float | str] = field(default_factory=dict)
    #: what is proved over the ranges of what varies (see `over_ranges`): no variant differs by it
    known: str = ""

    @property
    def options(self) -> CompileOptions:
        """How close to the equation and in which splines; raise InputError where they clash."""
        return CompileOptions(self.tolerance, self.degree, self.max_degree, self.profile)

    def key(self, values: Mapping[str, float]) -> str:
        """Return what a variant and its files are called: equal keys are one and the same part.

        The parameters that vary with every digit, ``p=0.2_q=0.5-`` and eight digits of the content
        hash, which tell studies apart in one store; the whole hash where that is too long.
        """
        varied = sorted((name, float(value)) for name, value in values.items())
        content = _hash({"study": self.fingerprint, "values": varied})
        words = "_".join(f"{name}={value!r}".removesuffix(".0") for name, value in varied)
        key = f"{words}-{content[:8]}"
        return key if len(key) <= LONGEST_KEY else content

    @cached_property
    def fingerprint(self) -> str:
        """The content hash of everything that the variants have in common."""
        content = asdict(self) | {"version": __version__, "store": ""}
        del content["known"]
        return _hash(content)


def _hash(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:32]


@dataclass(frozen=True)
class Job:
    """One variant as it is handed to a worker."""

    key: str
    values: Mapping[str, float]


@dataclass(frozen=True)
class Outcome:
    """What became of a variant: figures where it was built, the reason where it was not."""

    key: str
    status: str
    reason: str = ""
    #: column -> value: volume, area, centroid, deviation, evidence, counts
    figures: Mapping[str, float | int | str] = field(default_factory=dict)
    #: format -> file name in the store
    files: Mapping[str, str] = field(default_factory=dict)
    #: seconds of work, and of each part of it
    times: Mapping[str, float] = field(default_factory=dict)
    #: format -> SHA-256 of the file
    hashes: Mapping[str, str] = field(default_factory=dict)

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Outcome:
        """Return the outcome that `dataclasses.asdict` turned into plain data."""
        return Outcome(**data)


def run_variant(task: Task, job: Job) -> Outcome:
    """Build a variant and write its files; whatever goes wrong is an outcome, not an exception."""
    start = time.perf_counter()
    try:
        outcome = _build(task, job)
    except PointCadError as error:
        status, reason = STATUS[error.exit_code], str(error)
    except MemoryError:
        status, reason = STATUS[5], "there is not enough memory for this solid"
    except RecursionError:
        status, reason = STATUS[2], "an expression is nested too deeply"
    except Exception as error:  # one variant must not end the study
        status, reason = STATUS[5], f"an unexpected error: {type(error).__name__}: {error}"
    else:
        times = {**outcome.times, "total": time.perf_counter() - start}
        return replace(outcome, times=times)
    return Outcome(job.key, status, visible(" ".join(reason.split()))[:LONGEST_REASON],
                   times={"total": time.perf_counter() - start})  # fmt: skip


def _build(task: Task, job: Job) -> Outcome:
    from pc2cad.compiler import compile_solid
    from pc2cad.export.model import ExportOptions
    from pc2cad.export.registry import format_for

    template, values = _template(task.template, task.name), {**task.fixed, **job.values}
    equation, known = template.bind(values), None
    if task.known:
        from pc2cad.studies.over_ranges import known_at

        known = known_at(task.known, template, values)
    part = compile_solid(equation, task.options, known=known)
    times = {name: float(seconds) for name, seconds in part.report.times.items()}
    start = time.perf_counter()
    store = open_store(task.store)
    exportable = part.exportable()
    encoded = {
        kind: format_for(f"part.{kind}").encoder()(exportable, ExportOptions())
        for kind in task.formats
    }
    if task.verify and "step" in encoded:
        from pc2cad.verify.gate import require_verified

        require_verified(encoded["step"], equation, part.report.tolerance)
        times["verify"] = time.perf_counter() - start
        start = time.perf_counter()
    if task.thumbnails:
        encoded["thumbnail"] = _thumbnail(part)
    files = {kind: file_name(job.key, kind) for kind in encoded}
    hashes = {kind: hashlib.sha256(data).hexdigest() for kind, data in encoded.items()}
    for kind, data in encoded.items():
        store.write(files[kind], data)
    times["write"] = time.perf_counter() - start
    return Outcome(job.key, BUILT, "", figures_of(part.report), files, times, hashes)


def file_name(key: str, kind: str) -> str:
    """Return the name of a variant's file of a format, or of its thumbnail."""
    return f"{key}.{ENDINGS.get(kind, kind)}"


def _thumbnail(part: Part) -> bytes:
    from pc2cad.picture.camera import VIEWS
    from pc2cad.picture.drawing import drawing
    from pc2cad.picture.image import camera_for, encode

    scene = drawing(part)
    return encode(scene, camera_for(scene, VIEWS["iso"], THUMBNAIL_SIZE), "thumbnail.png")


@lru_cache(maxsize=8)
def _template(text: str, name: str) -> Template | BodiesTemplate:
    from pc2cad.templates.file import parse_template

    return parse_template(text, name, name)


def figures_of(report: Report) -> dict[str, float | int | str]:
    """Return the figures of a report that a row of the results table holds."""
    x, y, z = report.integrals.centroid
    alone = [report] if report.own is not None else report.bodies.values()
    return {
        "units": report.units,
        "volume": report.integrals.volume,
        "area": report.integrals.area,
        "centroid_x": x,
        "centroid_y": y,
        "centroid_z": z,
        "deviation": report.deviation,
        "evidence": report.evidence,
        "injectivity": max((one.injectivity for one in alone), key=("proved", "sampled").index),
        "faces": len(report.faces),
        "shells": report.shells,
    }
