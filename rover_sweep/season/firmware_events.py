"""Events that the logs themselves show: parameters of the firmware that changed, and another board."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise

from rover_sweep.season.season_result import Drift, ParameterChange
from rover_sweep.season.vehicle_days import VehicleDay

# Statistics and calibrations that the firmware itself changes; settings of the manoeuvre
_BY_ITSELF = re.compile(
    r"STAT_|SWP_|BARO\d?_|INS_.*(OFFS|_ID|CALTEMP|SCAL)|INS\d_|COMPASS_|GND_|FORMAT_VERSION|SYSID_SW|RC\d+_(MIN|MAX|TRIM)|"
    r"AHRS_GPS|MIS_TOTAL|FENCE_TOTAL|RALLY_TOTAL|LOG_|BRD_SERIAL"
)
_ACTING = re.compile(
    r"INS_(GYRO_FILTER|ACCEL_FILTER|HNTC|NOTCH|RAW_LOG|FAST|POS)|SERVO\d+_(TRIM|MIN|MAX|REVERSED|FUNCTION|RATE)|"
    r"SERVO_RATE|AHRS_(ORIENTATION|TRIM)|SCHED_LOOP_RATE|ATC_|RCMAP_|FRAME_|MOT_"
)
"""Parameters that change the recorded signals, or the way from command to wheel."""
SAME = 1e-6  # relative; parameters are single precision


def parameter_changes(days: Sequence[VehicleDay]) -> tuple[ParameterChange, ...]:
    """Parameters that differ from the day before, in the order of days and names."""
    return tuple(change for one, two in pairwise(days) for change in _between(one, two))


def _between(one: VehicleDay, two: VehicleDay) -> Iterator[ParameterChange]:
    for name in sorted(one.parameters.keys() & two.parameters.keys()):
        a, b = one.parameters[name], two.parameters[name]
        if abs(a - b) > SAME * max(abs(a), abs(b)) and not _BY_ITSELF.match(name):
            yield ParameterChange(name, one.day, two.day, a, b)


def within(changes: Sequence[ParameterChange], first: str, last: str) -> tuple[ParameterChange, ...]:
    """The changes that can have happened from the day `first` to the day `last`."""
    return tuple(c for c in changes if c.day_before <= last and c.day_after >= first)


def event_drifts(vehicle: str, days: Sequence[VehicleDay], changes: Sequence[ParameterChange]) -> list[Drift]:
    """Each other board, and each changed parameter that acts on signals or steering."""
    out = []
    for one, two in pairwise(days):
        at = tuple(c for c in changes if c.day_after == two.day)
        if one.board and two.board and one.board != two.board:
            words = (
                f"{vehicle}: the board was swapped between {one.day} and {two.day} "
                f"({one.board} before, {two.board} after)"
            )
            out.append(
                Drift(
                    vehicle,
                    "board",
                    "board",
                    "autopilot that wrote the log",
                    "",
                    two.day,
                    two.day,
                    two.day,
                    parameters=at,
                    sentence=words,
                )
            )
        out += [_of_parameter(vehicle, c) for c in at if _ACTING.match(c.name)]
    return out


def _of_parameter(vehicle: str, c: ParameterChange) -> Drift:
    words = (
        f"{vehicle}: {c.name} was changed from {c.before:g} to {c.after:g} "
        f"between {c.day_before} and {c.day_after}"
    )
    meaning = "parameter of the firmware"
    return Drift(
        vehicle,
        "parameter",
        c.name,
        meaning,
        "",
        c.day_after,
        c.day_after,
        c.day_after,
        c.before,
        c.after,
        parameters=(c,),
        sentence=words,
    )
