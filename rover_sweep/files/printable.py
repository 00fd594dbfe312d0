"""Makes external text safe to show: no control character reaches a terminal, a screen or a report.

A vehicle's status text may contain escape sequences that clear the screen, write the clipboard (OSC 52) or
rewrite earlier lines; a bidirectional override shows a name in a wrong order.
"""

from __future__ import annotations

import json
import re

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
    """As `printable_lines`, but each becomes one U+FFFD, so that positions (styles, columns) stay valid."""
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
