"""A headless Chromium with the network off, driven by its DevTools protocol as a person would."""

from __future__ import annotations

import asyncio
import base64
import json
import shutil
import subprocess
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import aiohttp

#: no host name resolves but loopback: whatever a page fetches fails, and is counted
OFFLINE = "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"
FLAGS = [
    "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist", "--remote-debugging-port=0", "--no-first-run",
    "--disable-extensions", "--disable-dev-shm-usage", "--window-size=1000,700", OFFLINE,
]  # fmt: skip


def chromium() -> str | None:
    """The browser's command, or None where it is not installed."""
    return shutil.which("chromium") or shutil.which("chromium-browser")


class Page:
    """One open page: what it logs, and hands on it."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket = socket
        self._number = 0
        self.events: list[dict[str, Any]] = []

    async def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        await self._socket.send_json({"id": self._number, "method": method, "params": parameters})
        while True:
            message = json.loads((await self._socket.receive(timeout=120)).data)
            if message.get("id") == self._number:
                assert "error" not in message, message
                return message["result"]
            self.events.append(message)

    async def evaluate(self, script: str) -> Any:
        found = await self.call(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    async def until(self, script: str, seconds: float = 60.0) -> None:
        end = time.monotonic() + seconds
        while not await self.evaluate(script):
            assert time.monotonic() < end, f"never came true: {script}"
            await asyncio.sleep(0.05)

    async def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        await self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    async def hover(self, x: float, y: float) -> None:
        await self.mouse("mouseMoved", x, y)
        await self.evaluate(
            "new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))"
        )

    async def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        await self.mouse("mousePressed", *start, button="left", buttons=1, clickCount=1)
        for i in range(1, 6):
            x, y = (a + (b - a) * i / 5 for a, b in zip(start, end, strict=True))
            await self.mouse("mouseMoved", x, y, button="left", buttons=1)
        await self.mouse("mouseReleased", *end, button="left", buttons=0, clickCount=1)
        await self.evaluate(
            "new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))"
        )

    async def touch(self, *moves: list[tuple[float, float]]) -> None:
        """Put fingers on the first places, move them over the others, and lift them."""
        kinds = ["touchStart", *["touchMove"] * (len(moves) - 1)]
        for kind, places in zip(kinds, moves, strict=True):
            points = [{"x": x, "y": y, "id": finger} for finger, (x, y) in enumerate(places)]
            await self.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)
        await self.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        await self.evaluate(
            "new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))"
        )

    async def click(self, selector: str) -> None:
        await self.evaluate(f"document.querySelector({json.dumps(selector)}).click()")
        await self.evaluate(
            "new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))"
        )

    async def set(self, selector: str, value: object) -> None:
        """Set a control's value as a user's input does."""
        target = json.dumps(selector)
        await self.evaluate(
            f"(() => {{ const e = document.querySelector({target}); e.value = {json.dumps(value)};"
            " e.dispatchEvent(new Event('input', {bubbles: true})); })()"
        )
        await self.evaluate(
            "new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))"
        )

    async def screenshot(self, path: Path) -> Path:
        found = await self.call("Page.captureScreenshot", format="png")
        path.write_bytes(base64.b64decode(found["data"]))
        return path

    def requests(self) -> list[str]:
        """Addresses that the page has asked for since it was opened."""
        return [e["params"]["request"]["url"] for e in self.events
                if e.get("method") == "Network.requestWillBeSent"]  # fmt: skip

    def complaints(self) -> list[Any]:
        """Errors and warnings that the page has logged."""
        return [
            e["params"] for e in self.events
            if e.get("method") == "Runtime.exceptionThrown"
            or (e.get("method") == "Runtime.consoleAPICalled" and e["params"]["type"] == "error")
            or (e.get("method") == "Log.entryAdded" and e["params"]["entry"]["level"] == "error")
        ]  # fmt: skip


def visit(url: str, folder: Path, act: Callable[[Page], Awaitable[None]]) -> None:
    """Open a page in a new browser and act on it."""
    command = [chromium() or "", *FLAGS, f"--user-data-dir={folder / 'profile'}", "about:blank"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        asyncio.run(asyncio.wait_for(_visit(url, folder, act), 300))
    finally:
        process.terminate()
        process.wait(timeout=30)


async def _visit(url: str, folder: Path, act: Callable[[Page], Awaitable[None]]) -> None:
    port_file = folder / "profile" / "DevToolsActivePort"
    end = time.monotonic() + 60
    while not (port_file.exists() and len(port_file.read_text().splitlines()) > 1):
        assert time.monotonic() < end, "the browser did not start"
        await asyncio.sleep(0.1)
    port = port_file.read_text().splitlines()[0]
    async with aiohttp.ClientSession() as session:
        async with session.get(f"http://127.0.0.1:{port}/json/list") as answer:
            target = next(t for t in await answer.json() if t["type"] == "page")
        async with session.ws_connect(target["webSocketDebuggerUrl"], max_msg_size=0) as socket:
            page = Page(socket)
            for domain in ("Page", "Runtime", "Network", "Log"):
                await page.call(f"{domain}.enable")
            await page.call("Page.navigate", url=url)
            await page.until("window.page?.ready === true")
            await act(page)
