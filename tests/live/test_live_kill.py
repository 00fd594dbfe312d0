"""The program killed at a random instant while it drives: nothing that was received is lost, and a new
process finishes what was planned."""

from __future__ import annotations

import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

from asked_source import PLAN
from counted_proxy import CountedProxy

from rover_sweep.cli.main import run as rover_sweep
from rover_sweep.session.folder import read_folder
from rover_sweep.session.session import session_runs
from rover_sweep.vehicle.link.mavlink import Framer
from sitl import launcher
from sitl.ground.unread import PeerQueue
from tests.vehicle.simulated_drive import READY

_STATION = """
import sys, pathlib
from asked_source import PLAN, SETTINGS, Asked
from rover_sweep.live.source import DriveRequest
with Asked(pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3])) as asked:
    asked.source.session.plan(PLAN)
    asked.connect(sys.argv[1])
    planned = asked.source.session.to_drive[0]
    print("drives", planned.name, flush=True)
    assert asked.do(DriveRequest(planned, SETTINGS)) == ""
"""
ROVER_FILE = Path(__file__).parents[1] / "data" / "rover.toml"


def station(url: str, folder: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", _STATION, url, str(folder), str(ROVER_FILE)]
    here = Path(__file__)
    paths = os.pathsep.join([str(here.parents[2]), str(here.parent)])
    return subprocess.Popen(
        command, env={**os.environ, "PYTHONPATH": paths}, stdout=subprocess.PIPE, text=True
    )


def frames_of(tlog: Path) -> list[bytes]:
    """The frames of a .tlog, each after 8 bytes of time; of the last one a part may be missing."""
    frames, data, at = list[bytes](), tlog.read_bytes(), 8
    while at + 12 < len(data):
        length = 12 + data[at + 1]  # MAVLink 2, unsigned
        assert data[at] == 0xFD, f"{tlog.name} is damaged at {at} of {len(data)}"
        frames.append(data[at : at + length])
        at += length + 8
    return frames


def unread(proxy: CountedProxy) -> int:
    """Bytes that wait in the station's socket."""
    assert proxy.station is not None
    own, peer = proxy.station.getsockname(), proxy.station.getpeername()
    queue = PeerQueue(socket.IPPROTO_TCP, own, peer)
    count = queue.unread()
    queue.close()
    assert count is not None
    return count


def test_killed_while_driving_nothing_received_is_lost(tmp_path, monkeypatch, capsys):
    folder = tmp_path / "session"
    with (
        launcher.start_embedded(tmp_path / "vehicle", options=READY, speedup=8) as rover,
        CountedProxy(rover.connection) as proxy,
    ):
        killed = station(proxy.url, folder)
        assert killed.stdout is not None and killed.stdout.readline() == "drives sweep1\n"
        while not (folder / "sweep1.tlog").exists():  # what comes before it is no run that was cut
            time.sleep(0.01)
        time.sleep(random.uniform(0.1, 1.5))
        killed.send_signal(signal.SIGSTOP)  # so that what was received can be counted
        time.sleep(0.1)
        count, waiting = -1, 0
        while count != len(proxy.to_station):  # until nothing came in between the two
            count, waiting = len(proxy.to_station), unread(proxy)
        received = proxy.to_station[: count - waiting]
        killed.send_signal(signal.SIGKILL)
        killed.wait()
        sent = [frame for frame, whole in Framer().feed(received) if whole]
        kept = frames_of(folder / "connect.tlog") + frames_of(folder / "sweep1.tlog")
        print("received", len(received), "bytes in", len(sent), "frames; kept", len(kept))
        assert kept[: len(sent)] == sent[: len(kept)]
        lost = sum(map(len, sent[len(kept) :]))
        assert lost <= 16384  # bytes: one read of the socket is in its hands

        again = station(proxy.url, folder)
        assert again.wait(60) == 0
        assert [run.name for run in read_folder(folder).to_drive] == ["doublet"]

        # The rest without any screen; identifying from it is tested elsewhere.
        monkeypatch.setattr("rover_sweep.cli.driving.session_display.identify_session", lambda *_: None)
        asked_for = ["--arm", "--throttle", "1710", "--throw-switch"]
        assert rover_sweep(["resume", str(folder), "--connect", rover.connection, *asked_for]) == 0
        assert rover_sweep(["resume", str(folder), "--connect", rover.connection, *asked_for]) == 2
        assert "no runs remain" in capsys.readouterr().err
    content = read_folder(folder)
    assert [(run.label, run.state) for run in content.runs] == [
        ("sweep1", "cut"),
        ("sweep1-2", "done"),
        ("doublet", "done"),
    ]
    assert content.to_drive == () and content.plan == PLAN
    assert [log.runs for log in content.logs if log.runs] == [("sweep1-2", "doublet")]
    assert [run.name for run in session_runs(folder)] == ["sweep1-2", "doublet"]
    assert rover_sweep(["status", str(folder), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [run["state"] for run in told["runs"]] == ["cut", "done", "done"] and told["to_drive"] == []
