"""An embedded ArduRover: a simulated rover that speaks MAVLink 2 to a ground station, without the firmware.

    python -m sitl.embedded --tcp 127.0.0.1:0 --variant nominal --applet --parameter SCR_ENABLE=1

prints one line of JSON on stdout when it is ready, e.g. {"tcp": 40123, "directory": "..."}; the rest goes to
stderr. It runs in simulated time in steps of SCHED_LOOP_RATE. It boots when the first ground station has
connected, like ArduPilot's SITL. While none is connected later, it goes on in real time, so that the loss of
the laptop can be tested. It waits for a ground station that reads slowly.
"""

from __future__ import annotations

import argparse
import json
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from types import FrameType

from sitl.autopilot.log_records import LogRecords
from sitl.autopilot.rover import Rover
from sitl.autopilot.vehicle_parameters import Parameter, ParameterStore
from sitl.ground.file_transfer import FileTransfer
from sitl.ground.ground_session import GroundLink
from sitl.ground.log_transfer import LogTransfer
from sitl.ground.server import MavlinkServer, Peer
from sitl.plant.variant import PlantParameters, load_variant, variant_names
from sitl.plant.wheel_imu import WheelImu

APPLET = Path(__file__).parent.parent / "firmware_params" / "rover_sweep.lua"
PARAMETER_FILE = "parameters.txt"
REBOOT_AFTER_US = 200_000  # the acknowledgement still gets out
ACCEPT_EVERY_US = 20_000
IDLE_S = 0.05
SHORTEST_NAP_S, LONGEST_NAP_S = 0.0005, 0.005  # while a ground station is waited for
LOOPBACK = "127.0.0.1"


class EmbeddedRover:
    """A vehicle that survives reboots: its directory, its server, and one `Rover` per boot.

    directory: holds parameters.txt, scripts/ and logs/. wheel: file of an IMU on the front wheel.
    speedup: simulated over real time, 0 for as fast as it can. Call `run`;
    `stop` ends it from a signal handler.
    """

    def __init__(
        self,
        directory: Path,
        plant: PlantParameters,
        server: MavlinkServer,
        speedup: float = 0.0,
        seed: int = 1,
        wheel: Path | None = None,
    ) -> None:
        self.directory, self.plant, self.server, self.speedup, self.seed = (
            directory,
            plant,
            server,
            speedup,
            seed,
        )
        self.wheel = wheel
        self._stopping = False
        self._boot()

    def stop(self) -> None:
        self._stopping = True

    def run(self) -> None:
        """Until `stop`."""
        while not self._stopping and not self.server.peers:
            self._accept()
            self.server.wait(IDLE_S)
        while not self._stopping:
            self._loop()
        self.rover.log.close()
        self.server.close()

    def _boot(self) -> None:
        parameters = ParameterStore(self.directory / PARAMETER_FILE)
        parameters.set("STAT_BOOTCNT", parameters["STAT_BOOTCNT"] + 1)
        self.rover = rover = Rover(self.directory, self.plant, self.seed, parameters)
        self.records = LogRecords(rover)
        if self.wheel is not None:
            self._mount(WheelImu(self.wheel, self.seed))
        self.logs, self.files = LogTransfer(rover), FileTransfer(self.directory)
        self.links = [self._link(peer) for peer in self.server.peers]
        rover.on_text, rover.on_named_float, rover.on_parameter = (
            self._text,
            self._named_float,
            self._parameter,
        )
        self._reboot_at_us: int | None = None
        self._accepted_us = 0
        self._pace_from()

    def _mount(self, imu: WheelImu) -> None:
        """An IMU on the front wheel, sampled with the rover's own."""
        rover, before = self.rover, self.rover.on_sample

        def sample() -> None:
            before()
            imu.sample(rover.now_us * 1e-6, rover.plant.state)

        rover.on_sample = sample

    def _link(self, peer: Peer) -> GroundLink:
        return GroundLink(self.rover, peer, self.logs, self.files, self._reboot_soon)

    def _reboot_soon(self) -> None:
        self._reboot_at_us = self.rover.now_us + REBOOT_AFTER_US

    # ---- to every link

    def _text(self, severity: int, text: str) -> None:
        for link in self.links:
            link.send_text(severity, text)

    def _named_float(self, name: str, value: float) -> None:
        for link in self.links:
            link.send_named_float(name, value)

    def _parameter(self, parameter: Parameter) -> None:
        for link in self.links:
            link.echo_parameter(parameter)

    # ---- one main loop

    def _loop(self) -> None:
        rover = self.rover
        rover.step()
        self.records.loop()
        if rover.now_us - self._accepted_us >= ACCEPT_EVERY_US:
            self._accepted_us = rover.now_us
            self._accept()
        self._exchange()
        if self._reboot_at_us is not None and rover.now_us >= self._reboot_at_us:
            self._reboot()
            return
        nap = SHORTEST_NAP_S
        while self.server.flush(rover.now_us) and not self._stopping:
            self.server.wait(nap)
            nap = min(2 * nap, LONGEST_NAP_S)
            self._receive()
        self._pace()

    def _exchange(self) -> None:
        self._receive()
        for link in self.links:
            link.send()
        if self.logs.busy:
            self.logs.pump(self.rover.loop_period_us)

    def _receive(self) -> None:
        for link in tuple(self.links):
            data = link.peer.receive()
            if data is None:
                self._drop(link)
            elif data:
                link.receive(data)

    def _accept(self) -> None:
        peer = self.server.accept()
        if peer is not None:
            self.links.append(self._link(peer))
            self._pace_from()

    def _drop(self, link: GroundLink) -> None:
        self.logs.forget(link.send_message)
        self.server.remove(link.peer)
        self.links.remove(link)
        self._pace_from()

    def _reboot(self) -> None:
        self.rover.log.close()
        for link in self.links:
            link.peer.flush(self.rover.now_us)
        self.server.drop_clients()
        self._boot()

    # ---- pace

    def _pace_from(self) -> None:
        """Real time counts from here: after a boot, and when a link comes or goes."""
        self._real_0, self._vehicle_0 = time.monotonic(), self.rover.now_us

    def _pace(self) -> None:
        """Sleeps where vehicle time is ahead of its speed-up; in real time while nobody is connected."""
        speedup = self.speedup if self.server.peers else self.speedup or 1.0
        if not speedup:
            return
        ahead = (self.rover.now_us - self._vehicle_0) * 1e-6 / speedup - (time.monotonic() - self._real_0)
        if ahead > 0:
            self.server.wait(ahead)
            left = (self.rover.now_us - self._vehicle_0) * 1e-6 / speedup - (time.monotonic() - self._real_0)
            if left > 0:  # something came in: it is heard in the next loop
                time.sleep(left)
        elif ahead < -0.5:  # a peer was waited for, or the machine is too slow: do not catch up in a rush
            self._pace_from()


def address(text: str) -> tuple[str, int]:
    """HOST:PORT."""
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit():
        raise argparse.ArgumentTypeError(f"'{text}' is not HOST:PORT, e.g. 127.0.0.1:5760")
    return host, int(port)


def setting(text: str) -> tuple[str, float]:
    """NAME=VALUE."""
    name, _, value = text.partition("=")
    try:
        return name.upper(), float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not NAME=VALUE, e.g. SCR_ENABLE=1") from None


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(
        prog="python -m sitl.embedded",
        description="A simulated ArduRover to try a ground station on, without the firmware.",
        epilog="Ready, it prints one line of JSON on stdout: the TCP port, the UDP target and the directory. "
        "SIGTERM or Ctrl-C ends it. SIM_RC_FAIL=1 (parameter) takes the radio away.",
    )
    p.add_argument(
        "--tcp",
        type=address,
        metavar="HOST:PORT",
        help="listen here; port 0 takes a free one (default 127.0.0.1:0 unless --udp is given)",
    )
    p.add_argument("--udp", type=address, metavar="HOST:PORT", help="send there and hear what comes back")
    p.add_argument(
        "--variant",
        default="nominal",
        help=f"the plant: {', '.join(variant_names())}, or a TOML file (default nominal)",
    )
    p.add_argument(
        "--speedup",
        type=float,
        default=0.0,
        metavar="X",
        help="times real time; 0 as fast as it can (default)",
    )
    p.add_argument(
        "--directory",
        type=Path,
        metavar="DIR",
        help="parameters, scripts and logs live there (default: a new temporary one)",
    )
    p.add_argument("--seed", type=int, default=1, help="of noise and road (default 1)")
    p.add_argument(
        "--wheel", type=Path, metavar="FILE", help="an IMU on the front wheel writes this CSV file"
    )
    p.add_argument("--applet", action="store_true", help="put the sweep applet into the scripts directory")
    p.add_argument(
        "--parameter",
        type=setting,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="set before the first boot; may be repeated",
    )
    return p


def listening_address(options: argparse.Namespace) -> tuple[str, int] | None:
    """TCP address to listen on: loopback unless another was requested."""
    if options.tcp is not None:
        return (str(options.tcp[0]), int(options.tcp[1]))
    return None if options.udp else (LOOPBACK, 0)


def prepare(directory: Path, applet: bool, settings: Sequence[tuple[str, float]]) -> None:
    """Fills the vehicle's directory. Raises ValueError for a parameter that it does not have."""
    (directory / "scripts").mkdir(parents=True, exist_ok=True)
    if applet:
        shutil.copy(APPLET, directory / "scripts" / APPLET.name)
    parameters = ParameterStore(directory / PARAMETER_FILE)
    for name, value in settings:
        if name not in parameters:
            raise ValueError(f"the embedded rover has no parameter {name}")
        parameters.set(name, value)


def main(arguments: Sequence[str] | None = None) -> int:
    """The program; 0 done, 2 usage."""
    options = parser().parse_args(arguments)
    directory = options.directory or Path(tempfile.mkdtemp(prefix="embedded-rover-"))
    try:
        plant = load_variant(options.variant)
        prepare(directory, options.applet, options.parameter)
        server = MavlinkServer(listening_address(options), options.udp)
        vehicle = EmbeddedRover(directory, plant, server, options.speedup, options.seed, options.wheel)
    except (ValueError, OSError) as error:
        print(f"embedded rover: {error}", file=sys.stderr)
        return 2

    def end(number: int, frame: FrameType | None) -> None:
        vehicle.stop()

    signal.signal(signal.SIGTERM, end)
    signal.signal(signal.SIGINT, end)
    udp = None if options.udp is None else f"{options.udp[0]}:{options.udp[1]}"
    print(json.dumps({"tcp": server.port, "udp": udp, "directory": str(directory)}), flush=True)
    print(ready_words(server.port, udp), file=sys.stderr, flush=True)
    vehicle.run()
    return 0


def ready_words(port: int | None, udp: str | None) -> str:
    """What to start next, for a person; a program reads the line of JSON."""
    url = f"tcp:{LOOPBACK}:{port}" if port else f"udp:{udp}"
    return (
        "The simulated rover is ready; Ctrl-C ends it. In another terminal:\n"
        f"  rover-sweep session --connect {url} --vehicle rover.toml --arm --throttle 1710 --throw-switch"
    )


if __name__ == "__main__":
    sys.exit(main())
