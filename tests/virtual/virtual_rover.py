"""The embedded rover in this process, one main loop a call, with an in-memory connection; it may reboot.

What `sitl.embedded` does around `sitl.autopilot.rover.Rover`, without sockets and without real time.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from sitl.autopilot.rover import Rover
from sitl.autopilot.vehicle_parameters import Parameter, ParameterStore
from sitl.embedded import PARAMETER_FILE, REBOOT_AFTER_US, prepare
from sitl.ground.file_transfer import FileTransfer
from sitl.ground.ground_session import GroundLink
from sitl.ground.log_transfer import LogTransfer
from sitl.plant.variant import load_variant

# A loop of 50 Hz as ArduPilot's default; radio rates; nothing logged but what the applet writes.
PARAMETERS = {"SCR_ENABLE": 1.0, "SCHED_LOOP_RATE": 50.0, "RC6_OPTION": 300.0, "LOG_BITMASK": 0.0}
LOOP_US = 20_000
PLANT_HZ = 50  # five times quicker than 400, and the drives are the same within a few per cent
_STATE, _RUN = "SWP_ST", "SWP_RUN"

Told = Callable[[bytes], None]


class MemoryPeer:
    """A `sitl.ground.server.Peer` without a socket: `told` gets each frame."""

    def __init__(self, told: Told) -> None:
        self.told = told

    def queue(self, data: bytes, now_us: int) -> None:
        self.told(data)


class VirtualRover:
    """One vehicle over its reboots. rover: this boot's, None while it is off; boots: how many so far.

    state, run: as the applet last told them on the vehicle itself. on_text, on_state: called with each
    status text and each state that the applet enters.
    """

    def __init__(self, directory: Path, settings: dict[str, float], seed: int, told: Told) -> None:
        self.directory, self._seed, self._told = directory, seed, told
        self.rover: Rover | None = None
        self.boots = self.state = self.run = 0
        self.on_text: Callable[[str], None] = lambda text: None
        self.on_state: Callable[[int], None] = lambda state: None
        self._on_in_us = self._off_us = 0
        self._reboot_at_us: int | None = None
        prepare(directory, applet=True, settings=list(settings.items()))
        self._boot()

    def step(self, received: list[bytes], listened_to: bool) -> None:
        """One main loop, 20 ms. received: frames that have come; listened_to: False saves the packing."""
        if self.rover is None:
            self._off_us -= LOOP_US
            if self._off_us <= 0:
                self._boot()
            return
        self.rover.step()
        for data in received:
            self.link.receive(data)
        if listened_to:
            self.link.send()
            if self._logs.busy:
                self._logs.pump(self.rover.loop_period_us)
        if self._reboot_at_us is not None and self.rover.now_us >= self._reboot_at_us:
            self.power_off(self._boot_s)

    def power_off(self, seconds: float) -> None:
        """Off at once, in whatever state; on again after `seconds`."""
        if self.rover is not None:
            self.rover.log.close()
        self.rover, self._off_us = None, round(seconds * 1e6)
        self.state = 0

    def connect(self) -> None:
        """A new connection: streams at their usual rates."""
        if self.rover is not None:
            self.link = GroundLink(self.rover, self._peer, self._logs, self._files, self._reboot_soon)  # type: ignore[arg-type]

    def set(self, name: str, value: float) -> None:
        assert self.rover is not None and self.rover.parameters.set(name, value), name

    def _boot(self) -> None:
        parameters = ParameterStore(self.directory / PARAMETER_FILE)
        parameters.set("STAT_BOOTCNT", parameters["STAT_BOOTCNT"] + 1)
        self.rover = rover = Rover(self.directory, load_variant("nominal"), self._seed, parameters, PLANT_HZ)
        assert rover.loop_period_us == LOOP_US, "SCHED_LOOP_RATE must be 50 here"
        self.boots += 1
        self._boot_s, self._reboot_at_us = 3.0, None
        self._logs, self._files, self._peer = (
            LogTransfer(rover),
            FileTransfer(self.directory),
            MemoryPeer(self._told),
        )
        self.connect()
        rover.on_text, rover.on_named_float, rover.on_parameter = (
            self._text,
            self._named_float,
            self._parameter,
        )

    def _reboot_soon(self) -> None:
        assert self.rover is not None
        self._reboot_at_us = self.rover.now_us + REBOOT_AFTER_US

    def _text(self, severity: int, text: str) -> None:
        self.on_text(text)
        self.link.send_text(severity, text)

    def _named_float(self, name: str, value: float) -> None:
        if name == _RUN:
            self.run = int(value)
        elif name == _STATE and int(value) != self.state:
            self.state = int(value)
            self.on_state(self.state)
        self.link.send_named_float(name, value)

    def _parameter(self, parameter: Parameter) -> None:
        self.link.echo_parameter(parameter)
