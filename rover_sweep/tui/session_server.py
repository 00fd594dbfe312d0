"""Serves the terminal session to one browser, by textual-serve.

Each connection has a program of its own, which ends with it: the page closed or lost for `SILENT` seconds,
the program is asked to end, which ends a run as SPACE does. If it does not, it is killed; then its
overrides and heartbeats end and the rover's applet (SWP_GCS) ends the run.
"""

from __future__ import annotations

import asyncio
import logging
import re
import secrets
from asyncio.subprocess import PIPE, Process
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from typing import cast

from aiohttp import web
from textual_serve.app_service import AppService
from textual_serve.server import Server, to_int

SILENT = 2.0  # s between pings of the page; it is lost after half as long without an answer
QUIT_WITHIN = 20.0  # s that the program has to let the rover go
TAKEN = "This session is open in another browser window. Close it there, then load this page again."
ELSEWHERE = re.compile(r"<link[^>]*https?://fonts[^>]*>")  # a field has no network, and the page would wait
KEYS = """<script>
  // Every key reaches the session, SPACE and ESC first of all, without a click before.
  const type = () => document.body.classList.contains("-closed")
    || document.querySelector(".xterm-helper-textarea")?.focus();
  new MutationObserver(type).observe(document.body, { attributes: true, childList: true, subtree: true });
  addEventListener("focus", type);
  addEventListener("focusout", () => setTimeout(type));
</script>
"""
FOREIGN = "Only a page of this server may open the session."
NO_KEY = "Open the address that `rover-sweep session --web` printed: it ends with the key of this session."


async def _closed(websocket: web.WebSocketResponse) -> None:
    await websocket.close()


class SessionProgram(AppService):
    """The session's program behind one page."""

    def __init__(self, argv: Sequence[str], websocket: web.WebSocketResponse, server: Server) -> None:
        super().__init__(
            " ".join(argv),
            write_bytes=websocket.send_bytes,
            write_str=websocket.send_str,
            close=partial(_closed, websocket),
            download_manager=server.download_manager,
        )
        self._argv = argv

    async def _open_app_process(self, width: int = 80, height: int = 24) -> Process:
        """Start it without a shell: the program watches its parent, and a kill reaches it."""
        environment = self._build_environment(width=width, height=height)
        process = await asyncio.create_subprocess_exec(
            *self._argv, stdin=PIPE, stdout=PIPE, stderr=PIPE, env=environment
        )
        self._process, self._stdin = process, process.stdin
        return process

    async def end(self) -> None:
        """Tell the program to end and wait; kill it if it does not. Its output is dropped."""
        process, task = self._process, self._task
        if process is None:
            return
        with suppress(ProcessLookupError):
            process.terminate()  # the program aborts at once; textual-serve's "quit" first closes the views
        if task is not None:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            self._task = None
        assert process.stdout is not None
        try:
            await asyncio.wait_for(asyncio.gather(process.stdout.read(), process.wait()), QUIT_WITHIN)
        except TimeoutError:
            process.kill()
            await process.wait()


class SessionServer(Server):
    """One page at a time; refuses a second page, one of another site, and one without the session's key.

    address: of the page, with the key; the page keeps the key in a cookie.
    """

    def __init__(self, argv: Sequence[str], host: str, port: int) -> None:
        shown = f"[{host}]" if ":" in host else host
        super().__init__("rover-sweep session", host, port, public_url=f"http://{shown}:{port}")
        self._argv = argv
        self._program: SessionProgram | None = None
        self._key, self._cookie = secrets.token_urlsafe(12), f"key-{port}"  # cookies know no ports
        self.address = f"{self.public_url}/?key={self._key}"

    def initialize_logging(self) -> None:
        """Warnings only: each request of the page would be a line."""
        logging.basicConfig(level="WARNING", format="%(message)s")

    async def handle_index(self, request: web.Request) -> web.StreamResponse:
        """The page, or the sentence that it is open already; under its one address."""
        if f"http://{request.host}" != self.public_url:
            raise web.HTTPFound(f"{self.public_url}{request.rel_url}")
        self._check(request.query.get("key"), request.cookies.get(self._cookie))
        if self._program is not None:
            return web.Response(status=409, text=TAKEN)
        page = cast(web.Response, await super().handle_index(request))
        page.text = ELSEWHERE.sub("", page.text or "").replace("</body>", KEYS + "</body>")
        page.headers["Cache-Control"] = "no-store"  # left for another page, it is closed and not kept
        page.headers["X-Frame-Options"] = "DENY"
        page.set_cookie(self._cookie, self._key, httponly=True, samesite="Strict")
        return page

    def _check(self, *keys: str | None) -> None:
        """HTTPForbidden if none of the keys is that of the session."""
        given = [(key or "").encode(errors="replace") for key in keys]
        if not any(secrets.compare_digest(key, self._key.encode()) for key in given):
            raise web.HTTPForbidden(text=NO_KEY)

    async def handle_websocket(self, request: web.Request) -> web.WebSocketResponse:
        """The connection of a page, from its begin to the end of its program."""
        if request.headers.get("Origin") != self.public_url:
            raise web.HTTPForbidden(text=FOREIGN)
        self._check(request.cookies.get(self._cookie))
        if self._program is not None:
            raise web.HTTPConflict(text=TAKEN)
        websocket = web.WebSocketResponse(heartbeat=SILENT)
        program = self._program = SessionProgram(self._argv, websocket, self)
        try:
            await websocket.prepare(request)
            size = (to_int(request.query.get(name, str(least)), least) for name, least in SIZE.items())
            await program.start(*size)
            await self._process_messages(websocket, program)
        finally:
            await asyncio.shield(program.end())
            self._program = None
        return websocket

    async def on_startup(self, app: web.Application) -> None:
        """Print the page's address."""
        print(f"the session is at {self.address} ; Ctrl-C here ends it", flush=True)

    async def on_shutdown(self, app: web.Application) -> None:
        """End the program with the server."""
        if self._program is not None:
            await self._program.end()


SIZE = {"width": 80, "height": 24}
