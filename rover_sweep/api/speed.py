"""The response of the speed to the throttle: from recordings to speed.json, and from there to gains."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from os import fspath
from pathlib import Path
from typing import Any

from firmware_params.param_files import parse
from rover_sweep.api.gains import steering_gains
from rover_sweep.api.read import Location
from rover_sweep.api.save import result_file
from rover_sweep.data.recording import ThrottleRun, data_frame
from rover_sweep.data.results import ByName, Quantity, ShortTable, Shown, ends_words, plain_number
from rover_sweep.errors import DataRefused, RoverSweepError, UsageError
from rover_sweep.files.documents import read_json
from rover_sweep.gains.corner import HALF_WIDTH, Corner, corners
from rover_sweep.gains.gains_json import (
    corners_document,
    gains_document,
    limits_document,
    limits_text,
    param_text,
    speed_gains_document,
    speed_text,
)
from rover_sweep.gains.proposal import Proposal, SteeringLimits, steering_limits
from rover_sweep.gains.speed_chain import speed_from_document, speed_loop
from rover_sweep.gains.speed_proposal import SpeedProposal, propose_speed
from rover_sweep.identification.identify_speed import SpeedResult, speed_parameters
from rover_sweep.identification.identify_speed import identify_speed as from_sweeps
from rover_sweep.report.in_html import PageFiles, write_page
from rover_sweep.report.speed_report import SpeedFindings, speed_document, speed_report

SPEED_FILE = "speed.json"


def throttle_sweeps(sources: Sequence[str]) -> tuple[ThrottleRun, ...]:
    """All throttle sweeps in .BIN logs, pairs with one, or folders of sessions; () without any.

    Only a .BIN holds them. DataRefused for a damaged log, or for sweeps without a recorded speed.
    """
    from rover_sweep.logs.applet import throttle_runs
    from rover_sweep.logs.read import read_logs

    found: list[ThrottleRun] = []
    for path in (path for path in _logs(sources) if _mentions(path)):
        try:
            found += [run for log in read_logs(str(path)) for run in throttle_runs(log)]
        except OSError as error:
            raise DataRefused(f"{path.name} cannot be read: {error}") from None
    return tuple(found)


def speed_gains(path: Path, current: Mapping[str, float], current_from: str) -> SpeedProposal:
    """Current and proposed settings of the speed loop from a speed.json; see `proposed_speed`.

    UsageError for a file from which nothing can be computed.
    """
    try:
        document = read_json(path.read_text(encoding="utf-8"))
        speed_from_document(document)
    except (OSError, KeyError, TypeError, ValueError, IndexError) as error:
        raise UsageError(
            f"no speed gains can be computed from {path} ({type(error).__name__}: {error}); "
            "run identify again"
        ) from error
    return proposed_speed(document, current, current_from)


def proposed_speed(
    document: Mapping[str, Any], current: Mapping[str, float], current_from: str
) -> SpeedProposal:
    """Current and proposed settings of the speed loop from the content of a speed.json.

    current: {parameter: value} of the vehicle; missing ones come from the runs, then from the firmware's
    defaults. current_from: their origin, for errors.
    """
    found = speed_from_document(document)
    try:
        return propose_speed(found, speed_loop({**found.parameters, **current}))
    except ValueError as error:
        raise UsageError(f"{current_from}: {error}") from None


def _logs(sources: Sequence[str]) -> list[Path]:
    """The .BIN files of the sources, each once."""
    found: dict[Path, None] = {}
    for source in sources:
        place = Path(source).expanduser()
        if place.is_dir():
            found |= dict.fromkeys(sorted(path for path in place.glob("*.BIN") if path.is_file()))
            continue
        parts = [place] if place.is_file() else [Path(part).expanduser() for part in source.split("+")]
        found |= dict.fromkeys(p for p in parts if p.suffix.lower() == ".bin" and p.is_file())
    return list(found)


def _mentions(path: Path) -> bool:
    """Whether the log has the applet's message of a throttle sweep; far quicker than reading it."""
    tail = b""
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            if b"SWET" in tail + block:
                return True
            tail = block[-3:]
    return False


@dataclass(frozen=True, eq=False, repr=False)
class SpeedIdentification(Shown, SpeedResult):
    """The result of `identify_speed`. It prints as a table.

    runs, level ("good", "acceptable", "poor" or "none"), reasons, speeds (lowest, mean, highest [m/s]), fit,
    coherence, coasting: see `SpeedResult`.
    """

    @property
    def parameters(self) -> ByName[Quantity]:
        """The numbers by name: gain, lag, delay, offset, drag; coasting_drag and dead_zone if recorded.

        Empty without a law (`level` "none").

        >>> gain = speed.parameters["gain"]
        >>> round(gain.value, 1), gain.unit, gain.interval_90[0] < 5.0 < gain.interval_90[1]
        (5.0, 'm/s per full throttle', True)
        """
        return speed_parameters(self)

    def plot(self, axes: Any = None) -> Any:
        """Draws throttle and speed of every run over time; returns matplotlib axes (2, runs).

        Rows: throttle [%], speed [m/s], measured and simulated. axes: as many to draw on; default a new
        figure. UsageError for another number of axes.

        >>> speed.plot().shape
        (2, 1)
        """
        from rover_sweep.drawing.drawn import draw_speed

        return draw_speed(self, axes)

    def to_frame(self) -> Any:
        """The parameters as a pandas.DataFrame with the name as index; UsageError without pandas or a law.

        Columns: value, unit, low and high (ends of interval_90), meaning.

        >>> frame = speed.to_frame()
        >>> frame.loc["lag", "unit"], bool(frame.loc["lag", "low"] < 0.7 < frame.loc["lag", "high"])
        ('s', True)
        """
        found = self.parameters
        if not found:
            raise UsageError(f"the speed was not identified, so there are no parameters: {self.reasons[0]}")
        columns: dict[str, Any] = {name: [getattr(p, name) for p in found] for name in ("value", "unit")}
        columns["low"], columns["high"] = zip(*(p.interval_90 for p in found), strict=True)
        columns["meaning"] = [p.meaning for p in found]
        return data_frame(columns, found.keys(), "parameter")

    def report(self, directory: Location) -> PageFiles:
        """Writes speed.html and speed.json into a folder; `rover-sweep gains` reads it.

        >>> speed.report("throttle").page.name
        'speed.html'
        """

        return write_speed_report(speed_findings(self, Path(directory)), Path(directory))

    def table(self) -> ShortTable:
        """The parameters with their intervals, and the reasons for less than good."""
        low, _, high = self.speeds
        rows = tuple(
            (p.name, plain_number(p.value), p.unit, ends_words(p.low, p.high)) for p in self.parameters
        )
        title = f"speed from {len(self.runs)} throttle sweep(s), {low:.2f} to {high:.2f} m/s: {self.level}"
        return ShortTable(title, ("parameter", "value", "unit", "90 % interval"), rows, self.reasons)


def identify_speed(*sources: Location) -> SpeedIdentification:
    """Identifies the response of the speed to the throttle from all throttle sweeps of one rover.

    sources: .BIN logs, or folders of sessions; runs of the steering in them are left out. A poor result
    raises nothing: its level and reasons say so. UsageError for a missing file, DataRefused for sources
    without a throttle sweep.

    >>> speed = rs.identify_speed("throttle.BIN")
    >>> speed.level, speed.parameters.keys()[:4]
    ('good', ('gain', 'lag', 'delay', 'offset'))
    >>> rs.identify_speed("run1.BIN")
    Traceback (most recent call last):
    rover_sweep.errors.DataRefused: there is no throttle sweep in run1.BIN; it needs a .BIN with SWP_TYPE 4
    """
    given = [fspath(source) for source in sources]
    if not given:
        raise UsageError("there is no log to identify the speed from; give a .BIN of a throttle sweep")
    for source in given:
        if not Path(source).expanduser().exists() and "+" not in source:
            raise UsageError(f"{source} does not exist; give a .BIN or the folder of a session")
    sweeps = throttle_sweeps(given)
    if not sweeps:
        raise DataRefused(
            f"there is no throttle sweep in {', '.join(given)}; it needs a .BIN with SWP_TYPE 4"
        )
    found = from_sweeps(sweeps)
    return SpeedIdentification(**{f.name: getattr(found, f.name) for f in fields(found)})


def write_speed_report(findings: SpeedFindings, folder: Path) -> PageFiles:
    """Write speed.html, then speed.json, into a folder, which is created if missing.

    If the folder has the results of steering sweeps too, the page has the steering's limits from them.
    """
    text = json.dumps(speed_document(findings.result), indent=2, allow_nan=False)
    return write_page(folder, "speed", speed_report(findings), text + "\n")


def speed_findings(result: SpeedResult, folder: Path) -> SpeedFindings:
    """The result with the gains that it supports, and the results of the steering in `folder`."""
    parameters, origin = result.runs[0].parameters, "the parameters of the runs"
    limits = None
    if (folder / "identification.json").is_file():
        with suppress(RoverSweepError):  # one that supports no gains
            limits = steering_limits(steering_gains(folder, None, None, parameters, origin, None))
    proposal = proposed_speed(speed_document(result), parameters, origin)
    return SpeedFindings(result, proposal, limits, parameters, (folder / "report.html").is_file())


_STEERED = ("identification.json", "diagnosis.json")


@dataclass(frozen=True, eq=False)
class AllGains:
    """Gains that a folder of results supports: steering, its limits, and speed; None if not.

    current: the vehicle's present parameters, as far as they are known. corners: 90 degree corners of the
    steering.
    """

    steering: Proposal | None
    limits: SteeringLimits | None
    speed: SpeedProposal | None
    current: Mapping[str, float]
    corners: tuple[Corner, ...] = ()

    @property
    def text(self) -> str:
        """The .param file; "" if nothing is proposed."""
        parts = []
        if self.steering is not None and self.steering.proposed is not None:
            parts.append(param_text(self.steering))
        if self.limits is not None:
            known = ("ATC_STR_RAT_MAX", "ATC_TURN_MAX_G")
            parts.append(limits_text(self.limits, {n: self.current[n] for n in known if n in self.current}))
        if self.speed is not None and self.speed.proposed is not None:
            parts.append(speed_text(self.speed))
        return "\n".join(parts)

    @property
    def unknown(self) -> tuple[str, ...]:
        """The parameters of `text` whose present value is unknown, so that the change could not be undone."""
        return tuple(p.name for p in parse(self.text) if p.name not in self.current)

    @property
    def undo(self) -> str:
        """The present values of the parameters of `text`, as a .param file."""
        lines = (f"{p.name} {self.current[p.name]:.7g}  # was to be {p.value:g}" for p in parse(self.text))
        return "\n".join(("# The values before the proposal: load this file to undo it.", "", *lines, ""))

    @property
    def document(self) -> dict[str, Any]:
        """As plain data for JSON; the keys of the steering are at the top, as without throttle sweeps."""
        top = gains_document(self.steering) if self.steering else {}
        top = {"format": "rover-sweep gains", "format_version": 1} | top
        top |= {"limits": limits_document(self.limits)} if self.limits else {}
        top |= {"corners": corners_document(self.corners)} if self.corners else {}
        return top | ({"speed_loop": speed_gains_document(self.speed)} if self.speed else {})


def all_gains(
    place: Path,
    name: str | None,
    vehicle_file: str | None,
    current: Mapping[str, float],
    current_from: str,
    speed: float | None,
    half_width: float = HALF_WIDTH,
) -> AllGains:
    """All gains that the results support; arguments and errors as of `steering_gains`.

    half_width [m]: of the corridor about the legs of a 90 degree corner.
    """
    path = result_file(place, SPEED_FILE)
    path = path if path is not None and path.name == SPEED_FILE else None
    loop = speed_gains(path, current, current_from) if path else None
    known = {**(loop.found.parameters if loop else {}), **current}
    alone = path is not None and not any((path.parent / each).is_file() for each in _STEERED)
    if alone or (path is not None and place == path):
        return AllGains(None, None, loop, known)
    steering = steering_gains(place, name, vehicle_file, current, current_from, speed)
    limits = steering_limits(steering)
    return AllGains(steering, limits, loop, known, corners(steering, limits, half_width))
