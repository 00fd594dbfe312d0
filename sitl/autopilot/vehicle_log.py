"""Log files of the embedded rover: when it logs, into which file, and the head of every log.

Rules of AP_Logger (Rover-4.6.3): a log opens on arming (at boot with LOG_DISARMED = 1) and runs on for 15 s
after disarming. With LOG_FILE_DSRMROT = 0 it then only pauses, and the next arming goes on in the same
file; with 1 the next arming begins another. Nothing is logged while a log is being downloaded.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO

from sitl.autopilot.vehicle_parameters import Parameter, ParameterStore
from sitl.autopilot.version import FIRMWARE, VERSION
from sitl.flash_log.dataflash_writer import DataFlashWriter, LogFormat
from sitl.flash_log.formats import FORMATS, MULTIPLIERS, SCRIPT_TYPE_FIRST, UNITS

PERSIST_MS = 15_000
BUFFER = 1 << 16


class VehicleLog:
    """The numbered logs in `directory`, and the one being written. Every record carries `clock()` in us."""

    def __init__(self, directory: Path, parameters: ParameterStore, clock: Callable[[], int]) -> None:
        self.directory = directory
        self.parameters = parameters
        self.clock = clock
        self.downloading = False
        self.banner: Sequence[str] = (FIRMWARE,)
        self.on_open: list[Callable[[], None]] = []
        self._file: BinaryIO | None = None
        self._writer: DataFlashWriter | None = None
        self._armed = False
        self._disarmed_ms: int | None = None
        self._script_formats: dict[str, LogFormat] = {}
        self.late_us: Mapping[str, int] = {}
        self._reported = 0
        directory.mkdir(parents=True, exist_ok=True)
        parameters.on_change.append(self._parameter)

    # ---- which files

    def files(self) -> list[Path]:
        """The logs, oldest first; a log's id over MAVLink is its place in this list, from 1."""
        return sorted(self.directory.glob("*.BIN"))

    def erase(self) -> None:
        """Deletes every log, also the open one."""
        self.close()
        for path in self.files():
            path.unlink()
        (self.directory / "LASTLOG.TXT").unlink(missing_ok=True)

    def flush(self) -> None:
        """Puts what was logged so far into the file."""
        if self._file is not None:
            self._file.flush()

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
        self._file = self._writer = None

    # ---- when

    def set_armed(self, armed: bool) -> None:
        """Call on arming and on disarming."""
        self._armed = armed
        if armed:
            if self._disarmed_ms is not None and self.parameters["LOG_FILE_DSRMROT"]:
                self.close()
            self._open_if_needed()
        else:
            self._disarmed_ms = self.clock() // 1000

    def wanted(self) -> bool:
        """Whether the rules say that records are written now."""
        if self._armed or self.parameters["LOG_DISARMED"]:
            return True
        return self._disarmed_ms is not None and self.clock() // 1000 - self._disarmed_ms < PERSIST_MS

    def update(self) -> bool:
        """Opens or closes as the rules say, at 10 Hz; whether records are written now."""
        if self.wanted():
            self._open_if_needed()
        elif self._file is not None and self.parameters["LOG_FILE_DSRMROT"]:
            self.close()
        elif self._file is not None:
            self._file.flush()
        return self.active

    @property
    def active(self) -> bool:
        """Whether `write` writes."""
        return self._writer is not None and not self.downloading and self.wanted()

    # ---- records

    def write(self, name: str, *values: float | str | bytes) -> None:
        """A record with the time in front; dropped while nothing is being logged."""
        if self._writer is not None and self.active:
            self._writer.write(name, self.stamp(name), *values)

    def stamp(self, name: str) -> int:
        """Vehicle time [us] that a record written now carries; messages in `late_us` have another clock."""
        return max(0, self.clock() + self.late_us.get(name, 0))

    @property
    def writer(self) -> DataFlashWriter | None:
        """For many records at one time: the writer while records are written, else None."""
        return self._writer if self.active else None

    def script_write(
        self, name: str, labels: str, codes: str, values: Sequence[object], units: str, multipliers: str
    ) -> None:
        """logger:write of a script: the format is announced at its first use in each log."""
        if self._writer is None or not self.active:
            return
        fmt = self._script_formats.get(name)
        if fmt is None:
            used = {f.type for f in (*FORMATS.values(), *self._script_formats.values())}
            number = next(n for n in range(SCRIPT_TYPE_FIRST, 0, -1) if n not in used)
            pads = ("s" + (units or "?" * len(codes)), "F" + (multipliers or "?" * len(codes)))
            fmt = self._script_formats[name] = LogFormat(number, name, "Q" + codes, "TimeUS," + labels, *pads)
        if name not in self._writer.formats:
            self._writer.define(fmt)
            self._unit_record(fmt)
        self._writer.write(name, self.stamp(name), *values)  # type: ignore[arg-type]

    def statistics(self) -> None:
        """DSF, once a second: nothing is ever dropped here."""
        if self._writer is not None and self.active:
            written, self._reported = self._writer.bytes_written - self._reported, self._writer.bytes_written
            self.write("DSF", 0, self._writer.records_written & 0xFFFF, written, BUFFER, BUFFER, BUFFER)

    def _parameter(self, parameter: Parameter) -> None:
        self.write("PARM", parameter.name, parameter.value, parameter.default)

    def _open_if_needed(self) -> None:
        if self._file is not None:
            return
        files = self.files()
        number = 1 + (int(files[-1].stem) if files else 0)
        self._file = (self.directory / f"{number:08d}.BIN").open("wb", buffering=BUFFER)
        (self.directory / "LASTLOG.TXT").write_text(f"{number}\r\n", encoding="ascii")
        self._writer = DataFlashWriter(self._file, FORMATS)
        self._reported = 0
        self._head()
        for tell in self.on_open:
            tell()

    def _head(self) -> None:
        assert self._writer is not None
        for letter, label in UNITS.items():
            self.write("UNIT", ord(letter), label)
        for letter, factor in MULTIPLIERS.items():
            self.write("MULT", ord(letter), factor)
        for fmt in FORMATS.values():
            self._unit_record(fmt)
        for parameter in self.parameters:
            self.write("PARM", parameter.name, parameter.value, parameter.default)
        major, minor, patch = VERSION
        self.write("VER", 3, 65535, major, minor, patch, 255, 0, FIRMWARE, 0, 1, 2)
        for line in self.banner:
            self.write("MSG", line)

    def _unit_record(self, fmt: LogFormat) -> None:
        self.write("FMTU", fmt.type, fmt.units, fmt.multipliers)
