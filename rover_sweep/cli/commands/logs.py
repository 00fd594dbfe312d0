"""`rover-sweep logs`: list and download the autopilot's logs."""

from __future__ import annotations

import json
import shlex
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.options import (
    FILE,
    FOLDER,
    READING,
    argument,
    check_writable,
    option,
    options,
    refuse_input,
)
from rover_sweep.cli.vehicle_link import JSON_ALONE, LINK, VIA, LinkOptions
from rover_sweep.cli.views.output import echo, echo_json, results, say_next
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rover_sweep.api.read import Reading
    from rover_sweep.vehicle.logs import FetchedFile, Via


@click.group()
def logs() -> None:
    """List and download the autopilot's logs over the link. The rover must be disarmed."""


@logs.command("list", short_help="List the logs on the SD card.")
@options
def list_(rover: LinkOptions = LINK, as_json: bool = JSON_ALONE, via: Via = VIA) -> None:
    """List the logs on the SD card, oldest first."""
    from rover_sweep.vehicle.logs import log_source

    with rover.link() as link:
        entries = log_source(link, via).logs()
    if as_json:
        documents = [{"number": e.number, "size": e.size, "time_utc": e.time_utc} for e in entries]
        echo_json(json.dumps({"logs": documents}, indent=2))
        return
    console = results()
    if not entries:
        console.print("no log on the card")
    for entry in entries:
        began = datetime.fromtimestamp(entry.time_utc, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
        when = began if entry.time_utc else "-"  # began before GPS time was available
        console.print(f"{entry.number:5}  {entry.size / 1e6:9.2f} MB  {when}")
    if entries:
        say_next(f"rover-sweep logs fetch {entries[-1].number} --connect {rover.connect}")


@logs.command(short_help="Download logs: a number, latest or all.")
@options
def fetch(
    which: str = argument("[NUMBER|latest|all]", default="latest"),
    rover: LinkOptions = LINK,
    out: str = option("Folder to save into. [default: here]", FOLDER, default="."),
    as_json: bool = JSON_ALONE,
    via: Via = VIA,
) -> None:
    """Download logs as log<NUMBER>.BIN; a log that is already here is not downloaded again.

    latest: the last log that may contain a drive; skips the short log that the autopilot starts after a
    download. An interrupted download continues where it stopped. The size and, if the autopilot has MAVLink
    FTP, the checksum are compared with the file on the card. The rover must be disarmed.
    """
    from rover_sweep.vehicle.logs import FetchedFile, chosen_logs, log_source, settled
    from rover_sweep.vehicle.logs import fetch as bring

    console, fetched = results(as_json), list[FetchedFile]()
    check_writable(Path(out))
    with rover.link() as link:
        source = log_source(link, via)
        last = -1
        for event in bring(link, source, chosen_logs(settled(link, source), which), Path(out)):
            if isinstance(event, FetchedFile):
                fetched.append(event)
                console.print(_sentence(event), soft_wrap=True)
            elif console.is_terminal and (tenth := 10 * event.done // max(event.total, 1)) != last:
                last = tenth
                echo(f"log {event.number}: {event.done / 1e6:.1f} of {event.total / 1e6:.1f} MB", err=True)
    if as_json:
        echo_json(json.dumps({"logs": [_file_document(f) for f in fetched]}, indent=2))
    elif fetched:
        say_next(f"rover-sweep identify {shlex.quote(str(fetched[-1].path))} --out report")


def _sentence(f: FetchedFile) -> str:
    how = "checksum matches the card" if f.checked else "size matches the card; no checksum available"
    if not f.seconds:
        return f"{f.path} is already here ({how})"
    return (
        f"{f.path}: {f.size / 1e6:.2f} MB in {f.seconds:.1f} s, {f.size / 1e6 / f.seconds:.2f} MB/s ({how})"
    )


def _file_document(f: FetchedFile) -> dict[str, object]:
    import hashlib

    with f.path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    document: dict[str, object] = {
        "number": f.number,
        "path": str(f.path),
        "size": f.size,
        "seconds": f.seconds,
    }
    return document | {"checked": f.checked, "sha256": digest}


@click.command()
@options
def view(
    log: str = argument("LOG"),
    reading: Reading = READING,
    out: str | None = option("The page, one HTML file. [default: the log's name with .html, here]", FILE),
) -> None:
    """Write a page with the channels of LOG (.BIN, .tlog, .csv): any against time or another.

    The page needs no network and no other file.
    """
    from rover_sweep.cli.views.asking import long_work
    from rover_sweep.files.documents import write_file
    from rover_sweep.logs.read import read_logs
    from rover_sweep.report.in_html import log_page

    page = Path(out or f"{Path(log).stem}.html")
    refuse_input(str(page), log, reading.columns if isinstance(reading.columns, str) else None)
    if out is None and page.exists() and b"rover-sweep" not in page.read_bytes():
        raise UsageError(f"{page} exists and is no page of this program; give --out FILE")
    with long_work(f"reading {Path(log).name}"):
        logs = read_logs(log, column_map=reading.columns, filters=reading.filters, system=reading.system)
    channels = [
        {**dict(each.signals), **{_steering(s.unit, k): s for k, s in enumerate(each.steering)}}
        for each in logs
    ]
    path = write_file(page, log_page(Path(log).name, channels))
    results().print(f"page: {path}", soft_wrap=True)
    say_next("open it in a browser", f"rover-sweep coherence {shlex.quote(log)}")


def _steering(unit: str, place: int) -> str:
    """The name of a recorded steering output, best first."""
    name = "delta" if "rad" in unit else "pwm"
    return name if not place else f"{name} {place + 1}"
