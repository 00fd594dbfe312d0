"""`rover-sweep batch` on recordings, with threads in place of processes."""

from __future__ import annotations

import csv
import json
import shutil
import sys
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest

from rover_sweep.batch import measured_logs as measured_module
from rover_sweep.batch.measured_logs import (
    VehicleFiles,
    log_sources,
    measured_logs,
    read_vehicle_files,
    workers,
)
from rover_sweep.cli.main import run
from rover_sweep.errors import DataRefused, RoverSweepError, UsageError
from tests.season.prepared_days import vehicle_logs

RECORDED = Path(__file__).parents[1] / "data" / "concealed-ardurover"


@contextmanager
def threads(*_: object) -> Iterator[Executor]:
    """Workers without the start of a process."""
    with ThreadPoolExecutor(1) as pool:
        yield pool


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A doublet, the same log under another name, a text file as .BIN, and the vehicle file beside them."""
    folder = tmp_path_factory.mktemp("season") / "logs"
    folder.mkdir()
    shutil.copy(RECORDED / "c" / "run4.BIN", folder / "2026-03-01.BIN")
    shutil.copy(RECORDED / "a" / "run4.BIN", folder / "2026-03-15.BIN")
    (folder / "2026-03-20.BIN").write_text("not a log")
    shutil.copy(RECORDED / "c" / "rover.toml", folder / "rover.toml")
    return folder


@pytest.fixture
def in_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rover_sweep.batch.measured_logs.workers", threads)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_a_season_and_its_restart(
    logs: Path,
    tmp_path: Path,
    in_threads: None,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture,
) -> None:
    out = tmp_path / "out"
    assert run(["batch", str(logs), "--out", str(out)]) == 0
    said = capfd.readouterr()
    assert "2026-03-20.BIN is not a DataFlash log" in said.out and "3 of 3 logs done" in said.err
    season = json.loads((out / "season.json").read_text())
    assert [len(v["logs"]) for v in season["vehicles"]] == [2]
    assert len(season["refused"]) == 1 and "1 could not be used" in season["sentence"]
    with (out / "logs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [r["day"] for r in rows] == ["2026-03-01", "2026-03-15", ""]
    assert "not a DataFlash log" in (out / "season.html").read_text()
    assert len(list((out / "vehicles").glob("*.html"))) == 1

    before = contents(out)
    monkeypatch.setattr(measured_module, "measure", lambda *_: pytest.fail("measured again"))
    assert run(["batch", str(logs), "--out", str(out)]) == 0
    assert contents(out) == before
    assert "3 of 3 logs were done before" in capfd.readouterr().err


def test_each_day_is_diagnosed_once(
    logs: Path, tmp_path: Path, in_threads: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[str, ...]] = []

    def fake(sources: tuple[str, ...], name: str, text: str) -> dict:
        asked.append(tuple(Path(s).name for s in sources))
        return {"sentence": "none: nothing is missing", "files": {"diagnosis.html": "<p>"}}

    monkeypatch.setattr(
        "rover_sweep.batch.measured_logs._fitted", lambda *_: vehicle_logs("rover", 1, 1)[0].fit
    )
    monkeypatch.setattr("rover_sweep.batch.season_of_logs.diagnose_day", fake)
    call = ["batch", str(logs), "--diagnose", "--out", str(tmp_path)]
    assert run(call) == run(call) == 0
    assert asked == [("2026-03-01.BIN",), ("2026-03-15.BIN",)]
    pages = [p for p in (tmp_path / "vehicles").iterdir() if "nothing is missing" in p.read_text()]
    assert len(pages) == 1
    assert len(list((tmp_path / "diagnoses").glob("*/2026-03-*/diagnosis.html"))) == 2


def test_another_vehicle_file_measures_again(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = str(logs / "2026-03-01.BIN")
    files = VehicleFiles({"rover": (logs / "rover.toml").read_text()})
    other = VehicleFiles({"rover": files.texts["rover"] + "# lighter\n"})
    monkeypatch.setattr("rover_sweep.batch.measured_logs._fitted", lambda *_: None)
    left: list[int] = []
    with threads() as pool:
        for given in (files, files, other, VehicleFiles({}), files):
            measured_logs([source], given, tmp_path, pool, lambda done, rest: done or left.append(rest))
    assert left == [1, 0, 1, 1, 1]


def test_a_killed_process_keeps_what_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from concurrent.futures.process import BrokenProcessPool

    def killed(source: str, files: VehicleFiles) -> dict:
        if source.endswith("b.BIN"):
            raise BrokenProcessPool("killed")
        return real(source, files)

    real = measured_module.measure
    for name in ("a.BIN", "b.BIN"):
        (tmp_path / name).write_text(name)
    sources = [str(tmp_path / name) for name in ("a.BIN", "b.BIN")]
    monkeypatch.setattr(measured_module, "measure", killed)
    with pytest.raises(RoverSweepError, match="run the same command again"), threads() as pool:
        measured_logs(sources, VehicleFiles({}), tmp_path / "kept", pool)
    assert len(list((tmp_path / "kept").iterdir())) == 1


def test_logs_by_url(logs: Path, tmp_path: Path) -> None:
    fsspec = pytest.importorskip("fsspec")
    memory = fsspec.filesystem("memory")
    for name in ("2026-04-01.BIN", "2026-04-02.BIN"):
        memory.pipe(f"/rover-1/{name}", b"not a log")
    sources = log_sources(["memory://rover-1/*.BIN"])
    assert [s.rpartition("/")[2] for s in sources] == ["2026-04-01.BIN", "2026-04-02.BIN"]
    with threads() as pool:
        found = measured_logs(sources, VehicleFiles({}), tmp_path, pool)
    assert all("is not a DataFlash log" in log.refused and log.sha256 for log in found)


def test_dask_gives_the_same_bytes(
    logs: Path, tmp_path: Path, in_threads: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed")
    source = str(logs / "2026-03-01.BIN")
    assert run(["batch", source, "--out", str(tmp_path / "threads")]) == 0
    monkeypatch.setattr("rover_sweep.batch.measured_logs.workers", workers)
    with distributed.LocalCluster(
        1, processes=False, threads_per_worker=1, dashboard_address=":0"
    ) as cluster:
        call = ["batch", source, "--scheduler", cluster.scheduler_address, "--out", str(tmp_path / "dask")]
        assert run(call) == 0
    assert contents(tmp_path / "dask") == contents(tmp_path / "threads")


def test_a_missing_extra_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.setitem(sys.modules, "fsspec.core", None)
    with (
        pytest.raises(UsageError, match=r"--scheduler needs Dask, .* pip install -e '\.\[fleet\]'"),
        workers(None, "tcp://127.0.0.1:1"),
    ):
        pass
    with pytest.raises(UsageError, match=r"pip install -e '\.\[fleet\]'"):
        log_sources(["s3://bucket/*.BIN"])


def test_vehicle_files_of_a_fleet(tmp_path: Path) -> None:
    text = (RECORDED / "c" / "rover.toml").read_text()
    for name in ("rover", "rover-1", "rover-12"):
        (tmp_path / f"{name}.toml").write_text(text)
    (tmp_path / "fleet.toml").write_text('[boards]\nrover-12 = ["Cube A"]\n')
    files = read_vehicle_files(tmp_path)
    assert files.of("x/1.BIN", "Cube A") == ("rover-12", "rover-12")
    assert files.of("logs/rover-1/1.BIN", "Cube B") == ("rover-1", "rover-1")
    assert files.of("logs/rover-12-march.BIN", "") == ("rover-12", "rover-12")
    assert files.of("logs/other/1.BIN", "Cube B") == ("rover", "")
    with pytest.raises(DataRefused, match="no vehicle file for 1.BIN of the board Cube B"):
        VehicleFiles({}).of("logs/1.BIN", "Cube B")
    (tmp_path / "fleet.toml").write_text('[boards]\nrover-3 = ["Cube A"]\n')
    with pytest.raises(UsageError, match="rover-3"):
        read_vehicle_files(tmp_path)


def test_logs_of_a_folder(tmp_path: Path) -> None:
    """A .tlog beside its .BIN is left out."""
    with pytest.raises(UsageError, match="holds no .BIN and no .tlog"):
        log_sources([str(tmp_path)])
    for name in ("1.BIN", "1.tlog", "2.tlog"):
        (tmp_path / name).touch()
    assert [Path(s).name for s in log_sources([str(tmp_path)])] == ["1.BIN", "2.tlog"]
