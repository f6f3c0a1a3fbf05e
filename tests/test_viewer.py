"""The page: what it holds is the solid, it asks nobody for anything, and its server is careful."""

from __future__ import annotations

import base64
import gzip
import hashlib
import http.client
import json
import os
import re
import socket
import threading
import time
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
from shipped import part_of

import pc2cad as pc
from pc2cad.cli.main import main, make_parser
from pc2cad.cli.view import _Maker
from pc2cad.errors import InputError, KernelError, NotASolidError
from pc2cad.trust.processes import CrashedError, LimitReachedError
from pc2cad.viewer import serve
from pc2cad.viewer.page import Slider, Variant, page
from pc2cad.viewer.payload import page_of, payload
from pc2cad.viewer.recompute import Recompute, SupersededError
from pc2cad.viewer.serve import PortTakenError, server
from pc2cad.viewer.worker import Download
from tests import hostile_folder as hostile
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
        a, b, c = corners[-1].swapaxes(0, 1)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
        assert area == pytest.approx(known.area, rel=1e-2)
        assert (face["name"], face["evidence"], face["deviation"]) == (
            known.name, known.evidence, known.deviation,
        )  # fmt: skip
    volume = np.linalg.det(np.concatenate(corners)).sum() / 6
    assert volume == pytest.approx(part.report.solid.volume, rel=1e-2)
    solid = np.concatenate(corners)
    flat = np.cross(solid[:, 1] - solid[:, 0], solid[:, 2] - solid[:, 0])
    assert np.abs(flat.sum(axis=0)).max() < 1e-5 * part.report.solid.area  # closed
    assert 0 < header["deflection"] < 0.002 * part.report.size
    assert len(page_of(part)) < 2e6
    fates = {other["name"]: other["fate"] for other in header["others"]}
    assert fates == {s.name: s.fate for s in part.report.sides if s.fate != "face"}
    assert payload(part) == payload(part)


def test_the_server_gives_files_of_the_part_that_is_shown():
    with running() as found:
        kind = "application/octet-stream"
        assert ask(found, "part.step?p=1") == (200, kind, b".step {'p': '1'}")
        assert ask(found, "part.stl") == (200, kind, b".stl {}")
        for name in ("part.brep", "part.", "partstep", ".step", "part.step/"):
            assert ask(found, name)[0] == 404, name


@pytest.mark.slow
def test_a_file_from_the_server_is_that_of_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    arguments = make_parser("view").parse_args(["view", "pyramid_cut", "--serve"])
    with closing(Recompute(_Maker(arguments).answer, 60.0, 0)) as recompute:
        found = {end: recompute(Download(end, {"p": "0.3"})) for end in (".step", ".stl")}
    assert main(["build", "pyramid_cut", "-s", "p=0.3", "-o", "a.step", "-o", "a.stl"]) == 0
    assert {end: Path(f"a{end}").read_bytes() for end in found} == found


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
        (["-o", "a.html", "--slider", "p"], "write NAME=LOW:HIGH:COUNT, NAME=A,B,C"),
        (["-o", "a.html", "--slider", "p=0:1"], "is a range, which takes --serve"),
        (["-o", "a.html", "--slider", "p=0,one"], "values of p: 'one'"),
        (["-o", "a.html", "--slider", "p=0:1:9", "--slider", "q=0:1:9"], "combinations"),
        (["-o", "a.html", "--points", "10000,10000,10000"], "point set"),
        (["--serve", "--port", "99999"], "cannot listen"),
        (["--serve", "--slider", "p=0:1:3"], "with --serve write NAME=LOW:HIGH"),
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


def build(values, stale):
    if isinstance(values, Download):
        return f"{values.ending} {dict(values.values)}".encode()
    if "bad" in values:
        raise NotASolidError("the map folds")
    return json.dumps(dict(values)).encode()


@contextmanager
def running(make=build):
    with server(b"<page>", make) as found:
        thread = threading.Thread(target=found.serve_forever, args=(0.02,), daemon=True)
        thread.start()
        yield found
        found.shutdown()
        thread.join(10)


def ask(found, path, method="GET", **headers):
    """Status, type and body of the answer; the path is below the secret unless it begins with /."""
    host, port = found.server_address
    secret = found.address.split("/")[3]
    if not path.startswith("/"):
        path = f"/{secret}/{path}"
    given = {"Host": f"127.0.0.1:{port}"}
    given.update((name.replace("_", "-"), value) for name, value in headers.items())
    with closing(http.client.HTTPConnection(host, port, timeout=10)) as connection:
        connection.putrequest(method, path, skip_host=True)
        for name, value in given.items():
            if value is not None:
                connection.putheader(name, value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.getheader("Content-Type"), answer.read()


def test_the_server_gives_page_parts_and_reasons():
    with running() as found:
        assert ask(found, "") == (200, "text/html; charset=utf-8", b"<page>")
        status, kind, body = ask(found, "part?delta=0.3&s=1%2F3")
        assert (status, kind) == (200, "application/octet-stream")
        assert json.loads(body) == {"delta": "0.3", "s": "1/3"}
        assert ask(found, "part?bad=1")[::2] == (422, b"the map folds")
        assert ask(found, "part?x")[0] == 422
        assert ask(found, "../etc/passwd")[0] == 404
        port = found.server_address[1]
        with pytest.raises(PortTakenError, match="cannot listen"):
            server(b"", build, port)


def test_two_servers_have_two_secrets_that_cannot_be_guessed():
    with running() as one, running() as other:
        first, second = (found.address.split("/")[3] for found in (one, other))
        assert first != second
        assert len(first) >= 43  # 256 bits
        port = one.server_address[1]
        assert ask(one, f"/{second}/", Host=f"127.0.0.1:{port}")[0] == 403


def calls_of(made):
    def make(values, stale):
        made.append(values)
        return b"part"

    return make


@pytest.mark.parametrize("path", ["", "part?p=1", "elsewhere"])
@pytest.mark.parametrize("method", ["GET", "POST", "OPTIONS", "HEAD", "BREW"])
@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "example.org"}, {"Host": "example.org:{port}"}, {"Host": "0.0.0.0:{port}"},
        {"Host": "127.0.0.1"}, {"Host": "127.0.0.1:{port}, example.org"}, {"Host": None},
        {"Origin": "http://example.org"}, {"Origin": "null"}, {"Origin": "http://127.0.0.1:1"},
        {"Origin": "https://127.0.0.1:{port}"}, {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"}, {"Origin": ""},
    ],
)  # fmt: skip
def test_other_sites_get_nothing_even_with_the_secret(served, headers, method, path):
    found, made = served
    port = found.server_address[1]
    given = {name: value and value.format(port=port) for name, value in headers.items()}
    status, _, body = ask(found, path, method, **given)
    assert (status, made) == (403, [])
    assert b"page" not in body


@pytest.mark.parametrize("method", ["GET", "POST"])
@pytest.mark.parametrize(
    "path", ["/", "/part?p=1", "//part", "/{short}/", "/{long}/", "/é/", "/{secret}%2F"]
)
def test_who_does_not_know_the_secret_gets_nothing(served, path, method):
    found, made = served
    secret = found.address.split("/")[3]
    path = path.format(short=secret[:-1], long=f"{secret}a", secret=secret)
    assert ask(found, quote(path, "/?=%"), method)[0] == 403
    assert made == []


@pytest.fixture(scope="module")
def served():
    made = []
    with running(calls_of(made)) as found:
        yield found, made


def test_the_page_itself_and_the_address_bar_get_everything(served):
    found, made = served
    port = found.server_address[1]
    for headers in (
        {"Sec_Fetch_Site": "none"}, {"Sec_Fetch_Site": "same-origin"}, {},
        {"Origin": f"http://127.0.0.1:{port}", "Sec_Fetch_Site": "same-origin"},
        {"Host": f"localhost:{port}", "Origin": f"http://localhost:{port}"},
    ):  # fmt: skip
        assert ask(found, "", **headers)[2] == b"<page>"
    assert ask(found, "part", "POST")[0] == 405
    assert made == []


def raw(found, data, end=False):
    with socket.create_connection(found.server_address, timeout=10) as connection:
        with suppress(BrokenPipeError, ConnectionResetError):  # answered before all of it is sent
            connection.sendall(data)
        if end:
            connection.shutdown(socket.SHUT_WR)
        received = b""
        with suppress(ConnectionResetError):
            while more := connection.recv(65536):
                received += more
        return received


@pytest.mark.parametrize(
    ("request_", "status"),
    [
        (b"GET /" + b"a" * 9000 + b" HTTP/1.1\r\n\r\n", b"414"),
        (b"GET /" + b"a" * 10**6, b"414"),
        (b"GET / HTTP/1.1\r\n" + b"X: " + b"a" * 20_000 + b"\r\n\r\n", b"431"),
        (b"GET / HTTP/1.1\r\n" + b"X: a\r\n" * 70 + b"\r\n", b"431"),
        (b"GET / HTTP/1.1\r\n", b"408"),
        (b"\x16\x03\x01 TLS\r\n\r\n", b"400"),
        (b"GET\r\n\r\n", b"400"),
        (b"GET / HTTP/1.1\r\n\r\n" * 20, b"403"),
    ],
    ids=["address", "endless", "header", "headers", "slow", "tls", "short", "many"],
)
def test_a_request_has_its_limits(served, request_, status, monkeypatch, capfd):
    monkeypatch.setattr(serve, "ARRIVAL", 0.2)
    answer = raw(served[0], request_)
    assert answer.split()[1:2] in ([status], []), answer[:100]
    assert answer or len(request_) > 20_000  # it may be reset before its answer is read
    assert answer.count(b"HTTP/1.1 ") <= 1, "one request on each connection"
    assert capfd.readouterr().err == ""


def test_connections_are_counted_and_come_free_again(served, monkeypatch):
    monkeypatch.setattr(serve, "ARRIVAL", 0.5)
    found = served[0]
    with ExitStack() as stack:
        held = [
            stack.enter_context(socket.create_connection(found.server_address, timeout=10))
            for _ in range(serve.MOST_CONNECTIONS)
        ]
        for connection in held:
            connection.sendall(b"GET / HTTP/1.1\r\n")
        time.sleep(0.1)
        assert raw(found, b"") == b"", "one too many"
        assert all(connection.recv(100).startswith(b"HTTP/1.1 408") for connection in held)
    assert ask(found, "")[0] == 200


def wait(true):
    end = time.monotonic() + 10
    while not true():
        assert time.monotonic() < end
        time.sleep(0.005)


def test_the_newest_request_is_served_and_those_between_are_dropped():
    free, begun = threading.Event(), []

    def make(values, stale):
        begun.append(values["n"])
        free.wait(10)
        if stale():
            raise SupersededError("a newer request")
        return values["n"].encode()

    answers = {}
    with running(make) as found:
        threads = []
        for n in range(1, 5):
            thread = threading.Thread(
                target=lambda n=n: answers.update({n: ask(found, f"part?n={n}")[::2]})
            )
            threads.append(thread)
            thread.start()
            wait(lambda n=n: found._turns._newest == n)
        wait(lambda: len(answers) == 2)
        assert {n: status for n, (status, _) in answers.items()} == {2: 409, 3: 409}
        free.set()
        for thread in threads:
            thread.join(10)
    assert answers[1][0] == 409
    assert answers[4] == (200, b"4")
    assert begun == ["1", "4"]


def test_a_request_that_nobody_waits_for_is_stale():
    seen = threading.Event()

    def make(values, stale):
        wait(stale)
        seen.set()
        return b""

    with running(make) as found:
        secret, port = found.address.split("/")[3], found.server_address[1]
        with socket.create_connection(found.server_address) as connection:
            line = f"GET /{secret}/part HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n"
            connection.sendall(line.encode())
            time.sleep(0.1)
            assert not seen.is_set()
        assert seen.wait(10)


def test_a_slow_part_makes_room_for_a_newer_one(monkeypatch):
    monkeypatch.setattr("pc2cad.viewer.recompute.GRACE", 0.2)
    with closing(Recompute(work, 0.0, 0.0)) as recompute:
        begun = time.monotonic()
        with pytest.raises(SupersededError, match="newer"):
            recompute({"do": "hang"}, lambda: time.monotonic() > begun + 0.3)
        assert time.monotonic() - begun < 20
        assert int(recompute({})) != os.getpid()


def test_parts_are_made_in_one_other_process_and_their_errors_come_back(tmp_path, monkeypatch):
    marks = hostile.fill(tmp_path)
    monkeypatch.chdir(tmp_path)
    with closing(Recompute(work, 0.0, 0.0)) as recompute:
        kept = recompute({})
        assert int(kept) != os.getpid()
        with pytest.raises(NotASolidError, match="the map folds"):
            recompute({"do": "refuse"})
        with pytest.raises(KernelError, match="unexpected error: ZeroDivisionError"):
            recompute({"do": "fail"})
        assert recompute({}) == kept
    assert hostile.marked(marks) == []


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
