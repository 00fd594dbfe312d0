"""TOML and JSON from unknown sources: a hostile or damaged text gives an error of one sentence.

The parsers of the standard library raise RecursionError on deep nesting and ValueError on a number of more
than 4,300 digits, and tomllib takes minutes for a key of 100,000 parts.
"""

from __future__ import annotations

import json
import os
import re
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

from rover_sweep.errors import UsageError

DEEPEST = 100  # nested objects or lists; our files have about 30
LONGEST_LINE = 10_000  # characters of a line of TOML


def read_toml(text: str) -> dict[str, Any]:
    """The document; tomllib.TOMLDecodeError with a sentence for anything else."""
    lines = text.split("\n")
    number, line = max(enumerate(lines, 1), key=lambda numbered: len(numbered[1]))
    if len(line) > LONGEST_LINE:
        raise tomllib.TOMLDecodeError(
            f"line {number} has {len(line)} characters, more than {LONGEST_LINE}; is the file damaged?"
        )
    try:
        found = tomllib.loads(text)
    except RecursionError:
        raise tomllib.TOMLDecodeError(_too_deep()) from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError as error:  # an invalid date, a number that is too long
        raise tomllib.TOMLDecodeError(_number_words(error)) from None
    if _is_deep(found):
        raise tomllib.TOMLDecodeError(_too_deep())
    if any(
        type(part) is int and abs(part) > sys.float_info.max for level in _levels(found) for part in level
    ):
        raise tomllib.TOMLDecodeError("a whole number has more than 308 digits; is the file damaged?")
    return found


def read_json(text: str, parse_constant: Callable[[str], Any] | None = None) -> Any:
    """The value; ValueError with a sentence for invalid JSON. parse_constant: as in json.loads."""
    try:
        found = json.loads(text, parse_constant=parse_constant)
    except RecursionError:
        raise ValueError(_too_deep()) from None
    except json.JSONDecodeError:
        raise
    except ValueError as error:
        raise ValueError(_number_words(error)) from None
    if _is_deep(found):
        raise ValueError(_too_deep())
    return found


def _too_deep() -> str:
    return f"more than {DEEPEST} nested brackets or keys; is the file damaged?"


def _number_words(error: ValueError) -> str:
    """Python's message on a long number, without its advice to programmers."""
    return str(error).partition(";")[0]


def _is_deep(value: Any) -> bool:
    """True when objects or lists are nested more than `DEEPEST` times."""
    return next((True for depth, _ in enumerate(_levels(value)) if depth == DEEPEST), False)


def _levels(value: Any) -> Iterator[list[Any]]:
    """The parts of the value, level by level of nesting."""
    level = [value]
    while level := [part for whole in level for part in _parts(whole)]:
        yield level


def _parts(value: Any) -> Iterable[Any]:
    """The items of an object or a list."""
    return value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()


def toml_hint(text: str, message: str) -> str:
    """A hint on the common mistakes in TOML: a decimal comma, or a unit after the number."""
    line = re.search(r"line (\d+)", message)
    lines = text.splitlines()
    if not line or not 0 < int(line[1]) <= len(lines):
        return ""
    content = lines[int(line[1]) - 1].strip()
    if re.search(r"=\s*-?\d+,\d", content):
        return f"; write decimals with a point: {content}"
    if re.search(r"=\s*-?[\d.]+\s*[A-Za-z°]", content):
        return f"; write the number without its unit: {content}"
    return f": {content}"


# Makes external text safe to show: no control character reaches a terminal, a screen or a report.
#
# A vehicle's status text may contain escape sequences that clear the screen, write the clipboard (OSC 52) or
# rewrite earlier lines; a bidirectional override shows a name in a wrong order.


# C0 and C1 controls, DEL; marks that change the direction of text; line and paragraph separators; halves of
# surrogate pairs (file names that are not UTF-8); invisible tags.
_UNSAFE = (
    r"\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069"
    r"\ud800-\udfff\ufeff\U000e0000-\U000e007f"
)
_ANY = re.compile(f"[{_UNSAFE}]")
_INSIDE_LINES = re.compile(f"(?!\n)[{_UNSAFE}]")


def printable(text: str) -> str:
    r"""One line: control characters, line breaks included, become visible escapes such as \x1b."""
    return _ANY.sub(_escape, text)


def printable_lines(text: str) -> str:
    r"""As `printable`, but line breaks stay: for our own text with external parts."""
    return _INSIDE_LINES.sub(_escape, text)


def same_length(text: str) -> str:
    """As `printable_lines`, but each becomes U+FFFD, so that positions (styles, columns) stay valid."""
    return _INSIDE_LINES.sub("\N{REPLACEMENT CHARACTER}", text)


def shortened(text: str, most: int) -> str:
    """At most about `most` characters; the middle is replaced by the number of characters left out."""
    if len(text) <= most:
        return text
    half = most // 2
    return f"{text[:half]} ... ({len(text) - 2 * half} characters left out) ... {text[-half:]}"


def within_json(text: str) -> str:
    """JSON text with these characters as JSON escapes; its values stay the same."""
    return _INSIDE_LINES.sub(_json_escape, text)


def _json_escape(match: re.Match[str]) -> str:
    if match[0] == "\x7f":  # which JSON does not escape
        return "\\u007f"
    return json.dumps(match[0])[1:-1]


def _escape(match: re.Match[str]) -> str:
    code = ord(match[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


# Writing a file as a whole, and removing it.


def write_file(path: Path, content: str | bytes) -> Path:
    """Replaces a file in one step, with the mode of the umask; UsageError when it cannot be written."""
    data = content.encode("utf-8") if isinstance(content, str) else content
    temporary = path.with_name(f".{path.name}.{os.urandom(4).hex()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("xb") as file:
            file.write(data)
        os.replace(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise UsageError(f"{path} cannot be written: {error.strerror}; choose another place") from error
    return path


def remove_file(path: Path) -> None:
    """Removes a file if it exists; UsageError when that is not allowed."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror}; choose another place") from error


def numbered(path: Path) -> Iterator[Path]:
    """The path, then with -2, -3, ... before its suffix."""
    yield path
    yield from (path.with_name(f"{path.stem}-{n}{path.suffix}") for n in count(2))
