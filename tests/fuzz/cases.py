"""What is done with a damaged file of each kind. An answer or an error with a sentence is right."""

from __future__ import annotations

import contextlib
import io
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from random import Random

import rover_sweep as rs
from rover_sweep.api.read import with_delta
from rover_sweep.cli.main import run as command
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import parse
from rover_sweep.errors import LinkError, RoverSweepError
from rover_sweep.identification.toml_form import StructureError, structure_from_text
from rover_sweep.live.source import Telemetry
from rover_sweep.logs.read import read_runs
from rover_sweep.quality.verdict import assess
from rover_sweep.session.folder import DESCRIPTION, VEHICLE_FILE
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.transport import Transport
from sitl.plant.variant import load_variant
from tests.fuzz import seeds
from tests.fuzz.mutate import FLASH, MAVLINK, TEXT, Mutator, damaged

WHOLE, JUDGED = 0.02, 0.1  # share of logs that are whole and identified from; of short ones that are judged
WRONG = 0.1  # by which a model called good may differ from that of the undamaged log
PHYSICAL = ("C", "Izz", "k_phi", "b_phi", "tau")
MODELS = ("bicycle", "roll-yaw")


class Told(RoverSweepError):
    """A command said what is wrong."""


class WrongModel(Exception):
    """A model called good on damaged data that is another rover's."""


@dataclass(frozen=True)
class Kind:
    """Files of one kind: how they are damaged, and what reads them. whole: of a log, the whole drive and what
    identifies it, which costs a hundred times as much."""

    name: str
    seed: Callable[[], bytes]
    mutators: Sequence[Mutator]
    read: Callable[[bytes, Path, Random], None]
    whole: Callable[[], bytes] | None = None


def case(kind: Kind, folder: Path, seed: str) -> str:
    """One damaged file read: "answer" or "refused". What else is raised is a mistake of the reader."""
    random = Random(f"{seed}/{kind.name}")
    whole = kind.whole is not None and random.random() < WHOLE
    data = damaged(undamaged(kind.name, whole), random, kind.mutators)
    try:
        with quiet():
            if whole:
                identified(data, folder, kind.name)
            else:
                kind.read(data, folder, random)
    except RoverSweepError as error:
        if not str(error).strip():
            raise AssertionError("an error without a sentence") from error
        return "refused"
    return "answer"


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Nothing is printed, nobody is warned."""
    nowhere = io.StringIO()
    silenced = contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere)
    with silenced[0], silenced[1], warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


@cache
def undamaged(name: str, whole: bool = False) -> bytes:
    """The seed of a kind."""
    kind = next(kind for kind in KINDS if kind.name == name)
    return kind.whole() if whole and kind.whole else kind.seed()


# ---- recordings ----------------------------------------------------------------------------------


def _log(suffix: str) -> Callable[[bytes, Path, Random], None]:
    def read(data: bytes, folder: Path, random: Random) -> None:
        runs = _runs(data, folder, suffix)
        if random.random() < JUDGED:
            for run in runs[:2]:
                assess(run)

    return read


def _runs(data: bytes, folder: Path, suffix: str) -> tuple[Recording, ...]:
    path = folder / f"run1{suffix}"
    path.write_bytes(data)
    return read_runs(str(path))


def identified(data: bytes, folder: Path, suffix: str) -> None:
    """Raises WrongModel where damage made another rover of it that is called good."""
    for name, values in _models(_runs(data, folder, suffix)).items():
        right = right_models(suffix)[name]
        off = {p: values[p] / right[p] for p in PHYSICAL if p in values and p in right}
        if any(abs(ratio - 1.0) > WRONG for ratio in off.values()):
            raise WrongModel(f"{name} is called good and is off by {off}")


def _models(runs: Sequence[Recording]) -> Mapping[str, Mapping[str, float]]:
    rover = parse(seeds.vehicle().decode())
    whole = rs.Runs(tuple(with_delta(run, rover) for run in runs), rover)
    result = rs.identify(whole, models=MODELS, bootstrap=0)
    return {
        name: {e.name: e.value for e in model.fit.estimates if e.free}
        for name, model in result.models.items()
        if model.verdict.level == "good" and name in MODELS
    }


@cache
def right_models(suffix: str) -> Mapping[str, Mapping[str, float]]:
    """The models of the undamaged log that are called good."""
    with tempfile.TemporaryDirectory() as folder:
        return _models(_runs(undamaged(suffix, whole=True), Path(folder), suffix))


def _session(data: bytes, folder: Path, random: Random) -> None:
    """session.json is damaged, or a file beside it."""
    place = folder / "session"
    for old in place.glob("*"):
        old.unlink()
    place.mkdir(exist_ok=True)
    files = dict(_session_files())
    files[DESCRIPTION] = data
    if random.random() < 0.3:
        files["sweep1.tlog"] = damaged(files["sweep1.tlog"], random, MAVLINK)
    if random.random() < 0.1:
        files[VEHICLE_FILE] = damaged(files[VEHICLE_FILE], random, TEXT)
    for name in sorted(files):
        if random.random() < 0.95:
            (place / name).write_bytes(files[name])
    _told("status", str(place))
    if random.random() < JUDGED:
        rs.read(place)


@cache
def _session_files() -> Mapping[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        return seeds.session(Path(folder))


def _told(*arguments: str) -> None:
    """A whole command, whose exit code says that it refused."""
    if code := command(arguments):
        raise Told(f"exit code {code}")


# ---- other files ---------------------------------------------------------------------------------


def _columns(data: bytes, folder: Path, random: Random) -> None:
    path, table = folder / "columns.toml", folder / "table.csv"
    path.write_bytes(data)
    if not table.is_file():
        table.write_bytes(undamaged(".csv"))
    read_runs(str(table), column_map=str(path))


def _vehicle(data: bytes, folder: Path, random: Random) -> None:
    path = folder / "rover.toml"
    path.write_bytes(data)
    _told("vehicle", "check", str(path), *(("--json",) if random.random() < 0.5 else ()))


def _structure(data: bytes, folder: Path, random: Random) -> None:
    with contextlib.suppress(StructureError, UnicodeDecodeError):
        structure_from_text(data.decode("utf-8"))


def _variant(data: bytes, folder: Path, random: Random) -> None:
    path = folder / "variant.toml"
    path.write_bytes(data)
    with contextlib.suppress(ValueError):  # with its sentence; what calls it says it
        load_variant(path)


def _saved(data: bytes, folder: Path, random: Random) -> None:
    path = folder / "result.json"
    path.write_bytes(data)
    _told("export", str(path)) if random.random() < 0.2 else rs.load_result(path)


def _models_file(data: bytes, folder: Path, random: Random) -> None:
    path = folder / "identification.json"
    path.write_bytes(data)
    _told("gains" if random.random() < 0.03 else "export", str(folder))  # gains take seconds


# ---- the live stream -----------------------------------------------------------------------------


class Replayed(Transport):
    """A line and its transport: the bytes in pieces, and a clock that goes on with each."""

    def __init__(self, data: bytes, random: Random) -> None:
        self._data, self._random, self._at, self._now = data, random, 0, 0.0

    def open(self, url: str, timeout: float = 5.0) -> Replayed:
        return self

    def receive(self, timeout: float) -> bytes:
        if self._at >= len(self._data):
            raise ConnectionResetError("closed by the vehicle")
        self._now += 0.1
        start, self._at = self._at, self._at + self._random.choice((1, 20, 300, 3000))
        return self._data[start : self._at]

    def monotonic(self) -> float:
        return self._now

    since_boot = wall = monotonic

    def sleep(self, seconds: float) -> None:
        self._now += seconds

    def send(self, data: bytes) -> None:
        pass

    def close(self) -> None:
        pass


def _live(data: bytes, folder: Path, random: Random) -> None:
    path = folder / "live.tlog"
    path.unlink(missing_ok=True)
    telemetry = Telemetry()
    with Link.open("tcp:made:1", path, timeout=1e9, line=Replayed(data, random)) as link:  # type: ignore[arg-type]
        link.hear(lambda message: telemetry.message(message, link.clock.now))
        with contextlib.suppress(LinkError):
            while True:
                link.receive(0.5)
                if random.random() < 0.05:
                    telemetry.snapshot()


KINDS: tuple[Kind, ...] = (
    Kind(".BIN", partial(seeds.flash, seeds.SHORT), FLASH, _log(".BIN"), seeds.flash),
    Kind(".tlog", partial(seeds.telemetry, seeds.SHORT), MAVLINK, _log(".tlog"), seeds.telemetry),
    Kind(".csv", partial(seeds.table, seeds.SHORT), TEXT, _log(".csv"), seeds.table),
    Kind("column map", seeds.column_map, TEXT, _columns),
    Kind("vehicle file", seeds.vehicle, TEXT, _vehicle),
    Kind("structure", seeds.structure, TEXT, _structure),
    Kind("variant", seeds.variant, TEXT, _variant),
    Kind("session", lambda: _session_files()[DESCRIPTION], TEXT, _session),
    Kind("saved result", seeds.saved, TEXT, _saved),
    Kind("models", seeds.models, TEXT, _models_file),
    Kind("live stream", seeds.stream, MAVLINK, _live),
)
