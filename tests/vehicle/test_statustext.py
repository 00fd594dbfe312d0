"""Status texts: what no terminal may see, chunks that are lost or never end, and what is kept of them."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as m

from rover_sweep.vehicle.link.mavlink import Codec, Message, make
from rover_sweep.vehicle.link.statustext import TextAssembler

CODEC = Codec(1, 1)


def chunk(text: bytes, number: int = 7, at: int = 0) -> Message:
    """As it comes from a link."""
    message = CODEC.decode(CODEC.pack(make("STATUSTEXT", severity=4, text=text, id=number, chunk_seq=at)))
    assert message is not None
    return message


def joined(*chunks: Message) -> list[str]:
    assembler = TextAssembler()
    return [text.text for message in chunks for text in assembler.add(message, 1.0)]


FIRST, SECOND, END = b"a" * 50, b"b" * 50, b"end"


def test_chunks_are_joined_in_any_order() -> None:
    whole = (FIRST + SECOND + END).decode()
    assert joined(chunk(FIRST), chunk(SECOND, at=1), chunk(END, at=2)) == [whole]
    assert joined(chunk(END, at=2), chunk(FIRST), chunk(SECOND, at=1)) == [whole]
    assert joined(chunk(FIRST), chunk(FIRST), chunk(SECOND, at=1), chunk(END, at=2)) == [whole]
    assert joined(chunk(END)) == ["end"] and joined(chunk(FIRST, number=0)) == [FIRST.decode()]


def test_a_text_whose_chunk_is_lost_is_shown_without_it_once_the_next_begins() -> None:
    lost = [chunk(FIRST), chunk(END, at=2), chunk(b"the next", at=0)]
    assert joined(*lost) == ["a" * 50 + "[...]end", "the next"]
    assert joined(chunk(FIRST), chunk(b"other " * 8 + b"!!", at=0)) == ["a" * 50 + "[...]"]


def test_a_text_that_is_not_ended_is_given_up_after_some_seconds_and_when_the_clock_goes_back() -> None:
    for later in (7.0, 0.0):
        assembler = TextAssembler()
        assert assembler.add(chunk(FIRST), 1.5) == () == assembler.late(2.0)
        (given_up,) = assembler.late(later)
        assert given_up.text == "a" * 50 + "[...]" and given_up.severity == 4
        assert assembler.late(later) == ()


def test_neither_a_text_nor_the_number_of_open_ones_grows_without_end() -> None:
    endless = joined(*(chunk(FIRST, at=n % 256) for n in range(2_000)))
    assert max(map(len, endless)) <= 256
    assembler = TextAssembler()
    shown = [text for number in range(1, 3_001) for text in assembler.add(chunk(FIRST, number), 1.0)]
    assert len(shown) == 3_000 - 16 and len(assembler.late(99.0)) == 16


@pytest.mark.parametrize("number", [0, 7])
def test_control_characters_become_visible(number: int) -> None:
    hostile = b"\x1b]52;c;cm0=\x07\r\x08\n\x9b31m[red]"
    assert joined(chunk(hostile, number)) == ["\\x1b]52;c;cm0=\\x07\\x0d\\x08\\x0a\ufffd31m[red]"]


@pytest.mark.parametrize(
    ("message", "field"),
    [
        (m.MAVLink_param_value_message(b"A\x1b[2J", 1.0, 9, 1, 0), "param_id"),
        (m.MAVLink_named_value_float_message(1, b"A\x1b[2J", 1.0), "name"),
        (m.MAVLink_named_value_int_message(1, b"A\x1b[2J", 1), "name"),
    ],
)
def test_names_are_printable(message: Message, field: str) -> None:
    assert getattr(CODEC.decode(CODEC.pack(message)), field) == "A\\x1b[2J"
