"""The page served on loopback; its sliders have the part compiled anew.

Loopback is no wall: every user of the machine reaches it, and every page that a browser has open
can send requests there. So the address holds a secret, and a request must come from the page itself
or from the address bar: by its Host, its Origin and what the browser says of where it comes from.
"""

from __future__ import annotations

import secrets
import select
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from hmac import compare_digest
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from threading import BoundedSemaphore, Condition
from typing import Any, Final
from urllib.parse import parse_qsl

from pc2cad.errors import InputError, PointCadError
from pc2cad.viewer.recompute import Stale, SupersededError
from pc2cad.viewer.worker import Download, Question

HOST: Final = "127.0.0.1"
#: bytes of a request, of them in its address, lines of its head, and parameters in the address
LONGEST_REQUEST: Final = 16_384
LONGEST_ADDRESS: Final = 8000
MOST_HEADERS: Final = 64
MOST_PARAMETERS: Final = 200
#: seconds for a request to arrive, and for an answer to be taken
ARRIVAL: Final = 5.0
DEPARTURE: Final = 60.0
#: connections at a time; more are closed as they come
MOST_CONNECTIONS: Final = 32
#: what browsers say of a request that the page itself sent, or that somebody typed
OWN_SITES: Final = ("same-origin", "none")
TEXT: Final = "text/plain; charset=utf-8"
Answer = tuple[HTTPStatus, str, bytes]
#: files that the page's buttons ask for
FILES: Final = (".step", ".stl")
#: answers a question, and is told when nobody waits for it any more
Build = Callable[[Question, Stale], bytes]


class PortTakenError(InputError):
    """Something else listens on the port."""


class _RequestError(Exception):
    """A request that is not looked at; its argument is the status that says why."""


class Turns:
    """One caller at a time; of those who wait, the newest. Who is overtaken is told so."""

    def __init__(self) -> None:
        self._change, self._newest, self._busy = Condition(), 0, False

    @contextmanager
    def turn(self) -> Iterator[Stale]:
        """Wait for the turn; yield what tells whether a newer caller waits.

        Raises SupersededError when a newer caller comes first.
        """
        with self._change:
            self._newest += 1
            mine = self._newest
            self._change.notify_all()
            self._change.wait_for(lambda: mine != self._newest or not self._busy)
            if mine != self._newest:
                raise SupersededError("a newer request took the place of this one")
            self._busy = True
        try:
            yield lambda: mine != self._newest
        finally:
            with self._change:
                self._busy = False
                self._change.notify_all()


class PageServer(ThreadingHTTPServer):
    """A page and its parts, for those who know its address.

    Attributes:
        address: where the page is, with the secret

    """

    request_queue_size = MOST_CONNECTIONS

    def __init__(self, page: bytes, build: Build, port: int) -> None:
        super().__init__((HOST, port), _Handler)
        self._page, self._build, self._turns = page, build, Turns()
        self._free = BoundedSemaphore(MOST_CONNECTIONS)
        self._secret = secrets.token_urlsafe(32)
        port = self.server_address[1]
        self._hosts = (f"{HOST}:{port}", f"localhost:{port}")
        self.address = f"http://{HOST}:{port}/{self._secret}/"

    def admits(self, path: str, headers: Any) -> bool:
        """Say whether a request knows the secret and comes from the page, or from nobody's page."""
        secret = path.partition("?")[0].removeprefix("/").partition("/")[0]
        known = compare_digest(secret.encode(), self._secret.encode())
        origins = [f"http://{host}" for host in self._hosts]
        return (
            known
            and len(hosts := headers.get_all("Host", [])) == 1
            and hosts[0] in self._hosts
            and all(origin in origins for origin in headers.get_all("Origin", []))
            and all(site in OWN_SITES for site in headers.get_all("Sec-Fetch-Site", []))
        )

    def answer(self, path: str, gone: Stale) -> Answer:
        """Return the answer to a request that `gone` tells whether anybody waits for."""
        place, _, query = path.partition("?")
        name = place.removeprefix("/").partition("/")[2]
        if name == "":
            return HTTPStatus.OK, "text/html; charset=utf-8", self._page
        ending = name.removeprefix("part")
        if name != "part" and (ending == name or ending not in FILES):
            return HTTPStatus.NOT_FOUND, TEXT, b"not here"
        try:
            values = dict(
                parse_qsl(query, strict_parsing=bool(query), max_num_fields=MOST_PARAMETERS)
            )
            with self._turns.turn() as overtaken:
                if gone():
                    raise SupersededError("nobody waits for it")
                question = Download(ending, values) if ending else values
                data = self._build(question, lambda: overtaken() or gone())
        except SupersededError as error:
            return HTTPStatus.CONFLICT, TEXT, str(error).encode()
        except (PointCadError, ValueError) as error:
            return HTTPStatus.UNPROCESSABLE_ENTITY, TEXT, str(error).encode()
        return HTTPStatus.OK, "application/octet-stream", data

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer in a thread of its own, or not at all when there are too many."""
        if not self._free.acquire(blocking=False):
            self.shutdown_request(request)
            return
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer, and make room for others."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of connections that broke: stderr is the command's own."""


def server(page: bytes, build: Build, port: int = 0) -> PageServer:
    """Return a server, bound to loopback but not yet running, for a page and its parts.

    `build` may raise a PointCadError, which the page shows; it is never called twice at a time, and
    of the requests that wait for it only the newest one is kept. Port 0 takes a free one. Raises
    PortTakenError.
    """
    try:
        return PageServer(page, build, port)
    except (OSError, OverflowError) as error:
        raise PortTakenError(f"cannot listen on {HOST}:{port}: {error}") from error


class _Handler(BaseHTTPRequestHandler):
    """One request on each connection: a GET from this machine's own browsers, and nothing else."""

    protocol_version = "HTTP/1.1"
    server_version, sys_version = "pc2cad", ""
    default_request_version = request_version = "HTTP/1.1"
    server: PageServer

    def handle(self) -> None:
        """Read one request, within its limits, and answer it."""
        try:
            self.rfile = BytesIO(_head(self.connection))
        except _RequestError as error:
            self._send(error.args[0], TEXT, b"")
            return
        self.connection.settimeout(DEPARTURE)
        self.raw_requestline = self.rfile.readline()
        if not self.raw_requestline or not self.parse_request():
            return
        if not self.server.admits(self.path, self.headers):
            self._send(HTTPStatus.FORBIDDEN, TEXT, b"only at the address that pc2cad has printed")
        elif self.command != "GET":
            self._send(HTTPStatus.METHOD_NOT_ALLOWED, TEXT, b"")
        else:
            self._send(*self.server.answer(self.path, self._is_gone))

    def send_error(self, code: int, message: Any = None, explain: Any = None) -> None:
        """Answer what cannot be read."""
        self._send(HTTPStatus(code), TEXT, b"")

    def _is_gone(self) -> bool:
        """Say whether who asked has closed the connection."""
        readable = select.select([self.connection], [], [], 0.0)[0]
        try:
            return bool(readable) and not self.connection.recv(1, socket.MSG_PEEK)
        except OSError:
            return True

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: the command's output is its own."""

    def log_request(self, code: Any = "-", size: Any = "-") -> None:
        """Say nothing."""

    def _send(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        with suppress(OSError):  # the slider has moved on
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Connection", "close")
            self.send_header("Cache-Control", "no-store")
            self.send_header("X-Content-Type-Options", "nosniff")
            self.send_header("Cross-Origin-Resource-Policy", "same-origin")
            self.send_header("Content-Security-Policy", "frame-ancestors 'none'")
            self.send_header("Referrer-Policy", "no-referrer")
            self.end_headers()
            self.wfile.write(body)


def _head(connection: socket.socket) -> bytes:
    """Return the head of a request, b'' when there is none; raise _RequestError at a limit."""
    end, data = time.monotonic() + ARRIVAL, b""
    while True:
        connection.settimeout(max(end - time.monotonic(), 1e-3))
        try:
            more = connection.recv(LONGEST_REQUEST)
        except TimeoutError as error:
            raise _RequestError(HTTPStatus.REQUEST_TIMEOUT) from error
        data += more
        if len(data.partition(b"\n")[0]) > LONGEST_ADDRESS:
            raise _RequestError(HTTPStatus.REQUEST_URI_TOO_LONG)
        if len(data) > LONGEST_REQUEST or data.count(b"\n") > MOST_HEADERS:
            raise _RequestError(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE)
        if not more or b"\r\n\r\n" in data or b"\n\n" in data:
            return data if more else b""
