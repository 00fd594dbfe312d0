"""A drive repeated on a simulated vehicle with autopilot: the embedded rover, or the real firmware in SITL.

A Lua script on the vehicle plays the steering, as the sweep applet does, and follows the speed. This module
starts the vehicle, arms it, waits, and reads the log from its folder. It arms only simulated rovers that it
has started itself.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from firmware_params.param_files import shipped
from rover_sweep.errors import LinkError
from rover_sweep.vehicle.identity import estimator_ready
from rover_sweep.vehicle.link.link import Link, Refused
from rover_sweep.vehicle.run.controls import Channels, Controls, pump
from rover_sweep.vehicle.run.right_to_move import MovementLimits, RightToMove
from sitl.plant.variant import PlantParameters
from sitl.plant.variant_text import variant_text
from sitl.redrive.course import Course
from sitl.redrive.restamp import first, restamped
from sitl.redrive.script import script

_READY_S, _ARMING_S = 120.0, 60.0  # of the vehicle's clock
_SLACK_S = 30.0  # s after the course until a silent script counts as stopped
_SCRIPT_LOOP_HZ = 100.0  # lowest main loop rate; at lower ones scripts may wait 72 ms
_CHANNELS = Channels(steering=1, throttle=3, switch=6, steering_trim=1500, throttle_trim=1500)


def drive_course(
    course: Course, parameters: PlantParameters, out: Path, simulator: str, ardurover: Path | None, seed: int
) -> Iterator[str]:
    """Drive the course on `simulator` ("embedded", "ardurover") and write its log to `out`.

    The log is put on the clock of the course. Yields the current step as a sentence. LinkError if the vehicle
    does not drive the course to its end.
    """
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder) / "vehicle"
        settings = _settings(course)
        rover = _vehicle(Path(folder), course, parameters, simulator, ardurover, seed, settings)
        with rover, Link.open(rover.connection, Path(folder) / "link.tlog") as link:
            yield from _drive(link, float(course.t[-1] - course.t[0]))
        logs = sorted((home / "logs").glob("*.BIN"))
        data = logs[-1].read_bytes() if logs else b""
    begun = first(data, "RDRV", "T")
    if begun is None:
        raise LinkError(
            "the simulated rover recorded no log of the drive; try again, or use --simulator plant"
        )
    shift = float(course.t[0]) + begun[1] - begun[0]
    out.write_bytes(restamped(data, shift, float(course.t[0]), float(course.t[-1])))


def _settings(course: Course) -> dict[str, float]:
    """Parameters of the recorded rover that affect the recording: filters and loop rate."""
    have = course.parameters
    settings = {name: have[name] for name in ("INS_GYRO_FILTER", "INS_ACCEL_FILTER") if name in have}
    loop = max(have.get("SCHED_LOOP_RATE", _SCRIPT_LOOP_HZ), _SCRIPT_LOOP_HZ)
    return settings | {"SCHED_LOOP_RATE": loop, "SCR_HEAP_SIZE": 600_000, "SCR_ENABLE": 1}


def _vehicle(
    folder: Path,
    course: Course,
    parameters: PlantParameters,
    simulator: str,
    ardurover: Path | None,
    seed: int,
    settings: dict[str, float],
) -> Any:
    """Start the simulated rover with the script on it. LinkError if it does not start."""
    from sitl import launcher

    home, variant, player = folder / "vehicle", folder / "variant.toml", folder / "redrive.lua"
    variant.write_text(variant_text(parameters), encoding="utf-8")
    player.write_text(script(course, parameters), encoding="utf-8")
    try:
        if simulator == "embedded":
            (home / "scripts").mkdir(parents=True)
            player.rename(home / "scripts" / player.name)
            options = [part for n, v in settings.items() for part in ("--parameter", f"{n}={v:g}")]
            return launcher.start_embedded(home, variant=variant, seed=seed, options=options)
        lines = folder / "settings.param"
        lines.write_text("".join(f"{n} {v:.10g}\n" for n, v in settings.items()), encoding="ascii")
        return launcher.start_ardurover(
            launcher.find_ardurover(ardurover),
            home,
            variant=variant,
            seed=seed,
            scripts=[player],
            defaults=[shipped("identification"), lines],
        )
    except launcher.LaunchError as error:
        raise LinkError(str(error)) from error


def _drive(link: Link, length: float) -> Iterator[str]:
    """Arm when the estimator is ready, and wait for the end of the course."""
    yield "waiting for the estimator"
    started = link.clock.now
    while not estimator_ready(link):
        if link.clock.now - started > _READY_S:
            raise LinkError(f"the simulated rover's estimator is not ready after {_READY_S:.0f} s")
        pump(link, 1.0)
    controls = Controls(link, _CHANNELS, "pilot", True, RightToMove(link.line, link.clock, MovementLimits()))
    try:
        controls.take()
        _arm(link, controls)
        yield f"drives {length:.0f} s"
        _await(link, length)
    finally:
        controls.let_go()


def _arm(link: Link, controls: Controls) -> None:
    started = link.clock.now
    while not link.armed:
        pump(link, 1.0)
        try:
            controls.arm()
        except Refused as refused:
            if link.clock.now - started > _ARMING_S:
                raise LinkError(f"the simulated rover does not arm: {refused}") from refused
        else:
            link.wait_for("HEARTBEAT", 3.0, lambda _: link.armed)


def _await(link: Link, length: float) -> None:
    started, wall = link.clock.now, time.monotonic()
    while not any(text.text.startswith("REDRIVE: done") for text in link.texts):
        link.receive(0.5)
        errors = [text.text for text in link.texts if text.text.startswith("Lua:") and "rror" in text.text]
        if errors:
            raise LinkError(f"the driving script stopped: {errors[-1]}")
        late = link.clock.now - started > length + _SLACK_S
        if late or time.monotonic() - wall > 3.0 * length + _SLACK_S:
            raise LinkError(f"the simulated rover did not finish its drive of {length:.0f} s in time")
