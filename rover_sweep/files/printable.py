"""Text from outside made safe to show: no control character reaches a terminal, a screen or a report.

A vehicle's status text may hold escape sequences that clear the screen, write the clipboard (OSC 52) or
rewrite earlier lines; a bidirectional override shows a name in another order than it has.
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
    r"""One line: each control character, line breaks included, as a visible escape such as \x1b."""
    return _ANY.sub(_escape, text)


def printable_lines(text: str) -> str:
    r"""As `printable`, for a text of our own with foreign parts: its line breaks stay."""
    return _INSIDE_LINES.sub(_escape, text)


def same_length(text: str) -> str:
    """As `printable_lines`, each by one U+FFFD, so that places in the text (styles, columns) still hold."""
    return _INSIDE_LINES.sub("\N{REPLACEMENT CHARACTER}", text)


def shortened(text: str, most: int) -> str:
    """At most `most` characters; what is left out of the middle is counted."""
    if len(text) <= most:
        return text
    half = most // 2
    return f"{text[:half]} ... ({len(text) - 2 * half} characters left out) ... {text[-half:]}"


def within_json(text: str) -> str:
    """JSON text whose strings hold no such character either, each as JSON's own escape: the same values."""
    return _INSIDE_LINES.sub(_json_escape, text)


def _json_escape(match: re.Match[str]) -> str:
    if match[0] == "\x7f":  # which JSON takes as it is
        return "\\u007f"
    return json.dumps(match[0])[1:-1]


def _escape(match: re.Match[str]) -> str:
    code = ord(match[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"
