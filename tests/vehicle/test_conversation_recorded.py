"""Real sessions with the official firmware, played back byte by byte through the code that talks to a
vehicle: it says the same, tells the same and writes the same as then."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
from conversation_file import Conversation, ConversationEntry, read_conversation
from conversation_scenarios import APPLET, CONVERSATIONS, SCENARIOS, VERSIONS, carried_out
from transport_replayed import ConversationDiffers, ReplayedLine

from rover_sweep.errors import LinkError
from rover_sweep.vehicle.link.recorded_transport import ConversationKind

RECORDED = [(firmware, name) for firmware in VERSIONS for name in SCENARIOS]


def recorded(firmware: str, name: str) -> Conversation:
    return read_conversation(CONVERSATIONS / firmware / f"{name}.conversation")


def then(firmware: str, name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((CONVERSATIONS / firmware / f"{name}.json").read_text())
    return found


def played(name: str, conversation: Conversation, folder: Path) -> dict[str, Any]:
    line = ReplayedLine(conversation)
    happened = carried_out(SCENARIOS[name], conversation.about["url"], folder, line)
    line.finish()
    found: dict[str, Any] = json.loads(json.dumps(happened))
    return found


@pytest.mark.parametrize(("firmware", "name"), RECORDED)
def test_the_same_happens_as_on_the_firmware(
    firmware: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    applet = APPLET.read_text(encoding="utf-8")  # a survey compares with the applet of that day
    monkeypatch.setattr("rover_sweep.vehicle.setup.applet_source", lambda: applet)
    conversation, expected = recorded(firmware, name), then(firmware, name)
    began = time.process_time()
    try:
        happened = played(name, conversation, tmp_path)
    except ConversationDiffers as difference:
        with_mavftp = conversation.about["pymavlink"]
        if "FILE_TRANSFER_PROTOCOL" in str(difference) and version("pymavlink") != with_mavftp:
            pytest.skip(f"pymavlink {version('pymavlink')} transfers files otherwise than {with_mavftp}")
        raise
    assert happened["files"] == expected["files"]
    assert happened["events"] == expected["events"]
    assert time.process_time() - began < conversation.entries[-1].t


@pytest.mark.parametrize("firmware", VERSIONS)
def test_what_the_recordings_hold(firmware: str) -> None:
    """Both ends of a sweep, both ways to stop one: so that the test above shows what it is meant to show."""
    outcomes = {}
    for name in ("sweep", "limit", "switch"):
        events = then(firmware, name)["events"]
        (outcomes[name],) = [event for event in events if event[""] == "RunFinished"]
    assert outcomes["sweep"]["completed"] and outcomes["sweep"]["reason"] == "the manoeuvre ran to its end"
    assert not outcomes["limit"]["completed"] and "yaw rate" in outcomes["limit"]["reason"]
    assert not outcomes["switch"]["completed"] and "switch" in outcomes["switch"]["reason"]
    names = [event[""] for event in then(firmware, "install")["events"]]
    assert names[0] == names[-1] == "Survey" and "Rebooting" in names
    assert then(firmware, "install")["events"][-1]["applet"]["lacking"] == []
    assert any(name.endswith(".BIN") for name in then(firmware, "log")["files"])


def changed(conversation: Conversation, number: int, entry: ConversationEntry | None) -> Conversation:
    entries = list(conversation.entries)
    entries[number : number + 1] = [] if entry is None else [entry]
    return Conversation(tuple(entries), conversation.about)


def differs(name: str, conversation: Conversation, expected: dict[str, Any], folder: Path) -> bool:
    """Whether the code says so, or something else happens."""
    folder.mkdir()
    try:
        return played(name, conversation, folder) != expected
    except (ConversationDiffers, LinkError):
        return True


@pytest.mark.parametrize("name", ["install", "sweep", "log"])
def test_a_changed_byte_or_a_lost_message_does_not_pass(name: str, tmp_path: Path) -> None:
    """Of what was sent and of what was received, spread over the whole conversation."""
    conversation, expected = recorded("4.6.3", name), then("4.6.3", name)
    for kind in (ConversationKind.SENT, ConversationKind.RECEIVED):
        places = [i for i, entry in enumerate(conversation.entries) if entry.kind == kind]
        places = [i for i in places if _counts(conversation.entries[i])]
        for number in places[1 :: max(len(places) // 4, 1)]:
            entry = conversation.entries[number]
            at = 10 if kind == ConversationKind.SENT else len(entry.data) // 2
            data = entry.data[:at] + bytes([entry.data[at] ^ 0x10]) + entry.data[at + 1 :]
            for what, mutation in (("byte", replace(entry, data=data)), ("lost", None)):
                folder = tmp_path / f"{kind.name}-{number}-{what}"
                assert differs(name, changed(conversation, number, mutation), expected, folder), folder.name


def _counts(entry: ConversationEntry) -> bool:
    """Not a heartbeat or an override of ours, whose number is not compared."""
    number = int.from_bytes(entry.data[7:10], "little")
    return entry.kind != ConversationKind.SENT or number not in (0, 70)
