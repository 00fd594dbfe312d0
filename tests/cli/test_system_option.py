"""--system and --signing-key: which vehicle behind --connect is meant, and the key that it wants."""

from __future__ import annotations

from collections.abc import Iterator

import click
import pytest
from program_calls import RunProgram
from pymavlink.dialects.v20 import ardupilotmega as m

from rover_sweep.cli import vehicle_link as which_vehicle
from rover_sweep.cli.main import cli
from rover_sweep.vehicle.link import transport
from rover_sweep.vehicle.link.connection import Heard
from rover_sweep.vehicle.link.transport import Transport

STRANGER = 7
BOTH = [Heard(1, "ground rover"), Heard(STRANGER, "ground rover")]


class _WithStranger(Transport):
    """A connection on whose channel another rover's heartbeat is heard with each chunk."""

    def __init__(self, inner: Transport) -> None:
        self._inner, self._mav = inner, m.MAVLink(None, srcSystem=STRANGER, srcComponent=1)
        self.send, self.close = inner.send, inner.close  # type: ignore[method-assign]

    def receive(self, timeout: float) -> bytes:
        data = self._inner.receive(timeout)
        return data + bytes(m.MAVLink_heartbeat_message(10, 3, 0, 0, 4, 3).pack(self._mav)) if data else b""


@pytest.fixture
def stranger(monkeypatch: pytest.MonkeyPatch) -> None:
    opened = transport.LiveLine.open
    monkeypatch.setattr(
        transport.LiveLine, "open", lambda self, url, timeout=5.0: _WithStranger(opened(self, url, timeout))
    )


def commands(group: click.Group, name: str = "") -> Iterator[tuple[str, click.Command]]:
    context = click.Context(group)
    for each in group.list_commands(context):
        command = group.get_command(context, each)
        if isinstance(command, click.Group):
            yield from commands(command, f"{name}{each} ")
        elif command is not None:
            yield f"{name}{each}", command


def test_each_command_that_connects_has_them() -> None:
    options = {name: {o for p in c.params for o in p.opts} for name, c in commands(cli)}
    connecting = {name for name, has in options.items() if "--connect" in has}
    assert len(connecting) >= 13
    assert {name for name in connecting if not {"--system", "--signing-key"} <= options[name]} == set()


def test_two_rovers_are_named_and_one_is_taken_by_its_id(run_program, fresh, stranger, monkeypatch):
    where = ("logs", "list", "--connect", fresh.connection)
    done = run_program(*where)
    assert done.code == 2
    names = f"system 1 (ground rover), system {STRANGER} (ground rover); choose one with --system N"
    assert f"2 vehicles are heard on {fresh.connection}: {names}" in done.err
    done = run_program(*where, "--system", "1")
    assert done.code == 0 and "no log on the card" in done.out
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("click.termui.visible_prompt_func", lambda words: "1")
    done = run_program(*where)
    assert done.code == 0 and "2 vehicles are heard:\n  system 1 (ground rover)" in done.err


def test_the_question_takes_only_one_that_is_heard(monkeypatch, capsys):
    answers = iter(["", "9", "one", "7"])
    monkeypatch.setattr("click.termui.visible_prompt_func", lambda words: next(answers))
    assert which_vehicle._ask_system(BOTH) == 7
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (("run", "--system", "3"), "give --connect too"),
        (("gains", "x", "--signing-key", "k"), "--signing-key needs --connect"),
        (("preflight", "--connect", "tcp:127.0.0.1:1", "--signing-key", "/dev/null"), "holds no signing key"),
        (("preflight", "--connect", "tcp:127.0.0.1:1", "--signing-key", "nothing"), "nothing cannot be read"),
        (("preflight", "--connect", "tcp:127.0.0.1:1", "--system", "0"), "0 is not in the range"),
        (("preflight", "--connect", "tcp:127.0.0.1:1", "--system", "256"), "256 is not in the range"),
    ],
)
def test_a_wrong_one_is_a_sentence(run_program: RunProgram, command: tuple[str, ...], words: str) -> None:
    done = run_program(*command)
    assert done.code == 2 and words in done.err
