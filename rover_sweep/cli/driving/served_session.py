"""`session --web`: the server, and the command of the program behind its page."""

from __future__ import annotations

import ipaddress
import os
import sys
from collections.abc import Sequence

from rover_sweep.cli.views.output import narration
from rover_sweep.errors import UsageError, missing_extra

OPEN = "warning: whoever reaches {host} can drive the rover from this page; there is no password"
ALL = ("0.0.0.0", "::", "")


def serve(host: str, port: int) -> None:
    """Serve the session of this command line until Ctrl-C; UsageError where that is not possible."""
    if os.name == "nt":
        raise UsageError("the session in a browser needs Linux or macOS; use `rover-sweep session` here")
    try:
        from rover_sweep.tui.browser.session_server import SessionServer
    except ImportError:
        raise missing_extra("the session in a browser needs textual-serve", "web") from None
    if host in ALL:
        raise UsageError(
            f"--web-host {host!r} is no single address; give the one of this computer in the network of the "
            "browser, as in --web-host 192.168.1.20"
        )
    if not _is_loopback(host):
        narration().print(OPEN.format(host=host), style="yellow", markup=False, soft_wrap=True)
    try:
        SessionServer(program(sys.argv[1:]), host, port).serve()
    except OSError as error:  # the port is taken, or the address is not one of this computer
        raise UsageError(
            f"cannot serve at {host} port {port}: {error.strerror}; try --web-port {port + 1}"
        ) from None


def program(arguments: Sequence[str]) -> list[str]:
    """The command of the program behind the page, from the arguments of `session --web`."""
    kept, skip = [], False
    for argument in arguments:
        name = argument.partition("=")[0]
        if not skip and name not in ("--web", "--web-host", "--web-port"):
            kept.append(argument)
        skip = not skip and name in ("--web-host", "--web-port") and "=" not in argument
    return [sys.executable, "-m", "rover_sweep", *kept, "--in-browser"]


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
