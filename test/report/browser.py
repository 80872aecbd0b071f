"""A page in headless Chromium, through its DevTools protocol: console errors, what is too wide, a picture.

    look(path, width=390, dark=True, picture="page.png")   # {"errors": [...], "width": 390, "cut": [...]}
"""

import asyncio
import base64
import contextlib
import json
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from urllib.request import urlopen

PROGRAM = next((found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None)
EVERYTHING = """(() => {
  const seen = e => e.getClientRects().length && getComputedStyle(e).visibility !== "hidden";
  const scrolls = e => e && (["auto", "scroll"].includes(getComputedStyle(e).overflowX) || scrolls(e.parentElement));
  const cut = [...document.querySelectorAll("body *")].filter(e => seen(e) && e.children.length === 0 && e.textContent.trim()
    && e.getBoundingClientRect().right > innerWidth + 1 && !scrolls(e) && !e.closest("svg"));
  const grey = e => getComputedStyle(e).color;
  return {width: document.scrollingElement.scrollWidth, height: document.scrollingElement.scrollHeight,
          cut: cut.map(e => e.textContent.trim().slice(0, 60)), text: document.body.innerText,
          background: getComputedStyle(document.body).backgroundColor, ink: grey(document.body)};
})()"""


def check_pages(paths, browser=None):
    """Assert that pages read in a browser, wide and light, narrow and dark: nothing on the console, nothing cut off.

    Does nothing where there is no Chromium.
    """
    if PROGRAM is None:
        return
    with contextlib.nullcontext(browser) if browser else Browser() as running:
        for path in paths:
            for width, dark in ((1400, False), (390, True)):
                assert Path(path).is_file(), path
                seen = running.look(path, width, dark)
                assert not seen["errors"] and not seen["cut"] and seen["width"] <= width, (path, width, seen["errors"], seen["cut"])


class Browser:
    """A running Chromium; closed with the ``with`` block."""

    def __enter__(self):
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self._process = subprocess.Popen(
            [PROGRAM, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--remote-debugging-port=0",
             "--remote-allow-origins=*", f"--user-data-dir={self._folder.name}", "about:blank"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        port_file, end = Path(self._folder.name) / "DevToolsActivePort", time.monotonic() + 60
        while not (port_file.exists() and port_file.read_text().strip()):
            assert self._process.poll() is None and time.monotonic() < end, "Chromium does not start"
            time.sleep(0.1)
        port = port_file.read_text().split()[0]
        end = time.monotonic() + 30
        while True:
            with urlopen(f"http://127.0.0.1:{port}/json") as answer:
                pages = [page for page in json.load(answer) if page["type"] == "page"]
            if pages:
                break
            assert time.monotonic() < end
            time.sleep(0.1)
        self._address = pages[0]["webSocketDebuggerUrl"]
        return self

    def __exit__(self, *error):
        self._process.terminate()
        self._process.wait(20)
        self._folder.cleanup()

    def look(self, path, width=1400, dark=False, picture=None, before=""):
        """Open a page: its console errors, its width, texts that stand beyond the window, its text and colours.

        Parameters
        ----------
        before : script that is run on the page first. picture : PNG of the whole page to write.
        """
        return asyncio.run(self._look(Path(path).resolve().as_uri(), width, dark, picture, before))

    async def _look(self, address, width, dark, picture, before):
        from tornado.websocket import websocket_connect

        socket = await websocket_connect(self._address, max_message_size=1 << 28)
        errors, numbers = [], iter(range(1, 1000))

        async def call(method, until=None, **parameters):
            number = next(numbers)
            socket.write_message(json.dumps({"id": number, "method": method, "params": parameters}))
            result = None
            while result is None or until:
                message = json.loads(await asyncio.wait_for(socket.read_message(), 60))
                kind, facts = message.get("method"), message.get("params", {})
                if kind == "Runtime.exceptionThrown":
                    errors.append(facts["exceptionDetails"].get("exception", {}).get("description", "exception"))
                elif kind == "Runtime.consoleAPICalled" and facts["type"] in ("error", "warning", "assert"):
                    errors.append(" ".join(str(part.get("value")) for part in facts["args"]))
                elif kind == "Log.entryAdded" and facts["entry"]["level"] in ("error", "warning"):
                    errors.append(facts["entry"]["text"])
                if kind == until:
                    until = None
                if message.get("id") == number:
                    result = message.get("result", {})
            return result

        async def evaluate(script):
            return (await call("Runtime.evaluate", expression=script, returnByValue=True))["result"].get("value")

        for domain in ("Page", "Runtime", "Log"):
            await call(f"{domain}.enable")
        await call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=width < 600)
        await call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}])
        await call("Page.navigate", until="Page.loadEventFired", url=address)
        if before:
            await evaluate(before)
        found = await evaluate(EVERYTHING)
        if picture:
            shot = await call("Page.captureScreenshot", format="png", captureBeyondViewport=True,
                              clip={"x": 0, "y": 0, "width": width, "height": min(found["height"], 12000), "scale": 1})
            Path(picture).write_bytes(base64.b64decode(shot["data"]))
        socket.close()
        return {"errors": errors, **found}
