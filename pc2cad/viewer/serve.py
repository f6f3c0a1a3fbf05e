"""The page served on loopback; its sliders have the part compiled anew."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Lock
from typing import Any
from urllib.parse import parse_qsl, urlsplit

from pc2cad.errors import InputError, PointCadError

HOST = "127.0.0.1"
#: longest request line that is looked at
LONGEST_QUERY = 8000


class PortTakenError(InputError):
    """Something else listens on the port."""


def server(
    page: bytes, build: Callable[[Mapping[str, str]], bytes], port: int = 0
) -> ThreadingHTTPServer:
    """Return a server, bound to loopback but not yet running, for a page and its parts.

    `build` makes the payload of some parameter values and may raise a PointCadError, which the page
    shows; it is never called twice at a time. Port 0 takes a free one. Raises PortTakenError.
    """
    lock = Lock()

    class Handler(_Handler):
        def answer(self, path: str, query: str) -> tuple[HTTPStatus, str, bytes]:
            if path == "/":
                return HTTPStatus.OK, "text/html; charset=utf-8", page
            if path != "/part":
                return HTTPStatus.NOT_FOUND, "text/plain; charset=utf-8", b"not here"
            try:
                with lock:
                    data = build(dict(parse_qsl(query, strict_parsing=bool(query))))
            except (PointCadError, ValueError) as error:
                text = str(error).encode()
                return HTTPStatus.UNPROCESSABLE_ENTITY, "text/plain; charset=utf-8", text
            return HTTPStatus.OK, "application/octet-stream", data

    try:
        return ThreadingHTTPServer((HOST, port), Handler)
    except (OSError, OverflowError) as error:
        raise PortTakenError(f"cannot listen on {HOST}:{port}: {error}") from error


class _Handler(BaseHTTPRequestHandler):
    """Answers GET from this machine's own browsers, and nothing else."""

    protocol_version = "HTTP/1.1"
    timeout = 60

    def answer(self, path: str, query: str) -> tuple[HTTPStatus, str, bytes]:
        """Return status, content type and body."""
        raise NotImplementedError

    def do_GET(self) -> None:
        """Answer a request, unless it was sent here under another host's name."""
        port = self.connection.getsockname()[1]
        if self.headers.get("Host") not in (f"{HOST}:{port}", f"localhost:{port}"):
            self._send(HTTPStatus.FORBIDDEN, "text/plain", b"loopback only")
            return
        parts = urlsplit(self.path[:LONGEST_QUERY])
        self._send(*self.answer(parts.path, parts.query))

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: the command's output is its own."""

    def _send(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        with suppress(ConnectionError):  # the slider has moved on
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("X-Content-Type-Options", "nosniff")
            self.end_headers()
            self.wfile.write(body)
