"""The response of the speed to the throttle in Python: identify, inspect, draw, report."""

from __future__ import annotations

from dataclasses import dataclass, fields
from os import fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rover_sweep.api.read import Location
from rover_sweep.api.speed import throttle_sweeps
from rover_sweep.data.by_name import ByName
from rover_sweep.data.later import data_frame
from rover_sweep.data.result_table import ShortTable, Shown, plain_number
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.identification.speed.identify_speed import SpeedResult
from rover_sweep.identification.speed.identify_speed import identify_speed as from_sweeps
from rover_sweep.identification.speed.speed_parameters import SpeedParameter, speed_parameters

if TYPE_CHECKING:
    from rover_sweep.api.speed_report import SpeedFiles


@dataclass(frozen=True, eq=False, repr=False)
class SpeedIdentification(Shown, SpeedResult):
    """The result of `identify_speed`. It prints as a table.

    runs, level ("good", "acceptable", "poor" or "none"), reasons, speeds (lowest, mean, highest [m/s]), fit,
    coherence, coasting: see `SpeedResult`.
    """

    @property
    def parameters(self) -> ByName[SpeedParameter]:
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
        from rover_sweep.drawing.of_speed import draw_speed

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

    def report(self, directory: Location) -> SpeedFiles:
        """Writes speed.html and speed.json into a folder; `rover-sweep gains` reads it.

        >>> speed.report("throttle").page.name
        'speed.html'
        """
        from rover_sweep.api.speed_report import write_speed_report

        return write_speed_report(self, Path(directory))

    def table(self) -> ShortTable:
        """The parameters with their intervals, and the reasons for less than good."""
        low, _, high = self.speeds
        rows = tuple(
            (p.name, plain_number(p.value), p.unit, " - ".join(plain_number(end, 3) for end in p.interval_90))
            for p in self.parameters
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
