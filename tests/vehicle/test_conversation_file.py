"""Conversations on disk, and those with the official firmware played back byte by byte."""

from __future__ import annotations

import json
import time
from importlib.metadata import version
from pathlib import Path

import pytest
from conversation_file import Conversation, ConversationEntry
from conversation_file import read_conversation as read
from conversation_file import write_conversation as write
from conversation_scenarios import APPLET, CONVERSATIONS, SCENARIOS, VERSIONS, carried_out
from fake_vehicle import FakeVehicle
from transport_replayed import ConversationDiffers, ReplayedLine

from firmware_params.applet_parameters import version_of
from rover_sweep.errors import LinkError
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.recorded_transport import (
    ConversationKind,
    ConversationWriter,
    RecordedLine,
    conversation_in,
)
from rover_sweep.vehicle.parameters import read_present, write_parameter

ENTRIES = tuple(ConversationEntry(kind, 0.25 * kind, bytes(range(40 * kind))) for kind in ConversationKind)


def test_what_is_written_comes_back(tmp_path: Path) -> None:
    write(tmp_path / "a", Conversation(ENTRIES, {"url": "tcp:x"}))
    found = read(tmp_path / "a")
    assert found.entries == ENTRIES and found.about["url"] == "tcp:x" and found.whole


def test_a_killed_program_loses_no_more_than_the_last_second(tmp_path: Path) -> None:
    writer = ConversationWriter(tmp_path / "a", {})
    for n in range(50):
        writer.write(ConversationKind.RECEIVED, 100_000 * n, bytes([n]) * 200)
    left = (tmp_path / "a").read_bytes()  # as it is on disk while the program still runs
    (tmp_path / "b").write_bytes(left)
    found = read(tmp_path / "b")
    assert not found.whole
    assert 40 <= len(found.entries) <= 50
    assert all(entry.data == bytes([n]) * 200 for n, entry in enumerate(found.entries))
    writer.close()
    assert len(read(tmp_path / "a").entries) == 50


def test_no_recording_overwrites_another(tmp_path: Path) -> None:
    for name in ("session.conversation", "session-2.conversation"):
        path = conversation_in(tmp_path)
        assert path.name == name
        RecordedLine(path).close()


def _conversation(vehicle: FakeVehicle, folder: Path) -> tuple[Path, dict[str, float]]:
    path = folder / "a.conversation"
    with RecordedLine(path) as line, Link.open(vehicle.url, folder / "a.tlog", line=line) as link:
        write_parameter(link, "SWP_V_MAX", 3.0)
        return path, read_present(link, ["SWP_V_MAX", "NONE_SUCH"])


def test_a_reboot_is_part_of_the_conversation(vehicle: FakeVehicle, tmp_path: Path) -> None:
    path = tmp_path / "a.conversation"
    with RecordedLine(path) as line, Link.open(vehicle.url, tmp_path / "a.tlog", line=line) as link:
        vehicle.hang_up()
        link.reconnect(10.0)
        then = link.clock.now
    kinds = [entry.kind for entry in read(path).entries]
    assert kinds.count(ConversationKind.OPENED) == kinds.count(ConversationKind.CLOSED) == 2
    again = ReplayedLine(read(path))
    with Link.open(vehicle.url, tmp_path / "b.tlog", line=again) as link:
        link.reconnect(10.0)
        assert link.clock.now == then
    again.finish()


def test_a_refused_connection_is_refused_again(tmp_path: Path) -> None:
    path = tmp_path / "a.conversation"
    with RecordedLine(path) as line, pytest.raises(LinkError) as then:
        Link.open("tcp:127.0.0.1:1", tmp_path / "a.tlog", line=line)
    with pytest.raises(LinkError) as now:
        Link.open("tcp:127.0.0.1:1", tmp_path / "b.tlog", line=ReplayedLine(read(path)))
    assert str(now.value) == str(then.value)


def test_what_differs_is_noticed(vehicle: FakeVehicle, tmp_path: Path) -> None:
    path, found = _conversation(vehicle, tmp_path)
    assert found == {"SWP_V_MAX": 3.0}

    def opened() -> Link:
        return Link.open(vehicle.url, tmp_path / "b.tlog", line=ReplayedLine(read(path)))

    said = "sends PARAM_SET.*param_value=3.5.*it sent PARAM_SET.*param_value=3.0"
    with pytest.raises(ConversationDiffers, match=said):
        write_parameter(opened(), "SWP_V_MAX", 3.5)
    with pytest.raises(ConversationDiffers, match="closes the connection, where then it sent PARAM_REQUEST"):
        opened().close()
    again = ReplayedLine(read(path))
    with Link.open(vehicle.url, tmp_path / "c.tlog", line=again) as link:
        write_parameter(link, "SWP_V_MAX", 3.0)
        with pytest.raises(ConversationDiffers, match="has ended, where then"):
            again.finish()


# ---- Sessions with the official firmware: the code says the same, tells the same and writes the same.


@pytest.mark.parametrize("firmware", VERSIONS)
@pytest.mark.parametrize("name", SCENARIOS)
def test_the_same_happens_as_on_the_firmware(firmware, name, tmp_path, monkeypatch):
    applet = APPLET.read_text(encoding="utf-8")  # a survey compares with the applet of that day
    monkeypatch.setattr("rover_sweep.vehicle.setup.applet_source", lambda: applet)
    monkeypatch.setattr("rover_sweep.vehicle.setup.applet_version", lambda: float(version_of(applet)))
    conversation = read(CONVERSATIONS / firmware / f"{name}.conversation")
    expected = json.loads((CONVERSATIONS / firmware / f"{name}.json").read_text())
    began, line = time.process_time(), ReplayedLine(conversation)
    try:
        happened = carried_out(SCENARIOS[name], conversation.about["url"], tmp_path, line)
        line.finish()
    except ConversationDiffers as difference:
        with_mavftp = conversation.about["pymavlink"]
        if "FILE_TRANSFER_PROTOCOL" in str(difference) and version("pymavlink") != with_mavftp:
            pytest.skip(f"pymavlink {version('pymavlink')} transfers files otherwise than {with_mavftp}")
        raise
    assert happened["files"] == expected["files"]
    assert json.loads(json.dumps(happened["events"])) == expected["events"]
    assert time.process_time() - began < conversation.entries[-1].t
