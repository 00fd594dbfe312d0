"""Differences of Linux, macOS and Windows: the only module with calls that one of them lacks.

A call is looked for when it is needed, not by the name of the system. Windows' side was never run on a real
Windows; `tests/windows` imitates one.
"""

from __future__ import annotations

import contextlib
import importlib
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

STOP_SIGNALS: tuple[signal.Signals, ...] = tuple(
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGBREAK")
    if hasattr(signal, name)
)
"""Ctrl-C, `kill`, a closed terminal, Ctrl-\\ (SIGBREAK: a closed window of Windows, and Ctrl-Break)."""

_ON_ITS_WAY = 1.0  # s for which a KeyboardInterrupt is on its way to the code that releases the rover
_NICENESS = 10
_POLL = 0.2  # s


def _optional(name: str) -> Any:
    """A module of the standard library; None if the system lacks it."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def since_boot() -> float:
    """Seconds from any origin, never going back; continues while the computer sleeps.

    Linux: CLOCK_MONOTONIC stops in suspend, CLOCK_BOOTTIME does not. macOS: CLOCK_MONOTONIC continues, and
    Python's `monotonic` (mach_absolute_time) stops. Windows: `monotonic` continues.
    """
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    if clock is None and sys.platform == "darwin":
        clock = time.CLOCK_MONOTONIC
    return time.monotonic() if clock is None else time.clock_gettime(clock)


def processors() -> int:
    """The processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def hold_folder(folder: Path) -> int:
    """A file descriptor that locks the folder for this program until it is closed; -1 where the file system
    has no locks. BlockingIOError if another program holds it. Windows locks the file `.lock` in it."""
    fcntl, msvcrt = _optional("fcntl"), _optional("msvcrt")
    held = -1
    with contextlib.suppress(OSError):
        if fcntl is not None:
            held = os.open(folder, os.O_RDONLY)
        elif msvcrt is not None:
            held = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT, 0o666)
    if held < 0:
        return held
    try:
        if fcntl is not None:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        else:
            msvcrt.locking(held, msvcrt.LK_NBLCK, 1)
    except (BlockingIOError, PermissionError) as error:  # PermissionError: of Windows
        os.close(held)
        raise BlockingIOError(*error.args) from None
    except OSError:
        os.close(held)
        return -1
    return held


def drop_typed() -> None:
    """Drop the keys that wait in the terminal of stdin."""
    termios, msvcrt = _optional("termios"), _optional("msvcrt")
    if termios is not None:
        with contextlib.suppress(termios.error):
            termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)
    elif msvcrt is not None:
        while msvcrt.kbhit():
            msvcrt.getwch()


# Stop signals in a row: the first one ends a run, the others must not end the release of the rover.


class _Stops:
    """The state of the blocks below, of which the main thread has one.

    depth: blocks of `one_stop`; came: a signal has come; held: no signal raises; allowed: one more raises;
    raised: time at which the last one raised [s].
    """

    def __init__(self) -> None:
        self.depth, self.before = 0, dict[signal.Signals, Any]()
        self.came = self.held = self.allowed = False
        self.raised = -math.inf

    def pressed(self, *_: object) -> None:
        self.came, now = True, time.monotonic()
        on_its_way = now - self.raised < _ON_ITS_WAY
        if not self.allowed and (self.held or on_its_way):
            return
        self.allowed, self.raised = False, now
        raise KeyboardInterrupt

    def begin(self) -> None:
        self.depth += 1
        if self.depth > 1:
            return
        self.came = self.held = self.allowed = False
        self.raised = -math.inf
        raises = {n: h for n in STOP_SIGNALS if (h := signal.getsignal(n)) == signal.default_int_handler}
        self.before = raises
        for number in raises:
            signal.signal(number, self.pressed)

    def end(self) -> None:
        self.depth -= 1
        if self.depth:
            return
        self.held = self.allowed = False
        for number, handler in self.before.items():
            if signal.getsignal(number) == self.pressed:
                signal.signal(number, handler)


_STOPS = _Stops()


def _is_main() -> bool:
    return threading.current_thread() is threading.main_thread()


@contextlib.contextmanager
def one_stop() -> Iterator[Callable[[], bool]]:
    """Within it a stop signal raises KeyboardInterrupt, but none in the second after it, and none after
    `hold_stops`: what the first one begins is not ended by others.

    Gives a function that tells whether one came. For signals that raise KeyboardInterrupt outside of it too;
    without effect in other threads.
    """
    if not _is_main():
        yield lambda: False
        return
    _STOPS.begin()
    try:
        yield lambda: _STOPS.came
    finally:
        if _is_main():
            _STOPS.end()


def hold_stops() -> None:
    """From here to the end of `one_stop`, stop signals raise only within `another_stop`."""
    if _is_main() and _STOPS.depth:
        _STOPS.held = True


@contextlib.contextmanager
def another_stop() -> Iterator[None]:
    """Within it one more stop signal raises KeyboardInterrupt."""
    if not (_is_main() and _STOPS.depth):
        yield
        return
    try:
        _STOPS.allowed = True
        yield
    finally:
        _STOPS.allowed = False


# Processes: started in a group of their own, so that Ctrl-C reaches only the program that started them;
# ended with everything that they started; ended when their parent dies.


def own_group(yielding: bool = False) -> dict[str, Any]:
    """Arguments of Popen. yielding: with a lower priority than this program (POSIX: `yield_to_others`)."""
    flags = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
    if not flags:
        return {"start_new_session": True}
    lower: int = getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0)
    return {"creationflags": flags | (lower if yielding else 0)}


def yield_to_others(process: int) -> None:
    """Lower the priority of a process started with `own_group`; Windows has done it at the start."""
    if hasattr(os, "setpriority"):
        with contextlib.suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, process, _NICENESS)


def kill_group(program: subprocess.Popen[bytes]) -> None:
    """Kill a program started with `own_group` and all that it started. On Windows only if it still runs:
    afterwards nothing names what it started."""
    if hasattr(os, "killpg"):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(program.pid, signal.SIGKILL)
    elif program.poll() is None:
        with contextlib.suppress(OSError):
            subprocess.run(["taskkill", "/F", "/T", "/PID", str(program.pid)], capture_output=True)
    program.kill()
    program.wait()


def end_own_group() -> None:
    """Ask all other processes of the group to end, if this process leads it."""
    if hasattr(os, "killpg") and os.getpgrp() == os.getpid():
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        os.killpg(0, signal.SIGTERM)


def end_with_parent(
    end: Callable[[], object] | None = None, parent: Callable[[], int] = os.getppid
) -> threading.Thread:
    """Call `end` once, from a thread, when the process that started this one is gone.

    By default this process ends at once: for the workers of a pool, which hold each other's pipes open, so
    that none of them sees that the program is gone. A POSIX process then has another parent; Windows never
    changes it, but lets us wait for it.
    """
    first = parent()
    winapi = _optional("_winapi")
    handle = None
    if winapi is not None:
        with contextlib.suppress(OSError):
            handle = winapi.OpenProcess(winapi.SYNCHRONIZE, False, first)

    def watch() -> None:
        if handle is not None:
            winapi.WaitForSingleObject(handle, winapi.INFINITE)
        while handle is None and parent() == first:
            time.sleep(_POLL)
        end() if end else os._exit(1)

    thread = threading.Thread(target=watch, name="parent watch", daemon=True)
    thread.start()
    return thread
