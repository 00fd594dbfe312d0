"""Steering gains from a file of results and the vehicle's current parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rover_sweep.api.diagnose import load_diagnosis
from rover_sweep.api.driving import identify_driving
from rover_sweep.api.identify import load_result
from rover_sweep.api.save import holds, is_diagnosis, result_document, result_file
from rover_sweep.data.controller_log import ControllerLog
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.data.vehicle_file import load as load_vehicle
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.gains.check import SpeedCheck, SteeringCheck, check_speed, check_steering
from rover_sweep.gains.first import FirstFeedForward, first_feed_forward
from rover_sweep.gains.identified import PHYSICAL, Identified, from_diagnosis, from_identification
from rover_sweep.gains.proposal import Proposal, propose_gains
from rover_sweep.gains.steering_chain import autopilot
from rover_sweep.logs.controllers import Controllers, read_controllers
from rover_sweep.logs.read import read_logs
from rover_sweep.report.identification.identification_json import identification_document

LOGS = (".bin", ".log", ".tlog")


def steering_gains(
    place: Path,
    name: str | None,
    vehicle_file: str | None,
    current: Mapping[str, float],
    current_from: str,
    speed: float | None,
) -> Proposal:
    """Current and proposed gains.

    place: file or folder of an identification or diagnosis. name: of the model, None for the recommended
    one. vehicle_file: with rad_per_us and servo, if the results have none. current: {parameter: value} of the
    vehicle, empty for the firmware's defaults; current_from: their origin, for errors. speed: design speed
    [m/s], None for that of the runs. UsageError for files from which no gains can be computed.
    """
    if name is not None and name not in PHYSICAL:
        raise UsageError(
            f"--model {name}: gains need a model that is valid at other speeds: {', '.join(PHYSICAL)}"
        )
    found = read_identified(place, name, vehicle_file)
    known = (("INS_GYRO_FILTER", found.gyro_hz), ("SCHED_LOOP_RATE", found.loop_hz))
    try:
        loop = autopilot(current, {name: value for name, value in known if value is not None})
    except ValueError as error:
        raise UsageError(f"{current_from}: {error}") from None
    try:
        return propose_gains(found, loop, speed)
    except ValueError as error:
        raise UsageError(f"no loop can be computed: {error}") from None


@dataclass(frozen=True, eq=False)
class CheckedGains:
    """steering, speed: checks of the present gains, forward and in reverse if driven and logged; before:
    checks of the earlier drive, empty for one log with one set of gains. first: instead of them, of a log in
    which the controller did not run, as in MANUAL."""

    before: tuple[tuple[SteeringCheck, ...], tuple[SpeedCheck, ...]]
    steering: tuple[SteeringCheck, ...]
    speed: tuple[SpeedCheck, ...]
    first: FirstFeedForward | None = None


def check_gains(logs: Sequence[Path], found: Identified | None = None) -> CheckedGains:
    """Checks the present gains in logs (.BIN, .tlog) of one drive, or one before and one after a change.

    A log with changed gains counts as both: its first and its last set of gains. found: an identified
    model, which predicts the drives. One log in which the controller did not run gives `first` alone, where
    its driving shows it. UsageError for more than two logs, DataRefused for one without the controller's
    messages or without driving.
    """
    if not 1 <= len(logs) <= 2:
        raise UsageError("--check takes one log, or two: before and after")
    try:
        first, last = read_controllers(logs[0]), read_controllers(logs[-1])
    except DataRefused as refused:
        if len(logs) > 1 or (only := _first_of(logs[0], str(refused))) is None:
            raise
        return CheckedGains(((), ()), (), (), only)
    now, earlier = last.steering[-1], first.steering[-1 if len(logs) > 1 else 0]
    known = len(logs) > 1 or earlier.parameters != now.parameters
    try:
        steering, speed = _checked(last, now, found)
        before = _checked(first, earlier, found) if known else ((), ())
    except ValueError as error:
        raise DataRefused(str(error)) from None
    return CheckedGains((before[0][:1], before[1][:1]), steering, speed)


def _first_of(path: Path, why: str) -> FirstFeedForward | None:
    """A first FF from the driving in a log of MANUAL, None where it shows none; why: the others are not."""
    try:
        parameters = read_logs(str(path))[-1].parameters
        answer = identify_driving(path)
        return first_feed_forward(answer, autopilot(parameters), path.stem, why)
    except (DataRefused, ValueError):
        return None


def _checked(
    logs: Controllers, of: ControllerLog, found: Identified | None
) -> tuple[tuple[SteeringCheck, ...], tuple[SpeedCheck, ...]]:
    """The checks of both controllers, forward and in reverse, with the parameters of one log."""
    steering, speed = (
        [log for log in some if log.parameters == of.parameters] for some in (logs.steering, logs.speed)
    )
    on_speed = (check_speed(log) for log in speed)
    return tuple(check_steering(log, found) for log in steering), tuple(c for c in on_speed if c is not None)


def read_identified(place: Path, name: str | None, vehicle_file: str | None = None) -> Identified:
    """The model of an identification.json, a saved result, a diagnosis, or a folder with one of them; with
    rad_per_us and the servo of the vehicle file, if one is given."""
    path = result_file(place, "identification.json", "diagnosis.json")
    if path is None:
        raise UsageError(
            f"{place} contains no identification; give the --out folder of identify, run or diagnose"
        )
    return _identified(path, name, load_vehicle(vehicle_file) if vehicle_file else None)


def _identified(path: Path, name: str | None, vehicle: Vehicle | None) -> Identified:
    document = result_document(path)
    try:
        if document.get("format") == "rover-sweep identification":
            return from_identification(document, name, vehicle)
        if is_diagnosis(document):
            found = load_diagnosis(path)
            if name not in (None, found.baseline):
                raise UsageError(f"{path} has the {found.baseline} model; remove --model {name}")
            return from_diagnosis(found, vehicle)
        if holds(document, "Result"):
            result = load_result(path)
            return from_identification(identification_document(result, result.origin), name, vehicle)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        match error:
            case KeyError():
                why = f"{error} is missing"
            case ValueError():
                why = str(error)
            case _:
                why = "a part of it has another form"
        raise UsageError(f"no gains can be computed from {path}: {why}; run identify again") from error
    raise UsageError(f"{path} is neither an identification nor a diagnosis of rover-sweep")


def recorded_parameters(path: Path) -> dict[str, float]:
    """Parameters by name from a .param file or a log; UsageError if unreadable or impossible."""
    from firmware_params.param_files import read

    try:
        logged = path.suffix.lower() in LOGS
        found = _logged(path) if logged else {wanted.name: wanted.value for wanted in read(path)}
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} cannot be read as parameters: {error}") from None
    for name, value in found.items():
        if name.startswith("ATC_STR_RAT_") and not 0.0 <= value < math.inf:
            raise UsageError(f"{path}: {name} is {value:g}; it must be 0 or more: save the parameters again")
    return found


def _logged(path: Path) -> dict[str, float]:
    from rover_sweep.logs.readers.dataflash_channels import read_dataflash

    if path.suffix.lower() == ".tlog":
        raise UsageError(f"{path}: a .tlog does not always hold all parameters; give the .BIN, or --connect")
    found = dict(read_dataflash(path)[-1].parameters)
    if "ATC_STR_RAT_FF" not in found:
        raise UsageError(f"{path} has no ATC_STR_RAT_FF: give a rover's log that includes its parameters")
    return found
