"""A page and the program behind it: one page, and each ends with the other."""

from __future__ import annotations

import asyncio
import re
import socket
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

pytest.importorskip("textual_serve")
from aiohttp import ClientSession, CookieJar, WSServerHandshakeError, web

from rover_sweep.cli.commands import session as served_session
from rover_sweep.cli.commands.session import program
from rover_sweep.cli.main import run
from rover_sweep.system import end_with_parent
from rover_sweep.tui import session_server
from rover_sweep.tui.session_server import SessionServer


@pytest.fixture
def unused_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


OBEYS = """
import signal, sys, pathlib
def ended(*_):
    pathlib.Path({mark!r}).write_text("told to end")
    raise SystemExit
signal.signal(signal.SIGTERM, ended)
sys.stdout.write("__GANGLION__\\n"); sys.stdout.flush()
pathlib.Path({mark!r}).write_text("started")
while True:
    signal.pause()
"""
DEAF = """
import signal, sys, pathlib, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
sys.stdout.write("__GANGLION__\\n"); sys.stdout.flush()
pathlib.Path({mark!r}).write_text("started")
time.sleep(60)
pathlib.Path({mark!r}).write_text("went on")
"""


def with_server(
    behaviour: str, mark: Path, port: int, test: Callable[[ClientSession, SessionServer], Awaitable[None]]
) -> None:
    async def whole() -> None:
        server = SessionServer([sys.executable, "-c", behaviour.format(mark=str(mark))], "127.0.0.1", port)
        runner = web.AppRunner(await server._make_app())
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", port).start()
        try:
            jar = CookieJar(unsafe=True)  # keeps cookies of an address of numbers
            async with ClientSession(headers={"Origin": server.public_url}, cookie_jar=jar) as client:
                async with client.get(server.address) as page:
                    assert page.status == 200
                await test(client, server)
        finally:
            await runner.cleanup()

    asyncio.run(whole())


async def until(true: Callable[[], bool]) -> None:
    for _ in range(200):
        if true():
            return
        await asyncio.sleep(0.05)
    raise AssertionError("waited 10 s")


def marked(mark: Path, words: str) -> Callable[[], bool]:
    return lambda: mark.is_file() and mark.read_text() == words


def test_the_program_is_told_to_end_when_its_page_closes(tmp_path: Path, unused_port: int) -> None:
    mark = tmp_path / "mark"

    async def closing(client: ClientSession, server: SessionServer) -> None:
        async with client.ws_connect(f"{server.public_url}/ws"):
            await until(marked(mark, "started"))
        await until(marked(mark, "told to end"))
        await until(lambda: server._program is None)

    with_server(OBEYS, mark, unused_port, closing)


def test_one_that_does_not_quit_is_killed(tmp_path, unused_port, monkeypatch):
    monkeypatch.setattr(session_server, "QUIT_WITHIN", 0.3)
    mark = tmp_path / "mark"

    async def closing(client: ClientSession, server: SessionServer) -> None:
        async with client.ws_connect(f"{server.public_url}/ws"):
            await until(marked(mark, "started"))
            process = server._program._process
        await until(lambda: process.returncode is not None)
        assert process.returncode == -9
        await until(lambda: server._program is None)

    with_server(DEAF, mark, unused_port, closing)


def test_a_second_page_and_another_site_are_refused(tmp_path: Path, unused_port: int) -> None:
    async def refused(client: ClientSession, server: SessionServer) -> None:
        address = f"{server.public_url}/ws"
        with pytest.raises(WSServerHandshakeError) as foreign:
            await client.ws_connect(address, headers={"Origin": "http://elsewhere.example"})
        assert foreign.value.status == 403
        async with client.ws_connect(address):
            with pytest.raises(WSServerHandshakeError) as second:
                await client.ws_connect(address)
            assert second.value.status == 409
            async with client.get(server.public_url) as page:
                assert (page.status, await page.text()) == (409, session_server.TAKEN)
        await until(lambda: server._program is None)
        async with client.get(server.public_url) as page:
            assert page.status == 200

    with_server(OBEYS, tmp_path / "mark", unused_port, refused)


def test_without_the_key_nothing_opens(tmp_path: Path, unused_port: int) -> None:
    async def refused(_: ClientSession, server: SessionServer) -> None:
        async with ClientSession(headers={"Origin": server.public_url}) as stranger:
            for address in (server.public_url, f"{server.public_url}/?key=guessed"):
                async with stranger.get(address) as page:
                    assert (page.status, await page.text()) == (403, session_server.NO_KEY)
            for headers in ({}, {"Cookie": f"{server._cookie}=\udcff"}):
                with pytest.raises(WSServerHandshakeError) as without:
                    await stranger.ws_connect(f"{server.public_url}/ws", headers=headers)
                assert without.value.status == 403
        assert server._program is None

    with_server(OBEYS, tmp_path / "mark", unused_port, refused)


def test_the_page_takes_keys_without_a_click_and_needs_no_network(tmp_path: Path, unused_port: int) -> None:
    async def looked_at(client: ClientSession, server: SessionServer) -> None:
        async with client.get(server.public_url) as page:
            text = await page.text()
        assert session_server.KEYS in text
        addresses = set(re.findall(r"(?:src|href)=\"(https?://[^/\"]+)", text))
        assert addresses == {server.public_url}

    with_server(OBEYS, tmp_path / "mark", unused_port, looked_at)


def test_the_program_of_a_page_has_the_options_of_the_command() -> None:
    given = ["session", "--web", "--connect", "udp:0.0.0.0:14550", "--web-port", "9000", "--web-host=::1"]
    assert program(given)[1:] == ["-m", "rover_sweep", *given[:1], *given[2:4], "--in-browser"]


def test_the_session_ends_when_its_server_dies() -> None:
    parents = iter([7, 7, 1])
    ended: list[bool] = []
    end_with_parent(lambda: ended.append(True), lambda: next(parents)).join(5)
    assert ended == [True]


def test_no_address_for_everybody(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["session", "--web", "--web-host", "0.0.0.0"]) == 2
    assert "is no single address; give the one of this computer" in capsys.readouterr().err


def test_the_network_is_warned_of(capsys, monkeypatch):
    monkeypatch.setattr(SessionServer, "serve", lambda server: None)
    served_session.serve("192.0.2.7", 8000)
    assert "reads the network of 192.0.2.7, can drive the rover" in capsys.readouterr().err
    served_session.serve("127.0.0.1", 8000)
    assert capsys.readouterr().err == ""
