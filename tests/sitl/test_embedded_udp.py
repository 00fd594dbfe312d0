"""The embedded rover over UDP, its command line, and how it ends."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from embedded_client import ROOT
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.vehicle_parameters import ParameterStore
from sitl.embedded import listening_address, main, parser, prepare
from sitl.ground.server import UdpPeer


def test_udp_sends_first_and_hears_the_answer(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind(("127.0.0.1", 0))
        ground.settimeout(10.0)
        target = f"127.0.0.1:{ground.getsockname()[1]}"
        command = [sys.executable, "-m", "sitl.embedded", "--udp", target, "--directory", str(tmp_path)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as program:
            try:
                assert program.stdout is not None
                assert json.loads(program.stdout.readline()) == {
                    "tcp": None,
                    "udp": target,
                    "directory": str(tmp_path),
                }
                mav = mavlink.MAVLink(None, srcSystem=255)
                kinds: list[str] = []
                asked = False
                while "PARAM_VALUE" not in kinds:
                    data, vehicle = ground.recvfrom(65536)
                    assert vehicle[0] == "127.0.0.1"
                    kinds += [m.get_type() for m in mav.parse_buffer(data) or []]
                    if not asked:
                        read = mavlink.MAVLink_param_request_read_message(1, 1, b"SYSID_MYGCS", -1)
                        ground.sendto(read.pack(mav), vehicle)
                        asked = True
                assert "HEARTBEAT" in kinds
            finally:
                program.terminate()
        assert program.returncode == 0


def test_a_rover_that_nobody_talks_to_waits_without_working_and_ends_on_sigterm(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sitl.embedded", "--directory", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as program:
        assert program.stdout is not None
        assert json.loads(program.stdout.readline())["tcp"] > 0
        time.sleep(0.3)
        program.terminate()
        assert program.wait(3.0) == 0
    assert list((tmp_path / "logs").iterdir()) == []


def test_nothing_is_bound_beyond_loopback_unless_told() -> None:
    assert listening_address(parser().parse_args([])) == ("127.0.0.1", 0)
    assert listening_address(parser().parse_args(["--udp", "127.0.0.1:14550"])) is None
    assert listening_address(parser().parse_args(["--tcp", "0.0.0.0:5760"])) == ("0.0.0.0", 5760)
    peer = UdpPeer(("127.0.0.1", 14550))
    assert peer.connection.getsockname()[0] == "127.0.0.1"
    peer.close()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--parameter", "NO_SUCH=1"], "has no parameter NO_SUCH"),
        (["--variant", "flying"], "no variant flying"),
    ],
)
def test_wrong_usage_gets_one_sentence_and_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], sentence: str
) -> None:
    assert main(["--directory", str(tmp_path), *options]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 1 and sentence in errors[0]


def test_prepare_brings_the_applet_and_the_parameters(tmp_path: Path) -> None:
    prepare(tmp_path, True, [("SCR_ENABLE", 1.0)])
    assert "SWP_" in (tmp_path / "scripts" / "rover_sweep.lua").read_text()
    assert ParameterStore(tmp_path / "parameters.txt")["SCR_ENABLE"] == 1
