"""Words in large letters, three or five rows high, readable from a distance."""

from __future__ import annotations

_DOTS = {
    "A": "01110 10001 11111 10001 10001",
    "B": "11110 10001 11110 10001 11110",
    "C": "1111 1000 1000 1000 1111",
    "D": "1110 1001 1001 1001 1110",
    "E": "1111 1000 1110 1000 1111",
    "F": "1111 1000 1110 1000 1000",
    "G": "1111 1000 1011 1001 1111",
    "H": "1001 1001 1111 1001 1001",
    "I": "1 1 1 1 1",
    "J": "0001 0001 0001 1001 1111",
    "K": "1001 1010 1100 1010 1001",
    "L": "1000 1000 1000 1000 1111",
    "M": "10001 11011 10101 10001 10001",
    "N": "10001 11001 10101 10011 10001",
    "O": "1111 1001 1001 1001 1111",
    "P": "1111 1001 1111 1000 1000",
    "Q": "1111 1001 1001 1011 1111",
    "R": "1111 1001 1111 1010 1001",
    "S": "1111 1000 1111 0001 1111",
    "T": "11111 00100 00100 00100 00100",
    "U": "1001 1001 1001 1001 1111",
    "V": "10001 10001 01010 01010 00100",
    "W": "10001 10001 10101 11011 10001",
    "X": "10001 01010 00100 01010 10001",
    "Y": "10001 01010 00100 00100 00100",
    "Z": "1111 0001 0110 1000 1111",
    " ": "00 00 00 00 00",
    "?": "1111 0001 0110 0000 0100",
}
_BLOCKS = {"00": " ", "10": "▀", "01": "▄", "11": "█"}


def big(words: str) -> tuple[str, str, str]:
    """Three rows of equal length, one dot per half block; skips unknown letters."""
    rows = (*_rows(words), "0" * len(_rows(words)[0]))
    return (_pair(rows[0], rows[1]), _pair(rows[2], rows[3]), _pair(rows[4], rows[5]))


def huge(words: str) -> tuple[str, ...]:
    """Five rows, one dot per two columns."""
    return tuple("".join("██" if dot == "1" else "  " for dot in row) for row in _rows(words))


def _rows(words: str) -> tuple[str, ...]:
    """Five rows of dots, 0 and 1."""
    letters = [_DOTS[letter].split() for letter in words.upper() if letter in _DOTS]
    return tuple("0".join(letter[n] for letter in letters) for n in range(5))


def _pair(upper: str, lower: str) -> str:
    return "".join(_BLOCKS[a + b] for a, b in zip(upper, lower, strict=True))
