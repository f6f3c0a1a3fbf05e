"""The page in a real browser with the network off: turned, cut, hovered, its sliders moved."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from consumers.browser import Page, chromium, visit

from pc2cad.cli.main import main
from pc2cad.viewer.serve import PageServer, server

pytestmark = [
    pytest.mark.interop,
    pytest.mark.skipif(chromium() is None, reason="chromium is not installed (apt)"),
]

SHOWN = "page.shown.faces.filter(f => f.visible).map(f => f.userData.name).sort().join(' ')"
#: share of the canvas that is not white
INK = """(() => {
const s = document.getElementById('canvas'), c = document.createElement('canvas');
c.width = s.width; c.height = s.height;
const g = c.getContext('2d'); g.drawImage(s, 0, 0);
const d = g.getImageData(0, 0, c.width, c.height).data; let n = 0;
for (let i = 0; i < d.length; i += 4) if (d[i] < 250 || d[i+1] < 250 || d[i+2] < 250) n++;
return n / (d.length / 4); })()"""
#: of what the panel leaves free of the window
MIDDLE = "page.middle"


def test_a_field_colours_the_faces(tmp_path: Path) -> None:
    template = tmp_path / "bar.toml"
    template.write_text(
        'title = "Bar"\n[solid]\nx = "3*u"\ny = "v"\nz = "w"\n[fields]\nheat = "20 + x*y"\n'
    )
    path = tmp_path / "bar.html"
    assert main(["view", str(template), "-o", str(path)]) == 0
    painted = "page.shown.faces.filter(f => f.material.vertexColors).length"

    async def act(page: Page) -> None:
        assert await page.evaluate("page.problem") is None
        assert await page.evaluate(painted) == 0
        await page.set("#field", "heat")
        assert await page.evaluate(painted) == 6
        scale = "['low', 'high'].map(id => document.getElementById(id).textContent).join(' ')"
        assert await page.evaluate(scale) == "20 23"
        # the least is dark violet, the most yellow
        ends = "page.shown.faces.flatMap(f => [...f.geometry.attributes.color.array])"
        assert await page.evaluate(f"Math.max(...{ends})") > 0.9
        await page.set("#field", "")
        assert await page.evaluate(painted) == 0

    visit(path.as_uri(), tmp_path, act)


def test_a_stored_page(tmp_path: Path) -> None:
    path = tmp_path / "duct.html"
    assert main(["view", "torus_wedge", "-o", str(path), "--points", "100,100,100"]) == 0

    async def act(page: Page) -> None:
        assert await page.evaluate("page.problem") is None
        assert await page.evaluate(SHOWN) == "u=0 u=0.25 w=1"
        x, y = await page.evaluate(MIDDLE)
        whole = await page.evaluate(INK)
        assert 0.1 < whole < 0.9

        await page.hover(x, y)
        assert await page.evaluate("page.hovered") == "w=1"
        tip = await page.evaluate("document.getElementById('tip').textContent")
        assert tip.startswith("w=1\n")
        assert "area" in tip

        before = await page.evaluate("page.camera.position.toArray()")
        await page.drag((x, y), (x + 120, y + 40))
        after = await page.evaluate("page.camera.position.toArray()")
        assert sum(abs(a - b) for a, b in zip(before, after, strict=True)) > 1.0
        await page.click("#home")

        await page.click("li[data-name='w=1'] input")
        assert await page.evaluate(SHOWN) == "u=0 u=0.25"
        assert await page.evaluate(INK) < 0.7 * whole
        await page.click("li[data-name='w=1'] input")

        await page.set("#axis", "z")
        cut = await page.evaluate(INK)
        assert cut < whole
        await page.set("#place", 0.001)
        assert await page.evaluate(INK) < 0.3 * whole
        await page.set("#axis", "")
        assert await page.evaluate(INK) == pytest.approx(whole, abs=1e-3)

        await page.click("#points")
        assert await page.evaluate(SHOWN) == ""
        assert await page.evaluate("page.shown.cloud.geometry.attributes.position.count") == 10**6
        assert await page.evaluate(INK) > 0.5 * whole

        outside = {url.split(":")[0] for url in page.requests()}
        assert outside <= {"file", "data"}
        assert page.complaints() == []

    visit(path.as_uri(), tmp_path, act)


def test_pieces_of_a_side_are_one_branch_folded_until_one_is_clicked(tmp_path: Path) -> None:
    path = tmp_path / "pieces.html"
    assert main(["view", "square_to_round", "-o", str(path)]) == 0
    inner = "#sides > li:first-child > ul > li:not([data-name]):nth-of-type(2)"
    told = f"document.querySelector('{inner} > .row').innerText.split(/\\s+/).join(' ').trim()"
    pieces = f"document.querySelectorAll('{inner} li[data-name^=\"w=0 (\"]').length"
    folded = f"document.querySelector('{inner} > ul').hidden"

    async def act(page: Page) -> None:
        count = await page.evaluate(pieces)
        assert count > 1
        assert await page.evaluate(told) == f"▸ w=0 {count}"
        assert await page.evaluate(folded)
        before = len((await page.evaluate(SHOWN)).split("w="))
        await page.click(f"{inner} > .row input")
        assert len((await page.evaluate(SHOWN)).split("w=")) == before - count
        await page.click(f"{inner} > .row input")
        await page.click(f"{inner} > .row .opener")
        assert not await page.evaluate(folded)
        assert page.complaints() == []

    visit(path.as_uri(), tmp_path, act)


async def tap(page: Page, x: float, y: float) -> None:
    for kind, buttons in (("mousePressed", 1), ("mouseReleased", 0)):
        await page.mouse(kind, x, y, button="left", buttons=buttons, clickCount=1)


async def key(page: Page, name: str) -> None:
    for kind in ("keyDown", "keyUp"):
        await page.call("Input.dispatchKeyEvent", type=kind, key=name, text=name[:1])
    await page.evaluate("new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))")


def test_measures_of_a_box_are_its_own(tmp_path: Path) -> None:
    template = tmp_path / "box.toml"
    sizes = 'x = "4*u"\ny = "3*v"\nz = "2*w"\n'
    template.write_text(f'title = "Box"\n[solid]\n{sizes}')
    path = tmp_path / "box.html"
    assert main(["view", str(template), "-o", str(path)]) == 0

    async def act(page: Page) -> None:
        x, y = await page.evaluate(MIDDLE)
        for view, through, axis in (("1", 3.0, 1), ("4", 4.0, 0), ("5", 2.0, 2)):
            await key(page, view)
            toward = await page.evaluate(
                "page.camera.getWorldDirection(page.camera.position.clone()).toArray()"
            )
            assert abs(toward[axis]) == pytest.approx(1.0, abs=1e-6), view
            await key(page, "t")
            await tap(page, x, y)
            assert await page.evaluate("page.measured.results.map(r => r.value)") == [
                pytest.approx(through, rel=1e-6)
            ]
            await key(page, "Escape")
        await key(page, "1")
        await key(page, "d")
        # a corner is caught from some pixels away: 4 x 2 seen from the front
        ends = "[[0,0,0],[4,0,2]].map(p => { const a = page.box.min.clone().set(...p)"
        ends += ".project(page.camera); return [(1+a.x)/2*innerWidth, (1-a.y)/2*innerHeight] })"
        (ax, ay), (bx, by) = await page.evaluate(ends)
        await tap(page, ax + 3, ay - 3)
        await tap(page, bx - 3, by + 3)
        (found,) = await page.evaluate("page.measured.results.map(r => r.value)")
        assert found == pytest.approx(20**0.5, rel=1e-6)
        await key(page, "Escape")
        await key(page, "x")
        await page.set("#at", 1.25)
        assert await page.evaluate("[page.cut.at, page.cut.area, page.cut.length]") == [
            pytest.approx(value, rel=2e-3 if value == 1.25 else 1e-5) for value in (1.25, 6.0, 10.0)
        ]
        await key(page, "n")
        assert await page.evaluate("document.documentElement.classList.contains('dark')")
        before = await page.evaluate("page.camera.zoom")
        await key(page, "+")
        assert await page.evaluate("page.camera.zoom") > before
        assert page.complaints() == []

    visit(path.as_uri(), tmp_path, act)


def test_fingers_turn_move_zoom_and_measure_on_a_small_screen(tmp_path: Path) -> None:
    path = tmp_path / "ball.html"
    assert main(["view", "hollow_ball", "-o", str(path)]) == 0

    async def act(page: Page) -> None:
        await page.call(
            "Emulation.setDeviceMetricsOverride",
            width=390, height=844, deviceScaleFactor=2, mobile=True,
        )  # fmt: skip
        await page.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=5)
        await page.click("#home")
        assert await page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        x, y = await page.evaluate(MIDDLE)
        place = "[...page.camera.position.toArray(), page.camera.zoom]"
        seen = [await page.evaluate(place)]
        await page.touch(*([(x - 60 + 20 * i, y + 5 * i)] for i in range(6)))
        seen.append(await page.evaluate(place))
        await page.touch(*([(x - 40 - 10 * i, y), (x + 40 + 10 * i, y)] for i in range(6)))
        seen.append(await page.evaluate(place))
        await page.touch(*([(x - 40, y + 10 * i), (x + 40, y + 10 * i)] for i in range(6)))
        seen.append(await page.evaluate(place))
        turned, zoomed, moved = (
            [abs(b - a) for a, b in zip(*pair, strict=True)] for pair in pairwise(seen)
        )
        assert max(turned[:3]) > 1
        assert turned[3] == 0
        assert zoomed[3] > 1
        assert max(moved[:3]) > 0.1
        assert moved[3] == pytest.approx(0, abs=0.05)
        await page.click("#home")
        await page.click("[data-measure=thickness]")
        await page.touch([(x, y)])
        (wall,) = await page.evaluate("page.measured.results.map(r => r.value)")
        assert wall == pytest.approx(1, rel=2e-2)
        await page.click("#clear")
        await page.touch([(x, y)])
        assert await page.evaluate("page.hovered") == "w=1"
        assert not await page.evaluate("document.getElementById('tip').hidden")
        assert page.complaints() == []

    visit(path.as_uri(), tmp_path, act)


def test_a_hollow_section_has_the_area_of_its_ring(tmp_path: Path) -> None:
    path = tmp_path / "ball.html"
    assert main(["view", "hollow_ball", "-o", str(path)]) == 0

    async def act(page: Page) -> None:
        await page.set("#axis", "z")
        area = await page.evaluate("page.cut.area")
        low, high = await page.evaluate("[page.box.min.x, page.box.max.x]")
        outer = (high - low) / 2
        await key(page, "5")
        x, y = await page.evaluate(MIDDLE)
        await key(page, "t")
        await page.set("#axis", "")
        await tap(page, x, y)
        (wall,) = await page.evaluate("page.measured.results.map(r => r.value)")
        ring = 3.141592653589793 * (outer**2 - (outer - wall) ** 2)
        assert area == pytest.approx(ring, rel=1e-2)
        assert 0 < wall < outer

    visit(path.as_uri(), tmp_path, act)


def test_stored_sliders_change_the_part(tmp_path: Path) -> None:
    path = tmp_path / "cut.html"
    arguments = ["view", "pyramid_cut", "-s", "q=1", "-s", "r=1", "--slider", "p=0.2,0.5,1"]
    assert main([*arguments, "-o", str(path)]) == 0

    async def act(page: Page) -> None:
        assert await page.evaluate("page.part.parameters.p") == 0.5
        await page.set("input[name=p]", 0)
        await page.until("page.part.parameters.p === 0.2")
        facts = await page.evaluate("document.getElementById('facts').textContent")
        assert "volume25.2 mm³" in facts  # 31.5 (1 - p)
        await page.set("input[name=p]", 2)  # p q r = 1: nothing is left
        await page.until("page.problem !== null")
        assert not await page.evaluate("document.getElementById('problem').hidden")
        await page.set("input[name=p]", 1)
        await page.until("page.problem === null && page.part.parameters.p === 0.5")
        assert page.complaints() == []

    visit(path.as_uri(), tmp_path, act)


async def arrived(folder: Path, ending: str) -> Path:
    """The file that the browser has written, once it is whole."""
    for _ in range(200):
        if found := list(folder.glob(f"*{ending}")):
            return found[0]
        await asyncio.sleep(0.05)
    raise AssertionError(f"no file {ending} came")


def test_a_served_page_has_its_parts_compiled_as_its_sliders_move(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pc2cad.cli.main", "view", "pyramid_cut", "--serve"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        url = process.stdout.readline().split()[0]

        async def act(page: Page) -> None:
            assert await page.evaluate("document.querySelectorAll('.slider').length") == 3
            await page.set("input[name=p]", 0.8)
            await page.until("page.part.parameters.p === 0.8")
            facts = await page.evaluate("document.getElementById('facts').textContent")
            assert f"volume{31.5 * (1 - 0.8 * 0.25 * 0.75):.10g} mm³" in facts
            for value in (0.1, 0.2, 0.3, 0.4):  # faster than parts are compiled
                await page.set("input[name=p]", value)
            await page.until("page.part.parameters.p === 0.4")
            assert await page.evaluate("page.problem") is None
            name = await page.evaluate("page.part.title")
            await page.call(
                "Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path)
            )
            for ending in (".step", ".stl"):
                await page.click(f"[data-file='{ending}']")
                await page.until(f"!document.querySelector(\"[data-file='{ending}']\").disabled")
                found = await arrived(tmp_path, ending)
                assert name.split()[0].lower() in found.name
                assert (
                    found.stat().st_size >= 84 + 8 * 50
                )  # of the smaller one, STL of eight triangles

        visit(url, tmp_path, act)
    finally:
        process.terminate()
        process.communicate(timeout=30)


#: a page that knows the address, secret and all, and tries what a page can try
FOREIGN = """<!DOCTYPE html><script>
const at = "@ADDRESS@", got = [];
const tried = (name, promise) => promise.then((x) => got.push(`${name} ${x}`), () => {});
async function attack() {
  await tried("read", fetch(at).then((r) => r.text()));
  await tried("part", fetch(at + "part?p=1").then((r) => r.arrayBuffer()));
  await fetch(at + "part?p=2", { mode: "no-cors" }).catch(() => {});
  await fetch(at + "part?p=3", { mode: "no-cors", method: "POST", body: "p=4" }).catch(() => {});
  await fetch(at + "part?p=5", { headers: { "X-Mine": "1" } }).catch(() => {});
  for (const [tag, address] of [["img", "part?p=6"], ["script", "part?p=7"], ["iframe", ""]]) {
    await new Promise((done) => {
      const thing = Object.assign(document.createElement(tag), { src: at + address });
      thing.onload = thing.onerror = () => done();
      document.documentElement.append(thing);
    });
  }
  const frame = document.querySelector("iframe");
  await tried("frame", (async () => frame.contentDocument.body.textContent.slice(0, 1) || null
  )().then((x) => x ?? Promise.reject()));
  return got;
}
window.page = { ready: true };
</script>"""


@pytest.mark.parametrize("place", ["port", "file"])
def test_a_page_from_elsewhere_gets_nothing_and_starts_no_work(tmp_path: Path, place: str) -> None:
    made: list[Any] = []
    asked: list[tuple[str, bool]] = []
    found = server(b"<!DOCTYPE html>secret", lambda values, stale: made.append(values) or b"part")
    admits = found.admits

    def spy(path: str, headers: Any) -> bool:
        asked.append((path.rpartition("/")[2], admits(path, headers)))
        return asked[-1][1]

    found.admits = spy  # type: ignore[method-assign]
    (tmp_path / "foreign.html").write_text(FOREIGN.replace("@ADDRESS@", found.address))

    class Folder(SimpleHTTPRequestHandler):
        def __init__(self, *given: Any) -> None:
            super().__init__(*given, directory=str(tmp_path))

        def log_message(self, *_: Any) -> None: ...

    foreign = ThreadingHTTPServer(("127.0.0.1", 0), Folder)
    servers: list[PageServer | ThreadingHTTPServer] = [found, foreign]
    for each in servers:
        threading.Thread(target=each.serve_forever, args=(0.05,), daemon=True).start()

    async def act(page: Page) -> None:
        assert await page.evaluate("attack()") == []
        # the same page, typed into the address bar, is shown
        asked.append(("", True))
        await page.call("Page.navigate", url=found.address)
        await page.until("document.body?.textContent === 'secret'")

    at = f"http://127.0.0.1:{foreign.server_address[1]}/foreign.html"
    try:
        visit(at if place == "port" else (tmp_path / "foreign.html").as_uri(), tmp_path, act)
    finally:
        for each in servers:
            each.shutdown()
            each.server_close()
    typed = asked.index(("", True))
    refused = [path for path, _ in asked[:typed]]
    assert len([path for path in refused if path.startswith("part?")]) >= 6
    assert "" in refused
    assert ("", True) in asked[typed + 1 :]
    assert made == []
