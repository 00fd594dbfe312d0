"""Python with what Windows lacks taken away: loaded at the start of Python with this folder on PYTHONPATH.

Gone are termios, fcntl, pty, resource, fork, sessions and process groups, SIGKILL, SIGHUP, SIGQUIT,
CLOCK_BOOTTIME, `select` on anything but sockets, signal handlers of asyncio and netlink. Files behave as
there: a name may not hold <>:"|?*, and an open file can neither be replaced nor removed. A text file opened
by this project without an encoding is an error. Stand-ins for msvcrt, _winapi and pyserial are there, so
that Windows' own branches run. Not imitated: drive letters, a real console, and time stamps of 16 ms.

The standard library loads what it needs on this system before.
"""

from __future__ import annotations

import asyncio
import concurrent.futures.process  # noqa: F401
import fcntl
import getpass  # noqa: F401
import multiprocessing.resource_tracker
import multiprocessing.spawn  # noqa: F401
import os
import select
import shutil
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import time
import types
import warnings
from typing import Any

_flock, _exclusive, _kill, _parent = fcntl.flock, fcntl.LOCK_EX | fcntl.LOCK_NB, signal.SIGKILL, os.getppid
_select, _popen = select.select, subprocess.Popen.__init__


def _take_away() -> None:
    for module in ("termios", "tty", "fcntl", "pty", "resource", "pwd", "grp", "readline", "curses"):
        sys.modules[module] = None  # type: ignore[assignment]
    lacking: dict[Any, tuple[str, ...]] = {
        os: (
            *("fork", "forkpty", "setsid", "killpg", "getpgrp", "getpgid", "setpgrp", "setpgid", "openpty"),
            *("nice", "setpriority", "getpriority", "sched_getaffinity"),
        ),
        signal: ("SIGKILL", "SIGHUP", "SIGQUIT", "SIGALRM", "setitimer", "SIGSTOP", "SIGCHLD"),
        time: ("CLOCK_BOOTTIME", "CLOCK_MONOTONIC", "clock_gettime"),
        select: ("poll", "epoll"),
        socket: ("AF_NETLINK",),
    }
    for module, names in lacking.items():
        for name in names:
            if hasattr(module, name):
                delattr(module, name)
    signal.SIGBREAK = signal.SIGUSR1  # type: ignore[attr-defined]


def _sockets_only(*waited: Any) -> Any:
    lists = [list(each) for each in waited[:3]]
    if not any(lists):
        raise OSError(10022, "an invalid argument was supplied")
    for each in (one for some in lists for one in some):
        number = each if isinstance(each, int) else each.fileno()
        if number >= 0 and not stat.S_ISSOCK(os.fstat(number).st_mode):
            raise OSError(10038, "an operation was attempted on something that is not a socket")
    return _select(*waited)


def _started(self: Any, *arguments: Any, **options: Any) -> None:
    if options.get("preexec_fn") is not None:
        raise ValueError("preexec_fn is not supported on Windows platforms")
    if options.pop("creationflags", 0) & subprocess.CREATE_NEW_PROCESS_GROUP:  # type: ignore[attr-defined]
        options["start_new_session"] = True
    _popen(self, *arguments, **options)


def _no_handlers(*_: Any) -> None:
    raise NotImplementedError


def _stand_ins() -> None:
    msvcrt, winapi = types.ModuleType("msvcrt"), types.ModuleType("_winapi")

    def locking(number: int, mode: int, count: int) -> None:
        try:
            _flock(number, _exclusive)
        except OSError as error:
            raise PermissionError(13, "Permission denied") from error

    def wait(process: int, milliseconds: int) -> None:
        while _parent() == process:
            time.sleep(0.05)

    msvcrt.__dict__.update(LK_NBLCK=2, locking=locking, kbhit=lambda: False)
    winapi.__dict__.update(
        SYNCHRONIZE=0x100000, INFINITE=-1, OpenProcess=lambda a, b, process: process, WaitForSingleObject=wait
    )
    port = types.SimpleNamespace(device="COM5", name="COM5", description="CubeOrange (COM5)", vid=0x2DAE)
    serial, tools, ports = (
        types.ModuleType(n) for n in ("serial", "serial.tools", "serial.tools.list_ports")
    )

    class SerialException(OSError):
        pass

    def no_port(device: str, *_: Any, **__: Any) -> None:
        raise SerialException(f"could not open port {device!r}: FileNotFoundError(2, 'not found', None, 2)")

    serial.__dict__.update(Serial=no_port, SerialTimeoutException=SerialException, tools=tools)
    tools.__dict__.update(list_ports=ports)
    ports.__dict__.update(comports=lambda: [port])
    sys.modules |= {m.__name__: m for m in (msvcrt, winapi, serial, tools, ports)}


def _open_here(path: Any, folder: Any = None) -> bool:
    """Whether this process has the file open."""
    base = f"/proc/self/fd/{folder}" if isinstance(folder, int) and folder >= 0 else "."
    name = os.path.realpath(os.path.join(base, os.fsdecode(path)))
    for number in os.listdir("/proc/self/fd"):
        try:
            if os.readlink(f"/proc/self/fd/{number}") == name and os.path.isfile(name):
                return True
        except OSError:
            continue
    return False


def _files(event: str, arguments: tuple[Any, ...]) -> None:
    if event == "open" and isinstance(arguments[0], str | bytes):
        path, mode, flags = arguments
        if isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            _allowed(os.fsdecode(path))
        if mode is None and os.path.isdir(path):  # by os.open
            raise PermissionError(13, "Permission denied", path)
    elif event == "os.mkdir":
        _allowed(os.fsdecode(arguments[0]))
    elif event == "os.rename":
        source, target, source_folder, target_folder = arguments
        _allowed(os.fsdecode(target))
        if _open_here(source, source_folder) or _open_here(target, target_folder):
            raise PermissionError(13, "it is used by another process", target)
    elif event == "os.remove" and _open_here(*arguments):
        raise PermissionError(32, "it is used by another process", arguments[0])


def _allowed(path: str) -> None:
    if set(path) & set('<>:"|?*') and not path.startswith(("/proc/", "/dev/", "/sys/")):
        raise OSError(22, "Invalid argument", path)


if sys.platform == "linux":
    _take_away()
    subprocess.CREATE_NEW_PROCESS_GROUP = 0x200  # type: ignore[attr-defined]
    subprocess.BELOW_NORMAL_PRIORITY_CLASS = 0x4000  # type: ignore[attr-defined]
    subprocess.Popen.__init__ = _started  # type: ignore[method-assign]
    subprocess.Popen.kill = lambda self: self.send_signal(_kill)  # type: ignore[method-assign]
    shutil._use_fd_functions = False  # type: ignore[attr-defined]
    tempfile.TemporaryFile = tempfile.NamedTemporaryFile  # type: ignore[assignment]
    select.select = _sockets_only
    asyncio.SelectorEventLoop.add_signal_handler = _no_handlers  # type: ignore[method-assign]
    _stand_ins()
    sys.addaudithook(_files)
    warnings.filterwarnings("ignore", category=EncodingWarning)
    warnings.filterwarnings("error", category=EncodingWarning, module=r"rover_sweep|sitl|firmware_params")
