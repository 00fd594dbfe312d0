"""A variant of the simulated rover as one Python file that needs nothing of this project."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

from sitl.plant.variant import PlantParameters
from sitl.twin.flat_source import flat_source

SENSOR_EFFECTS = ("imu_tilt", "sensor_scale", "sensor_filter", "velocity_lag", "clock_offset")
_NUMBERS = '''"""The numbers of this rover; their meanings and units are in `PlantParameters`."""

from sitl.plant.plant_law import PlantLaw
from sitl.plant.variant import PlantParameters

PARAMETERS = PlantParameters(
{}
)
'''
_HEAD = '''"""A simulated rover: nonlinear single track with roll, a steering servo, tyres with limited grip.

{origin}

    from {name} import Rover

    rover = Rover()  # on an even road; Rover(seed=1): with random unevenness, needs numpy
    motion = rover.step(1550, 1650, 0.01)  # steering [us], throttle [us], time [s]
    motion = rover.follow(1550, 2.0, 0.01)  # steering [us], speed [m/s], time [s]
    motions = rover.drive(t, steering_us, speed)  # arrays of a recorded drive; needs numpy

    python {name}.py drive.csv motion.csv  # from columns time [s], steering [us], speed [m/s]

`Motion` has the outputs: SI units, ISO axes (x forward, y left, z up), a left turn is positive. They are the
true motion: r, p and a_y without noise, filters and errors of sensors.{sensors}
The numbers are in PARAMETERS. Python 3.11 or newer; this file imports nothing but Python's own modules, and
numpy where that is said.
"""
'''


def python_file(parameters: PlantParameters, origin: Sequence[str], name: str = "rover_twin") -> str:
    """The source of the file. origin: lines on where the numbers come from; name: of the module."""
    words = [line.replace("\\", "/").replace('"""', "'''") for line in origin]
    head = _HEAD.format(origin="\n".join(words), name=name, sensors=_left_out(parameters))
    body = flat_source("sitl.twin.rover", {"sitl.twin.numbers": _numbers(parameters)})
    return f"{head}\nfrom __future__ import annotations\n\n{body}"


def _left_out(parameters: PlantParameters) -> str:
    """A sentence on the effects of the variant that are in sensors only."""
    names = [name for name in SENSOR_EFFECTS if name in parameters.effects]
    return f"\nNot in them, since in sensors only: {', '.join(names)}." if names else ""


def _numbers(parameters: PlantParameters) -> str:
    lines = []
    for f in fields(parameters):
        value = getattr(parameters, f.name)
        lines += (
            _entries(f.name, value) if value and f.name in ("effects", "laws") else [f"{f.name}={value!r},"]
        )
    return _NUMBERS.format("\n".join(f"    {line}" for line in lines))


def _entries(name: str, value: object) -> list[str]:
    """An effect or a law on each line."""
    if isinstance(value, tuple):
        return [f"{name}=(", *(f"    {law!r}," for law in value), "),"]
    assert isinstance(value, dict)
    return [f"{name}={{", *(f"    {effect!r}: {numbers!r}," for effect, numbers in value.items()), "},"]
