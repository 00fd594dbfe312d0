"""`rover-sweep logs` on the embedded rover: listed, fetched by both libraries, gone on with, refused."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from rover_sweep.vehicle.link.link import Link
from sitl import launcher


@pytest.fixture(scope="module")
def rover(tmp_path_factory: pytest.TempPathFactory) -> Iterator[launcher.Running]:
    """A rover with two logs on its card: it was armed twice, and logs each time into a new file."""
    options = ("--parameter", "LOG_FILE_DSRMROT=1")
    with launcher.start_embedded(tmp_path_factory.mktemp("logs"), options=options) as running:
        for _ in range(2):
            armed_for_a_while(running.connection, running.directory / "x.tlog")
        yield running


def armed_for_a_while(url: str, tlog: Path, disarm: bool = True) -> None:
    with Link.open(url, tlog) as link:
        while link.command("MAV_CMD_COMPONENT_ARM_DISARM", 1.0) != 0:  # not before it has a position
            link.receive(0.1)
        link.wait_for("HEARTBEAT", 5.0, lambda _: link.armed)
        for _ in range(3):
            link.wait_for("HEARTBEAT", 5.0)
        if disarm:
            link.require("disarm", "MAV_CMD_COMPONENT_ARM_DISARM", 0.0)
            link.wait_for("HEARTBEAT", 5.0, lambda _: not link.armed)
            start = link.clock.now
            while link.clock.now < start + 16:  # it logs on for 15 s
                link.request_message("SYSTEM_TIME")


def on_card(rover: launcher.Running) -> list[Path]:
    return sorted((rover.directory / "logs").glob("*.BIN"))


@pytest.mark.parametrize("via", ["mavlink", "mavsdk"])
def test_listed_and_fetched_byte_by_byte(run_program, rover, tmp_path, via):
    where = ("--connect", rover.connection, "--via", via)
    listed = json.loads(run_program("logs", "list", "--json", *where).out)["logs"]
    cards = on_card(rover)
    assert [(log["number"], log["size"]) for log in listed] == [
        (n, card.stat().st_size) for n, card in enumerate(cards, 1)
    ]
    assert " MB " in run_program("logs", "list", *where).out
    done = run_program("logs", "fetch", "all", "--json", "--out", str(tmp_path), *where)
    assert done.code == 0, done.err
    fetched = json.loads(done.out)["logs"]
    for log, card in zip(fetched, cards, strict=True):
        assert Path(log["path"]).read_bytes() == card.read_bytes()
        assert log["sha256"] == hashlib.sha256(card.read_bytes()).hexdigest()
        assert log["checked"] and log["seconds"] > 0
    again = run_program("logs", "fetch", "latest", "--out", str(tmp_path), *where)
    assert again.code == 0 and "log2.BIN is already here (checksum matches the card)" in again.out
    assert len(list(tmp_path.iterdir())) == 2


def test_an_interrupted_download_goes_on(run_program, rover, tmp_path):
    whole = on_card(rover)[0].read_bytes()
    (tmp_path / "log1.BIN.part").write_bytes(whole[: len(whole) // 2])
    done = run_program("logs", "fetch", "1", "--out", str(tmp_path), "--connect", rover.connection)
    assert done.code == 0 and (tmp_path / "log1.BIN").read_bytes() == whole
    (tmp_path / "log2.BIN").write_bytes(b"somebody else's")
    done = run_program("logs", "fetch", "2", "--out", str(tmp_path), "--connect", rover.connection)
    assert (tmp_path / "log2.BIN").read_bytes() == b"somebody else's" and "log2-2.BIN" in done.out


def test_no_logs_and_mistakes_are_one_sentence_and_an_armed_rover_gives_none(
    run_program, rover, fresh, tmp_path
):
    for arguments, code, said in (
        (("fetch", "7", "--connect", rover.connection), 2, "no log 7 on the vehicle; there are 1 to 2"),
        (("fetch", "--connect", fresh.connection), 2, "it writes one once it is armed"),
        (("fetch", "--connect", rover.connection, "--out", "/dev/null/x"), 2, "/dev/null/x cannot be"),
        (("list", "--connect", "tcp:127.0.0.1:1"), 4, "cannot open tcp:127.0.0.1:1"),
    ):
        done = run_program("logs", *arguments)
        assert (done.code, done.out) == (code, "") and said in done.err and done.err.count("\n") == 1
    assert "no log on the card" in run_program("logs", "list", "--connect", fresh.connection).out
    armed_for_a_while(fresh.connection, tmp_path / "x.tlog", disarm=False)
    where = ("--connect", fresh.connection, "--via", "mavsdk")
    for command in (("logs", "list"), ("logs", "fetch"), ("params", "push", "--yes")):
        done = run_program(*command, *where)
        assert done.code == 4 and "preflight --connect URL --fix armed" in done.err.splitlines()[-1]
