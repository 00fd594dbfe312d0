"""A seeded sample of the campaign: each kind of file, damaged."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from tests.fuzz.campaign import campaign, outcome, table, watchdog
from tests.fuzz.cases import KINDS, Kind, WrongModel, case, identified, right_models, undamaged

CASES = 15  # of each kind


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_damage_ends_in_an_answer_or_in_a_sentence(kind: Kind, tmp_path: Path) -> None:
    for number in range(CASES):
        with watchdog():
            assert case(kind, tmp_path, f"ci/{number}") in ("answer", "refused")


def test_the_campaign_tells_tracebacks_hangs_and_wrong_models(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def crash(data: bytes, folder: Path, random: object) -> None:
        raise ZeroDivisionError

    def hang(data: bytes, folder: Path, random: object) -> None:
        while time.process_time() >= 0.0:
            pass

    def sleep(data: bytes, folder: Path, random: object) -> None:
        time.sleep(60.0)

    def swallow(data: bytes, folder: Path, random: object) -> None:
        bytearray(1 << 60)

    monkeypatch.setattr("tests.fuzz.campaign.PATIENCE", 0.1)
    monkeypatch.setattr("tests.fuzz.campaign.ASLEEP", 0.5)
    one, reads = KINDS[0], (crash, hang, sleep, swallow)
    kinds = [Kind(one.name, one.seed, one.mutators, read) for read in reads]
    assert [outcome(kind, tmp_path, "1")[0] for kind in kinds] == ["traceback", "hang", "hang", "memory"]
    done = campaign(kinds[:1], range(3), 1)
    assert len(done.mistakes) == 1 and f"{KINDS[0].name:14}{3:9d}{0:13d}{0:13d}{3:13d}" in table(done)


def test_the_undamaged_log_gives_the_rover_that_made_it_and_another_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the .csv; tests/logs reads the others."""
    right = right_models(".csv")["roll-yaw"]
    assert right["C"] == pytest.approx(32.0, rel=0.05) and right["Izz"] == pytest.approx(0.071, rel=0.05)
    heavier = {"roll-yaw": {"Izz": 1.2 * right["Izz"]}, "bicycle": {}}
    monkeypatch.setattr("tests.fuzz.cases.right_models", lambda suffix: heavier)
    with pytest.raises(WrongModel, match="roll-yaw is called good and is off by {'Izz': 0.83"):
        identified(undamaged(".csv", whole=True), tmp_path, ".csv")
