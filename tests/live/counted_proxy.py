"""A TCP relay between a rover and a ground station that knows every byte it passed on, and can be cut."""

from __future__ import annotations

import contextlib
import select
import socket
import threading


class CountedProxy:
    """url: where the station connects. to_station: what went there on the last connection; from_station:
    what came from it. `cut` breaks the connection; new ones are refused until `mend`."""

    def __init__(self, rover_url: str) -> None:
        _, host, port = rover_url.split(":")
        self._rover = (host, int(port))
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._port = self._listener.getsockname()[1]
        self.to_station = self.from_station = b""
        self.station: socket.socket | None = None
        self._cut, self._end = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        return f"tcp:127.0.0.1:{self._port}"

    def cut(self) -> None:
        self._cut.set()

    def mend(self) -> None:
        self._cut.clear()

    def __enter__(self) -> CountedProxy:
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join(5)
        self._listener.close()

    def _serve(self) -> None:
        self._listener.settimeout(0.02)
        while not self._end.is_set():
            try:
                station, _ = self._listener.accept()
            except TimeoutError:
                continue
            with station:
                if not self._cut.is_set():
                    self._relay(station)

    def _relay(self, station: socket.socket) -> None:
        with socket.create_connection(self._rover) as rover, contextlib.suppress(OSError):
            for each in (station, rover):
                each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            station.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 16384)
            self.to_station = self.from_station = b""
            self.station = station
            while not (self._end.is_set() or self._cut.is_set()):
                ready = select.select([station, rover], [], [], 0.02)[0]
                if station in ready:
                    data = station.recv(65536)
                    if not data:
                        return
                    self.from_station += data
                    rover.sendall(data)
                if rover in ready and not self._pass_on(rover, station):
                    return

    def _pass_on(self, rover: socket.socket, station: socket.socket) -> bool:
        data = rover.recv(16384)
        while data and not self._end.is_set():
            if select.select([], [station], [], 0.02)[1]:
                sent = station.send(data)
                self.to_station += data[:sent]
                data = data[sent:]
            elif self._cut.is_set():
                return False
            if not data:
                return True
        return False
