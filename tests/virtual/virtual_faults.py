"""What may happen to a link, a laptop and a rover, each as a `Fault` for `World.happen` or `Scenario.faults`.

    scenario(faults=[(At("sweep", 1.0), hole(3.6))])

Those with `seconds` end by themselves; the others last until the scenario lifts them (`World.lift`).
"""

from __future__ import annotations

from typing import Literal

from pymavlink.dialects.v20 import ardupilotmega as dialect
from virtual_pipe import FAIR, Pipe, Weather
from virtual_world import Change, Fault, Killed, World

from sitl.autopilot.rover import HOLD, RC_COMMAND, Rover

Direction = Literal["both", "down", "up"]
STRANGER = 7  # system id of the second rover
EVER = float("inf")


def weather(name: str, kind: Weather, seconds: float = EVER, direction: Direction = "both") -> Fault:
    """The link as `kind` says, in one direction or both."""

    def begin(world: World) -> None:
        for pipe in _pipes(world, direction):
            pipe.weather = kind

    def end(world: World) -> None:
        for pipe in _pipes(world, direction):
            pipe.weather = FAIR

    return Fault(name, begin, seconds, end)


def _pipes(world: World, direction: Direction) -> list[Pipe]:
    return [p for p, name in ((world.down, "down"), (world.up, "up")) if direction in ("both", name)]


def hole(seconds: float = EVER, direction: Direction = "both") -> Fault:
    """Nothing passes. down: from the vehicle to the laptop; up: the other way."""
    return weather(f"hole {direction} {seconds:g} s", Weather(hole=True), seconds, direction)


def stall(seconds: float, direction: Direction = "both") -> Fault:
    """Everything is kept and comes late, all at once."""
    return weather(f"stall {direction} {seconds:g} s", Weather(stall=True), seconds, direction)


def cut() -> Fault:
    """The connection is closed by the other side; it may be opened again."""
    return Fault("cut", World.cut)


def asleep(seconds: float, queues: bool = True) -> Fault:
    """The laptop's lid is closed. queues: what comes meanwhile waits for it in the operating system."""

    def begin(world: World) -> None:
        world.laptop.wakes_us = world.now_us + round(seconds * 1e6)
        world.laptop.queues = queues

    return Fault(f"asleep {seconds:g} s" + ("" if queues else ", nothing kept"), begin)


def kill() -> Fault:
    """kill -9: nothing leaves the laptop from now on."""

    def begin(world: World) -> None:
        world.laptop.death = Killed()

    return Fault("kill", begin)


def interrupt() -> Fault:
    """Ctrl-C, once."""

    def begin(world: World) -> None:
        world.laptop.interrupt = KeyboardInterrupt()

    return Fault("interrupt", begin)


def hammered(count: int, every: float = 0.1, number: int = 0) -> Fault:
    """Ctrl-C `count` times in a row, every so many seconds; number: as this signal."""
    left, began = count, 0.0

    def press(world: World) -> None:
        nonlocal left, began
        began = began or world.now
        if left and world.now >= began + every * (count - left):
            left -= 1
            world.laptop.signal = number
            world.laptop.interrupt = None if number else KeyboardInterrupt()

    return each_step(f"interrupt {count} times", press, EVER)


def clock_set(seconds: float) -> Fault:
    """The laptop's wall clock is set, by so much, as by NTP; its other clocks do not notice."""

    def begin(world: World) -> None:
        world.laptop.wall_jump += seconds

    return Fault(f"clock set by {seconds:g} s", begin)


def disk_full(seconds: float = EVER) -> Fault:
    """The laptop's disk takes no more (ENOSPC from the recorder; see `virtual_run`)."""

    def begin(world: World) -> None:
        world.laptop.disk_full = True

    def end(world: World) -> None:
        world.laptop.disk_full = False

    return Fault("disk full", begin, seconds, end)


def power_lost(seconds: float) -> Fault:
    """The autopilot restarts, armed or not: silent, on again after so long, its clock at 0."""

    return Fault(f"power lost {seconds:g} s", lambda world: world.vehicle.power_off(seconds))


def script_stopped() -> Fault:
    """Somebody stops all scripts (MAV_CMD_SCRIPTING); the vehicle says so."""
    return Fault("script stopped", lambda world: _rover(world).scripts.stop())


def script_error() -> Fault:
    """The applet dies of an error; the vehicle says so."""

    def begin(world: World) -> None:
        for host in _rover(world).scripts._hosts or ():
            host._stop("rover_sweep.lua:1: attempt to index a nil value")

    return Fault("script error", begin)


def script_silent() -> Fault:
    """The applet runs no more, and nobody says so."""

    def begin(world: World) -> None:
        _rover(world).scripts._hosts = []

    return Fault("script silent", begin)


def script_paused(seconds: float) -> Fault:
    """The scripting thread gets no turn for so long."""

    def begin(world: World) -> None:
        for host in _rover(world).scripts._hosts or ():
            host.next_run_ms = _rover(world).now_ms + round(seconds * 1e3)

    return Fault(f"script paused {seconds:g} s", begin)


def rc_lost(kind: Literal[1, 2], seconds: float = EVER) -> Fault:
    """The transmitter fails (SIM_RC_FAIL): 1 no pulses, 2 throttle low and sticks neutral."""

    def begin(world: World) -> None:
        world.vehicle.set("SIM_RC_FAIL", kind)

    def end(world: World) -> None:
        if world.vehicle.rover is not None:
            world.vehicle.set("SIM_RC_FAIL", 0)

    return Fault(f"RC lost ({kind})", begin, seconds, end)


def disarmed() -> Fault:
    """The pilot disarms."""
    return Fault("disarmed", lambda world: _rover(world).disarm())


def held() -> Fault:
    """The pilot takes HOLD."""
    return Fault("hold", lambda world: _rover(world).set_mode(HOLD, RC_COMMAND))


def foreign_bytes(seconds: float = EVER) -> Fault:
    """Bytes of no MAVLink vehicle come in between, ten times a second."""

    def babble(world: World) -> None:
        if world.now_us % 100_000 == 0 and world.connected:
            world.down.put(b"$GPRMC,\xfd\x09\x00hello", world.now_us, own=False)

    return each_step("foreign bytes", babble, seconds)


def second_rover(seconds: float = EVER, state: int = 6) -> Fault:
    """Another rover is on the same channel: system 7, armed, its applet in `state`, 5 Hz."""
    mav = dialect.MAVLink(None, srcSystem=STRANGER, srcComponent=1)
    armed = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | dialect.MAV_MODE_FLAG_SAFETY_ARMED

    def tell(world: World) -> None:
        if world.now_us % 200_000 or not world.connected:
            return
        ms = world.now_us // 1000 + 777_000
        for message in (
            dialect.MAVLink_heartbeat_message(10, 3, armed, 0, 4, 3),
            dialect.MAVLink_attitude_message(ms, 0, 0, 0, 0, 0, 0.1),
            dialect.MAVLink_named_value_float_message(ms, b"SWP_ST", state),
            dialect.MAVLink_named_value_float_message(ms, b"SWP_RUN", 400),
        ):
            world.down.put(bytes(message.pack(mav)), world.now_us, own=False)
            mav.seq = (mav.seq + 1) % 256

    return each_step("second rover", tell, seconds)


def each_step(name: str, change: Change, seconds: float) -> Fault:
    def begin(world: World) -> None:
        world.each_step.append(change)

    def end(world: World) -> None:
        world.each_step.remove(change)

    return Fault(name, begin, seconds, end)


def _rover(world: World) -> Rover:
    assert world.vehicle.rover is not None
    return world.vehicle.rover
