"""A page opened in headless Chromium and asked: what it says, what it loaded, what it complained of."""

from __future__ import annotations

import asyncio
import shutil
import subprocess
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import aiohttp

T = TypeVar("T")
ANSWER_S = 60.0
"""Longest wait for one answer, on a machine that does other things too."""


def find_browser() -> str | None:
    """Return the path of a Chromium, None where there is none."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@dataclass(slots=True)
class Tab:
    """One tab, by the browser's debugging protocol."""

    socket: aiohttp.ClientWebSocketResponse
    """Where it listens."""
    told: list[dict[str, Any]] = field(default_factory=list)
    """Events, in order."""
    waiting: dict[int, asyncio.Future[dict[str, Any]]] = field(default_factory=dict)
    """Answers that are due."""
    asked: int = 0
    """Commands sent."""

    async def listen(self) -> None:
        """Sort what comes into answers and events."""
        async for message in self.socket:
            found = message.json()
            if "id" in found:
                self.waiting.pop(found["id"]).set_result(found)
            else:
                self.told.append(found)

    async def send(self, method: str, **params: Any) -> dict[str, Any]:
        """Return the answer to a command."""
        self.asked += 1
        answer = self.waiting[self.asked] = asyncio.get_running_loop().create_future()
        await self.socket.send_json({"id": self.asked, "method": method, "params": params})
        found = await asyncio.wait_for(answer, ANSWER_S)
        assert "error" not in found, found
        return dict(found["result"])

    async def run(self, code: str) -> Any:
        """Return the value of a JavaScript expression in the page."""
        found = await self.send("Runtime.evaluate", expression=code, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    async def open(self, uri: str, ready: str = "true") -> None:
        """Open a page afresh and wait until a JavaScript expression is true there."""
        await self.send("Page.navigate", url="about:blank")
        await self.send("Page.navigate", url=uri)
        await self.until(ready)

    async def until(self, ready: str) -> None:
        """Wait until a JavaScript expression is true."""
        async with asyncio.timeout(ANSWER_S):
            while not await self.run(f"document.readyState === 'complete' && Boolean({ready})"):
                await asyncio.sleep(0.02)

    async def key(self, key: str) -> None:
        """Press a key."""
        await self.send("Input.dispatchKeyEvent", type="keyDown", key=key, text=key if len(key) == 1 else "")
        await self.send("Input.dispatchKeyEvent", type="keyUp", key=key)

    def complaints(self) -> list[dict[str, Any]]:
        """Return console messages, errors and refusals."""
        kinds = ("Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded")
        return [event["params"] for event in self.told if event["method"] in kinds]

    def requests(self) -> list[str]:
        """Return what was asked for, by address."""
        return [
            event["params"]["request"]["url"] for event in self.told if event["method"] == "Network.requestWillBeSent"
        ]


def browse(profile: Path, work: Callable[[Tab], Awaitable[T]]) -> T:
    """Return what `work` makes of a tab of a new browser.

    Args:
        profile: Folder for the browser's files.
        work: Uses the tab.
    """
    browser = find_browser()
    assert browser is not None
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={profile}"]
    command += ["--remote-debugging-port=0", "about:blank"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            return asyncio.run(_in_tab(profile / "DevToolsActivePort", work))
        finally:
            process.terminate()


async def _in_tab(listens: Path, work: Callable[[Tab], Awaitable[T]]) -> T:
    async with asyncio.timeout(ANSWER_S):
        while not (listens.exists() and listens.read_text().count("\n")):
            await asyncio.sleep(0.05)
    host = f"127.0.0.1:{listens.read_text().split()[0]}"
    async with aiohttp.ClientSession() as session:
        async with session.get(f"http://{host}/json") as response:
            page = next(target for target in await response.json() if target["type"] == "page")
        async with session.ws_connect(page["webSocketDebuggerUrl"], max_msg_size=0) as socket:
            tab = Tab(socket)
            listening = asyncio.create_task(tab.listen())
            for domain in ("Page", "Runtime", "Network", "Log"):
                await tab.send(f"{domain}.enable")
            try:
                return await work(tab)
            finally:
                listening.cancel()
