"""Recordings of other systems as tables: .csv, Parquet, MATLAB, PX4's ULog, ROS bags and MCAP.

A table has one stream for each topic, or for each length of a MATLAB file's vectors; all columns of a stream
were recorded together. Several files of one drive are joined by their clocks: every column keeps its own
samples, so that nothing is interpolated before it is needed.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.data.recording import Array, Note
from rover_sweep.errors import DataRefused, missing_extra
from rover_sweep.logs.log import source_of
from rover_sweep.logs.readers.date_times import NoSuchTime, times_of
from rover_sweep.logs.readers.text_table import read_text_table

FEWEST_ROWS = 20  # of a topic or a vector; shorter ones are settings
WIDEST = 32  # columns of a matrix or array; wider ones are maps and pictures
LARGEST = 20_000  # bytes of a message; larger ones are pictures and scans
OTHER_CLOCK = 1.0  # s between stamp and arrival of a message, from which its stamps are of another clock


@dataclass(frozen=True, eq=False)
class TableStream:
    """Columns that were recorded together: names, and for each its (n,) numbers or, of a .csv, its cells.

    time: (n,) s on the recording's clock; None where the file does not say which column is the time.
    parsed, dated: the columns that were asked for as numbers, and as times.
    """

    names: tuple[str, ...]
    cells: tuple[Array | list[str], ...]
    time: Array | None = None
    parsed: dict[str, Array | None] = field(default_factory=dict)
    dated: dict[str, Array | None] = field(default_factory=dict)

    def __contains__(self, column: str) -> bool:
        return column in self.names

    def __len__(self) -> int:
        return len(self.cells[0])

    def __getitem__(self, column: str) -> Array | list[str]:
        return self.cells[self.names.index(column)]

    def numbers(self, column: str) -> Array | None:
        """A column as (n,) numbers, nan where it is empty; None where it has other cells."""
        if column not in self.parsed:
            cells = self[column]
            self.parsed[column] = _floats(cells) if isinstance(cells, list) else cells
        return self.parsed[column]

    def times(self, column: str) -> Array | None:
        """(n,) s of a column of date-times, nan where it is empty; None where it has other cells.

        DataRefused for a date that does not exist, or has no such time.
        """
        if column not in self.dated:
            cells = self[column]
            try:
                self.dated[column] = times_of(cells) if isinstance(cells, list) else None
            except NoSuchTime as wrong:
                raise DataRefused(
                    f"column {column} has {wrong.cell.strip()[:40]!r} in row {wrong.row}, but {wrong.why}; "
                    "correct that row, or remove it"
                ) from None
        return self.dated[column]


@dataclass(frozen=True, eq=False)
class RecordedTable:
    """The streams of one recording. name: of its file or files; sources: (file name, sha256) of each.

    unsure: channels whose unit is a guess.
    """

    name: str
    stem: str
    streams: tuple[TableStream, ...]
    sources: tuple[tuple[str, str], ...]
    notes: tuple[Note, ...] = field(default=())
    unsure: tuple[str, ...] = ()

    @property
    def header(self) -> list[str]:
        """Names of all columns, as often as they occur."""
        return [name for stream in self.streams for name in stream.names]

    def of(self, column: str) -> TableStream:
        """The stream that has a column; KeyError without one."""
        for stream in self.streams:
            if column in stream:
                return stream
        raise KeyError(column)


def read_table(paths: Sequence[Path]) -> RecordedTable:
    """The table of one file, or of several files of one drive: their columns are then `stem.column`.

    DataRefused for a file that cannot be read, UsageError where the library for it is not installed.
    """
    tables = [_read(path) for path in paths]
    if len(tables) == 1:
        return tables[0]
    stems = [table.stem for table in tables]
    if len(set(stems)) < len(stems):  # of several folders
        stems = [f"{path.parent.name}/{path.stem}" for path in paths]
    streams = [
        replace(stream, names=tuple(f"{stem}.{name}" for name in stream.names))
        for stem, table in zip(stems, tables, strict=True)
        for stream in table.streams
    ]
    return RecordedTable(
        "+".join(table.name for table in tables),
        "+".join(stems),
        tuple(streams),
        tuple(source for table in tables for source in table.sources),
        tuple(note for table in tables for note in table.notes),
    )


def _read(path: Path) -> RecordedTable:
    folder = path.is_dir()
    read = READERS["bag" if folder else path.suffix.lower()]
    notes: list[Note] = []
    streams = tuple(read(path, notes))
    _refuse_impossible_dates(path.name, streams)
    files = sorted(p for p in path.iterdir() if p.is_file()) if folder else [path]
    if not streams:
        raise DataRefused(f"{path.name} holds no series of at least {FEWEST_ROWS} numbers")
    return RecordedTable(path.name, path.stem, streams, tuple(map(source_of, files)), tuple(notes))


def _refuse_impossible_dates(name: str, streams: Sequence[TableStream]) -> None:
    for stream in streams:
        for column in stream.names:
            try:
                stream.times(column)
            except DataRefused as refusal:
                raise DataRefused(f"{name}: {refusal}") from None


def _library(name: str, what: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        library = name.partition(".")[0]
        raise missing_extra(f"{what} needs {library}", "readers") from error


def _csv(path: Path, notes: list[Note]) -> Iterator[TableStream]:
    found = read_text_table(path)
    notes += found.notes
    yield TableStream(found.names, found.cells)


def _floats(cells: list[str]) -> Array | None:
    for given in (cells, (cell.strip() or "nan" for cell in cells)):  # the first is quicker
        try:
            return np.array(list(given), dtype=float)
        except ValueError:
            continue
    return None


def _parquet(path: Path, notes: list[Note]) -> Iterator[TableStream]:
    parquet = _library("pyarrow.parquet", "a Parquet file")
    types = _library("pyarrow.types", "a Parquet file")
    try:
        table = parquet.read_table(path).flatten()
    except (OSError, ValueError) as error:
        raise DataRefused(f"{path.name} is not a Parquet file: {str(error).splitlines()[0]}") from error
    found: dict[str, Array | list[str]] = {}
    for name, column in zip(table.column_names, table.columns, strict=True):
        kind = column.type
        if types.is_timestamp(kind):
            stamps = column.to_numpy().astype("datetime64[ns]")
            found[name] = np.where(np.isnat(stamps), np.nan, stamps.astype("int64") * 1e-9)
        elif types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind):
            found[name] = np.asarray(column.to_numpy(), float)
        elif types.is_string(kind) or types.is_large_string(kind):
            found[name] = [str(cell or "") for cell in column.to_pylist()]
    if found and table.num_rows >= 1:
        yield TableStream(tuple(found), tuple(found.values()))


def _matlab(path: Path, notes: list[Note]) -> Iterator[TableStream]:
    """Vectors and narrow matrices, also those in structures (a.b); matrices are a[1], a[2], ..."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        try:
            content = loadmat(path, simplify_cells=True)
        except NotImplementedError:  # version 7.3
            content = _library("mat73", "a MATLAB file of version 7.3").loadmat(str(path))
    except (MatReadError, ValueError, OSError, TypeError, KeyError) as error:
        raise DataRefused(f"{path.name} is not a MATLAB file: {error}") from error
    by_length: dict[int, dict[str, Array]] = {}
    for name, column in _vectors("", content):
        by_length.setdefault(column.size, {})[name] = column
    for columns in by_length.values():
        yield TableStream(tuple(columns), tuple(columns.values()))


def _vectors(prefix: str, value: Any) -> Iterator[tuple[str, Array]]:
    if isinstance(value, Mapping):
        for name, part in value.items():
            if not str(name).startswith("__"):
                yield from _vectors(f"{prefix}.{name}" if prefix else str(name), part)
        return
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf":
        return
    x = np.squeeze(value)
    if x.ndim == 2 and min(x.shape) <= WIDEST and max(x.shape) >= FEWEST_ROWS:
        for n, row in enumerate(x if x.shape[1] > x.shape[0] else x.T, 1):
            yield f"{prefix}[{n}]", np.asarray(row, float)
    elif x.ndim == 1 and x.size >= FEWEST_ROWS:
        yield prefix, np.asarray(x, float)


def _ulog(path: Path, notes: list[Note]) -> Iterator[TableStream]:
    """One stream for each topic; a further instance of a topic is topic:1."""
    pyulog = _library("pyulog", "a ULog file")
    try:
        log = pyulog.ULog(str(path))
    except Exception as error:  # the library raises what damaged bytes lead to
        raise DataRefused(f"{path.name} is not a ULog file, or damaged: {error}") from error
    for topic in log.data_list:
        stamps = np.asarray(topic.data["timestamp"], float) * 1e-6
        if stamps.size >= FEWEST_ROWS:
            name = topic.name + (f":{topic.multi_id}" if topic.multi_id else "")
            columns = {f: np.asarray(x, float) for f, x in topic.data.items() if f != "timestamp"}
            yield TableStream(tuple(f"{name}.{f}" for f in columns), tuple(columns.values()), stamps)


# Of the messages that steer most small cars, which older bags hold without their definition
_ACKERMANN = (
    "float32 steering_angle\nfloat32 steering_angle_velocity\nfloat32 speed\n"
    "float32 acceleration\nfloat32 jerk"
)
_STAMPED = "std_msgs/Header header\nackermann_msgs/AckermannDrive drive"


def _bag(path: Path, notes: list[Note]) -> Iterator[TableStream]:
    """One stream for each topic of a ROS 1 or 2 bag or an MCAP file with ROS messages."""
    highlevel = _library("rosbags.highlevel", "a ROS bag or an MCAP file")
    typesys = _library("rosbags.typesys", "a ROS bag or an MCAP file")
    store = typesys.get_typestore(typesys.Stores.LATEST)
    for text, kind in ((_ACKERMANN, "AckermannDrive"), (_STAMPED, "AckermannDriveStamped")):
        store.register(typesys.get_types_from_msg(text, f"ackermann_msgs/msg/{kind}"))
    rows: dict[str, _Topic] = {}
    unknown: dict[str, str] = {}
    try:
        with highlevel.AnyReader([path], default_typestore=store) as reader:
            for connection, arrival, raw in reader.messages():
                topic, kind = connection.topic, connection.msgtype
                if topic in unknown or len(raw) > LARGEST:
                    continue
                try:
                    message = reader.deserialize(raw, kind)
                except (KeyError, AttributeError, ValueError, TypeError):
                    unknown[topic] = kind
                    continue
                if topic not in rows:
                    rows[topic] = _Topic(tuple(_fields(message)))
                rows[topic].add(message, arrival * 1e-9)
    except Exception as error:  # three formats, each with errors of its own
        raise DataRefused(f"{path.name} cannot be read as a ROS bag: {error}") from error
    if unknown:
        words = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(unknown.items()))
        notes.append(Note("warning", f"the bag does not hold the definition of {words}; left out"))
    for topic, kept in rows.items():
        if len(kept.arrivals) >= FEWEST_ROWS and kept.numbered:
            numbers = np.array(kept.numbers, float).T
            yield TableStream(
                tuple(f"{topic}.{name}" for name, _ in kept.numbered), tuple(numbers), kept.time()
            )


@dataclass
class _Topic:
    """The messages of one topic. numbered: (name, how to get its number from a message)."""

    numbered: tuple[tuple[str, Callable[[Any], Any]], ...]
    numbers: list[list[float]] = field(default_factory=list)
    arrivals: list[float] = field(default_factory=list)
    stamps: list[float] = field(default_factory=list)

    def add(self, message: Any, arrival: float) -> None:
        try:
            self.numbers.append([get(message) for _, get in self.numbered])
        except IndexError:  # a sequence that became shorter
            return
        self.arrivals.append(arrival)
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        self.stamps.append(stamp.sec + stamp.nanosec * 1e-9 if stamp is not None else np.nan)

    def time(self) -> Array:
        """The sender's stamps, unless they are of another clock than the recorder's."""
        stamps, arrivals = np.array(self.stamps), np.array(self.arrivals)
        if np.all(np.abs(stamps - arrivals) < OTHER_CLOCK):
            return stamps
        return arrivals


def _fields(message: Any) -> Iterator[tuple[str, Callable[[Any], Any]]]:
    """(name, getter) of each number in messages like this one."""
    for name in (f.name for f in fields(message)):
        value = getattr(message, name)
        if name == "header" or "covariance" in name:
            continue
        if is_dataclass(value):
            for below, get in _fields(value):
                yield f"{name}.{below}", _chained(attrgetter(name), get)
        elif isinstance(value, bool | int | float | np.number):
            yield name, attrgetter(name)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf" and value.size <= WIDEST:
            for k in range(value.size):
                yield f"{name}[{k}]", _chained(attrgetter(name), itemgetter(k))


def _chained(first: Callable[[Any], Any], second: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda message: second(first(message))


READERS: Mapping[str, Callable[[Path, list[Note]], Iterator[TableStream]]] = {
    ".csv": _csv,
    ".tsv": _csv,
    ".txt": _csv,
    ".parquet": _parquet,
    ".mat": _matlab,
    ".ulg": _ulog,
    ".bag": _bag,
    ".db3": _bag,
    ".mcap": _bag,
    "bag": _bag,  # the folder of a ROS 2 bag
}
_ENDINGS = [ending for ending in READERS if ending.startswith(".")]
TABLES = f"{', '.join(_ENDINGS[:-1])} or {_ENDINGS[-1]}"
"""The endings of the files that are read, in words."""


def is_table_file(path: Path) -> bool:
    """True for a file that `read_table` reads, and for the folder of a ROS 2 bag."""
    return (path / "metadata.yaml").is_file() if path.is_dir() else path.suffix.lower() in READERS
