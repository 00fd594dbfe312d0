"""Control characters are made visible, and nothing else is touched."""

from __future__ import annotations

import json
import unicodedata

from rover_sweep.files.documents import printable, printable_lines, same_length, shortened, within_json

CONTROLS = "".join(map(chr, [*range(0x20), *range(0x7F, 0xA0)]))
DIRECTIONS = "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069\u200e\u200f\u061c"
OTHERS = "\u2028\u2029\ufeff\udc80\U000e0041"
ORDINARY = "Grüße, 車, e\u0301, שלום, ±1°, [red] $x$ \\x1b \u200d👩‍🔧 a\u00a0b"


def test_each_control_character_is_shown_as_an_escape() -> None:
    for character in CONTROLS + DIRECTIONS + OTHERS:
        shown = printable(f"a{character}b")
        assert shown.isascii() and shown.isprintable() and shown.startswith("a\\"), repr(character)
        assert eval(f"'{shown}'") == f"a{character}b"
        assert same_length(f"a{character}b") == ("a\nb" if character == "\n" else "a\ufffdb")
    assert printable("\x1b]0;x\x07\u202e") == "\\x1b]0;x\\x07\\u202e"
    assert printable_lines("one\ntwo\r\n") == "one\ntwo\\x0d\n" and printable("\n") == "\\x0a"


def test_whole_unicode_but_controls_stays() -> None:
    assert printable(ORDINARY) == ORDINARY == same_length(ORDINARY)
    every = "".join(c for c in map(chr, range(0x3000)) if unicodedata.category(c)[0] in "LMNPSZ")
    assert printable(every).replace("\\u2028", "\u2028").replace("\\u2029", "\u2029") == every


def test_json_keeps_its_values() -> None:
    value = {"text": CONTROLS + DIRECTIONS + OTHERS + ORDINARY, "list": ["\x9b", "\x7f"]}
    safe = within_json(json.dumps(value, ensure_ascii=False, indent=2))
    assert json.loads(safe) == value
    assert not any(
        unicodedata.category(c) in ("Cc", "Cf", "Cs") for c in safe.replace("\n", "").replace("\u200d", "")
    )


def test_a_long_text_is_shortened_and_says_by_how_much() -> None:
    assert shortened("abc", 3) == "abc"
    assert shortened("a" * 600 + "z" * 400, 10) == "aaaaa ... (990 characters left out) ... zzzzz"
