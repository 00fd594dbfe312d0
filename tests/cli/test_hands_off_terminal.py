"""Nothing that a vehicle or a log says reaches the terminal as a control character."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from hostile import OURS, hostile_copy, hostile_link, raw
from program_calls import DRIVEN, ROVER, SWEEP, RunProgram
from rich.console import Console
from rich.table import Table

from rover_sweep.cli.views.output import narration, results
from sitl import launcher

DATA = Path(__file__).parents[1] / "data"
EVIL = "\x1b[2J\x1b]52;c;aGk=\x07\r\x08\x7f\x9b31m\u202e\u2028[red]x[/red]"


@pytest.fixture
def hostile(ready: launcher.Running, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    hostile_link(monkeypatch)
    yield ready.connection


def test_a_console_shows_controls_as_text_and_no_markup(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table(title=EVIL)
    table.add_column(EVIL)
    table.add_row(EVIL)
    for console in (results(), narration()):
        console.print(EVIL)
        console.print(table)
    said = "".join(capsys.readouterr())
    assert not raw(said) and "\\x1b[2J" in said and "[red]x[/red]" in said


def test_a_colour_terminal_gets_only_what_rich_itself_writes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    console = results()
    with console.capture() as caught:
        console.print(EVIL, style="red")
    plain = Console(force_terminal=True, color_system="truecolor").render_str("x", style="red")
    assert plain.plain == "x" and "\x1b]52" not in caught.get() and "\x1b[2J" not in caught.get()
    assert "\x9b" not in caught.get() and "\x07" not in caught.get()


def test_a_hostile_vehicle_in_commands(hostile: str, run_program: RunProgram, tmp_path: Path) -> None:
    done = run_program("firmware", "check", "--connect", hostile)
    assert done.code in (0, 1) and not raw(done.out + done.err), done
    file = tmp_path / "all.param"
    done = run_program("params", "pull", str(file), "--connect", hostile)
    assert done.code == 0 and not raw(done.out + done.err)
    text = file.read_text(encoding="utf-8")
    assert not raw(text) and "A\\x1b]0;x\\x07\\x0a" in text and OURS not in text


@pytest.mark.slow
def test_a_hostile_vehicle_that_is_driven(
    hostile: str, run_program: RunProgram, tmp_path: Path, few_draws: None
) -> None:
    out = tmp_path / "out"
    done = run_program("run", "--connect", hostile, "--out", str(out), "--vehicle", ROVER, *SWEEP, *DRIVEN)
    assert done.code == 0, done.err
    said = done.out + done.err
    assert not raw(said) and "SWP \\x1b[2J\\x1b]52;c;aGk=\\x07" in said and "[red]" in said
    written = [path for kind in ("*.json", "*.html") for path in out.rglob(kind)]
    assert len(written) >= 3 and not any(raw(path.read_text(encoding="utf-8")) for path in written)
    status = run_program("status", str(out))
    assert status.code == 0 and not raw(status.out + status.err)


@pytest.mark.parametrize("log", ["applet/run2.BIN", "defaults/run2.tlog"])
def test_hostile_logs_in_commands(log: str, run_program: RunProgram, tmp_path: Path) -> None:
    copy = hostile_copy(DATA / "ardurover-4.6.3" / log, tmp_path)
    replayed = run_program("replay", "--text", str(copy))
    judged = run_program("coherence", str(copy))
    as_json = run_program("coherence", str(copy), "--json")
    for done in (replayed, judged, as_json):
        assert done.code == 0 and not raw(done.out + done.err), done
    assert "\\x1b[31m[red]\\u202e" in replayed.out
    assert json.loads(as_json.out)


def test_mistakes_quote_what_is_wrong_without_obeying_it(run_program: RunProgram, tmp_path: Path) -> None:
    table = tmp_path / "a.csv"
    table.write_text(f"time,{EVIL.replace(chr(13), '')}\n0,1\n", encoding="utf-8")
    vehicle = tmp_path / "rover.toml"
    vehicle.write_text('[vehicle]\n"a\\u001b[2J" = "\\u009b31m"\nmass = "\\u001b]52;"\n')
    saved = tmp_path / "identification.json"
    saved.write_text(json.dumps({"format": EVIL, "result": EVIL}))
    for command in (
        ("coherence", str(table)),
        ("vehicle", "check", str(vehicle)),
        ("coherence", EVIL),
        (EVIL,),
        ("design", "--sweep", EVIL),
        ("export", str(saved)),
        ("gains", str(saved)),
        ("status", str(tmp_path / EVIL.replace("/", ""))),
        ("preflight", "--connect", EVIL),
    ):
        done = run_program(*command)
        assert done.code in (2, 3) and done.err.startswith("rover-sweep: "), (command, done)
        assert not raw(done.out + done.err), (command, done)


def test_a_file_that_quotes_a_megabyte_of_itself_is_one_short_error(run_program, tmp_path):
    vehicle = tmp_path / "rover.toml"
    vehicle.write_text(f'[vehicle]\nmass = "{"x" * 900_000}"\n')
    done = run_program("vehicle", "check", str(vehicle))
    assert done.code == 2 and len(done.err) < 7000 and "characters left out" in done.err
