"""Greek letters and signs in plain letters, for a terminal that has no others: tau instead of ?."""

from __future__ import annotations

import codecs

NAME = "rover-sweep-plain"
PLAIN = {
    **dict(
        zip("αβδκμτφψω", ("alpha", "beta", "delta", "kappa", "mu", "tau", "phi", "psi", "omega"), strict=True)
    ),
    **{"²": "^2", "³": "^3", "±": "+-", "µ": "u", "°": "deg", "·": " ", "×": "x", "√": "sqrt"},
    **{"…": "..", "–": "-", "—": "-", "−": "-", "≤": "<=", "≥": ">=", "’": "'", "→": "->", "Δ": "Delta"},
}


def in_plain_letters(error: UnicodeError) -> tuple[str, int]:
    """An error handler of `codecs`: what cannot be encoded, in ASCII; ? for what has no such form."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(PLAIN.get(c, "?") for c in error.object[error.start : error.end]), error.end


codecs.register_error(NAME, in_plain_letters)
