"""`rover-sweep replay` as plain lines, and the amplitudes of `rover-sweep coherence`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rover_sweep.cli.main import run

SWEEP = "ardurover-4.6.3/applet/run1.tlog"


def lines(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, list[str], str]:
    """Exit code, lines of stdout, stderr."""
    code = run(arguments)
    out, err = capsys.readouterr()
    return code, [line.strip() for line in out.splitlines()], err


def test_without_a_terminal_it_is_lines_to_the_end(capsys: pytest.CaptureFixture[str], data: Path) -> None:
    code, out, err = lines(capsys, "replay", str(data / SWEEP))
    assert code == 0 and err == ""
    assert out[0] == "run1.tlog: 83.5 s, 1 run"
    order = [
        out.index("run1: sweep, +-150 us"),
        out.index("SWP: run 1 start sweep"),
        out.index("SWP: run 1 done"),
    ]
    verdict = next(k for k, line in enumerate(out) if line.startswith("run1: keep"))
    assert [*order, verdict] == sorted([*order, verdict])
    assert "r: good" in out[verdict:]


def test_it_begins_where_it_is_told(capsys: pytest.CaptureFixture[str], data: Path) -> None:
    _, out, _ = lines(capsys, "replay", str(data / SWEEP), "--text", "--from", "80", "--speed", "20")
    assert "SWP: run 1 done" in out and "SWP: run 1 start sweep" not in out


@pytest.mark.parametrize(
    ("name", "content", "code", "words"),
    [
        ("none.tlog", None, 2, "there is no such file"),
        ("empty.BIN", b"", 3, "is empty (0 bytes)"),
        ("words.tlog", b"words and no frames\n" * 50, 3, "hold no MAVLink frame"),
        ("words.BIN", b"words and no frames\n" * 50, 3, "not a DataFlash log"),
        ("run.csv", b"t,r\n0,0\n", 2, "cannot be played"),
        ("", None, 2, "is a folder"),
    ],
)
def test_what_cannot_be_played_ends_in_a_sentence(capsys, tmp_path, name, content, code, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    found, out, err = lines(capsys, "replay", str(tmp_path / name))
    assert found == code and out == []
    assert err.startswith("rover-sweep: ") and words in err and len(err.splitlines()) == 1


def test_a_stand_is_played_and_says_that_there_is_no_run(capsys, data, tmp_path):
    still = tmp_path / "still.tlog"
    still.write_bytes((data / SWEEP).read_bytes()[:60_000])
    code, out, _ = lines(capsys, "replay", str(still))
    assert code == 0 and out[0].endswith("no run")
    assert any("never drove" in line for line in out)


def test_coherence_proposes_amplitudes_by_octave(capsys: pytest.CaptureFixture[str], data: Path) -> None:
    _, out, _ = lines(capsys, "coherence", str(data / SWEEP))
    assert "next amplitude: 150 us is enough; 85 us would also be enough" in out
    table = out[out.index("next amplitude: 150 us is enough; 85 us would also be enough") + 1 :]
    assert table[0].split()[:3] == ["rad/s", "needed", "by"] and len(table) == 8
    _, out, _ = lines(capsys, "coherence", "--json", str(data / SWEEP))
    (verdict,) = json.loads("\n".join(out))
    assert verdict["keep"] and verdict["next"]["amplitude"] is None
    last = verdict["next"]["bands"][-1]
    assert last["wanted"] == pytest.approx(85, abs=1) and last["cap"] == "" and last["response"] == "p"


def test_a_slow_servo_and_a_slippery_ground_are_limits_with_a_word(capsys, data, tmp_path):
    ice = (data / "rover.toml").read_text().replace("friction = 0.9 ", "friction = 0.05 ")
    (tmp_path / "rover.toml").write_text(ice)
    for option, value, words in (
        ("--servo", "0.5", "your servo (0.5 s/60 deg)"),
        ("--vehicle", str(tmp_path / "rover.toml"), "the tyres' grip at 2.2 m/s (friction 0.05)"),
    ):
        _, out, _ = lines(capsys, "coherence", str(data / SWEEP), option, value)
        assert out[-1].endswith(words)  # the top octave
        (proposal,) = [line for line in out if line.startswith("next amplitude: 150 us is enough, but ")]
        assert words in proposal
