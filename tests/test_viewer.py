"""The page: what it holds is the solid, it asks nobody for anything, and its server is careful."""

from __future__ import annotations

import base64
import gzip
import hashlib
import http.client
import json
import os
import re
import threading
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import pytest
from shipped import part_of

import pc2cad as pc
from pc2cad.cli.main import main
from pc2cad.errors import InputError, KernelError, NotASolidError
from pc2cad.processes import CrashedError, LimitReachedError
from pc2cad.viewer.page import Slider, Variant, page
from pc2cad.viewer.payload import payload
from pc2cad.viewer.recompute import Recompute
from pc2cad.viewer.serve import PortTakenError, server
from tests.faulty_part import work

TYPES = {"f4": "<f4", "u4": "<u4", "i1": "i1", "u1": "u1"}
ASSETS = Path(pc.__file__).parent / "viewer" / "assets"


def unpack(data: bytes):
    """Header and a reader of its arrays, by the format's description alone."""
    raw = gzip.decompress(data)
    length = int.from_bytes(raw[:4], "little")
    header = json.loads(raw[4 : 4 + length])

    def read(place: dict) -> np.ndarray:
        assert place["at"] % 4 == 0
        return np.frombuffer(raw, TYPES[place["type"]], place["count"], 4 + length + place["at"])

    return header, read


@pytest.mark.parametrize("template", ["pyramid", "channel_sine", "hollow_ball", "bilinear_top"])
def test_the_payload_is_the_solid_and_what_is_known_of_it(template):
    part = part_of(template)
    header, read = unpack(payload(part))
    corners = []
    for face, known in zip(header["faces"], part.report.faces, strict=True):
        points = read(face["positions"]).reshape(-1, 3).astype(float)
        normals = read(face["normals"]).reshape(-1, 4)[:, :3].astype(float) / 127
        assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=0.02)
        corners.append(points[read(face["triangles"]).reshape(-1, 3)])
        assert (face["name"], face["evidence"], face["deviation"]) == (
            known.name, known.evidence, known.deviation,
        )  # fmt: skip
    volume = np.linalg.det(np.concatenate(corners)).sum() / 6
    assert volume == pytest.approx(part.report.solid.volume, rel=1e-2)
    fates = {other["name"]: other["fate"] for other in header["others"]}
    assert fates == {s.name: s.fate for s in part.report.sides if s.fate != "face"}
    assert payload(part) == payload(part)


def test_points_of_the_box_come_along_when_asked_for():
    header, read = unpack(payload(part_of("pyramid"), (20, 20, 30)))
    points = read(header["points"]["positions"]).reshape(-1, 3)
    assert len(points) == 12_000
    assert points[:, 2].max() == 6.0
    assert len(read(header["points"]["colours"])) == 4 * 12_000
    assert unpack(payload(part_of("pyramid")))[0]["points"] is None


def test_the_page_needs_no_network_and_no_name_breaks_it():
    name = "</script><script>alert(1)</script> @@STATE@@ ü"
    slider = Slider("p", name, 0.5, (0.25, 0.5))
    text = page(name, [slider], [Variant(b"data"), Variant(None, name)], live=False).decode()
    assert text.count("<script") == 5 - 1  # import map, state, one variant, module
    assert "alert(1)</script>" not in text
    bare = re.sub(r'"data:[^"]*"', "", text)
    assert not re.search(r'(?:src|href)\s*=\s*"?https?:', bare)
    assert "connect-src 'none'" in text
    assert base64.b64encode(b"data").decode() in text
    assert "Copyright © 2010-2024 three.js authors" in text
    assert "connect-src 'self'" in page("t", [], [Variant(b"")], live=True).decode()


def test_the_library_is_that_of_the_npm_package_unchanged():
    """SHA-256 of the files in three-0.170.0.tgz."""
    digests = {
        "three.module.min.js": "08fd7545d13d2c7fb65ab691530a802dafefd638596501854f267d0fb13c39e7",
        "OrbitControls.js": "80efaadea4f8a636a65fb0bd08bfef62f3d93a0bb94e2e7500f23176c5c07f4e",
    }
    for name, digest in digests.items():
        assert hashlib.sha256((ASSETS / name).read_bytes()).hexdigest() == digest
    assert "MIT License" in (ASSETS / "LICENSE-three.txt").read_text()


def test_a_page_of_variants_says_where_there_is_no_solid(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    arguments = ["view", "pyramid_cut", "-s", "q=1", "-s", "r=1", "-o", "p.html"]
    assert main([*arguments, "--slider", "p=0.5:1:3"]) == 0
    assert capsys.readouterr().out.startswith("p.html: 3 parts, 1 of them no solid")
    text = (tmp_path / "p.html").read_text()
    state = json.loads(re.search(r'id="state">(.*?)</script>', text).group(1))
    assert state["sliders"][0]["values"] == [0.5, 0.75, 1.0]
    assert list(state["problems"]) == ["2"]
    stored = dict(re.findall(r'id="variant-(\d)">([^<]*)</script>', text))
    assert set(stored) == {"0", "1"}
    header, _ = unpack(base64.b64decode(stored["1"]))
    assert header["parameters"] == {"p": 0.75, "q": 1.0, "r": 1.0}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "a.txt"], "use one of .html, .htm"),
        (["-o", "a.html", "--slider", "x=0:1:2"], "no parameter 'x'"),
        (["-o", "a.html", "--slider", "p"], "write NAME=LOW:HIGH:COUNT"),
        (["-o", "a.html", "--slider", "p=0:1"], "write LOW:HIGH:COUNT"),
        (["-o", "a.html", "--slider", "p=0,one"], "'one' is not a number"),
        (["-o", "a.html", "--slider", "p=0:1:9", "--slider", "q=0:1:9"], "combinations"),
        (["-o", "a.html", "--points", "10000,10000,10000"], "point set"),
        (["--serve", "--port", "99999"], "cannot listen"),
        (["--serve", "--slider", "p=0:1:3"], "with --serve write LOW:HIGH"),
        ([], "required"),
    ],
)
def test_wrong_arguments_are_named_and_leave_nothing(
    arguments, message, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main(["view", "pyramid_cut", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def build(values):
    if "bad" in values:
        raise NotASolidError("the map folds")
    return json.dumps(dict(values)).encode()


@contextmanager
def running():
    with server(b"<page>", build) as found:
        thread = threading.Thread(target=found.serve_forever, daemon=True)
        thread.start()
        yield found.server_address[1]
        found.shutdown()
        thread.join(10)


def ask(port: int, path: str, host: str | None = None) -> tuple[int, str, bytes]:
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=10)) as connection:
        connection.request("GET", path, headers={"Host": host or f"127.0.0.1:{port}"})
        answer = connection.getresponse()
        return answer.status, answer.getheader("Content-Type"), answer.read()


def test_the_server_gives_page_parts_and_reasons_to_this_machine_only():
    with running() as port:
        assert ask(port, "/") == (200, "text/html; charset=utf-8", b"<page>")
        status, kind, body = ask(port, "/part?delta=0.3&s=1%2F3")
        assert (status, kind) == (200, "application/octet-stream")
        assert json.loads(body) == {"delta": "0.3", "s": "1/3"}
        assert ask(port, "/part?bad=1")[::2] == (422, b"the map folds")
        assert ask(port, "/part?x")[0] == 422
        assert ask(port, "/../etc/passwd")[0] == 404
        assert ask(port, "/", host="example.org")[0] == 403
        assert ask(port, "/", host=f"localhost:{port}")[0] == 200
        with pytest.raises(PortTakenError, match="cannot listen"):
            server(b"", build, port)


def test_parts_are_made_in_one_other_process_and_their_errors_come_back():
    with closing(Recompute(work, 0.0, 0.0)) as recompute:
        kept = recompute({})
        assert int(kept) != os.getpid()
        with pytest.raises(NotASolidError, match="the map folds"):
            recompute({"do": "refuse"})
        with pytest.raises(KernelError, match="unexpected error: ZeroDivisionError"):
            recompute({"do": "fail"})
        assert recompute({}) == kept


@pytest.mark.parametrize(
    ("do", "seconds", "memory", "error", "words"),
    [
        ("hang", 2.0, 0.0, LimitReachedError, "time limit of 2 s"),
        ("grow", 60.0, 0.3 * 1024**3, LimitReachedError, "memory limit of 0.3 GiB"),
        ("crash", 60.0, 0.0, CrashedError, "SIGABRT"),
    ],
)
def test_a_part_that_goes_wrong_does_not_take_the_page_along(do, seconds, memory, error, words):
    with closing(Recompute(work, seconds, memory)) as recompute:
        with pytest.raises(error, match=words):
            recompute({"do": do})
        assert int(recompute({})) != os.getpid()


def test_errors_of_the_server_are_input_errors():
    assert issubclass(PortTakenError, InputError)
