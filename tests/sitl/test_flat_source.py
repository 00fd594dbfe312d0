"""One file out of several modules does what the modules do: names are kept apart, the unused is left out."""

from __future__ import annotations

import pytest

from sitl.twin.flat_source import flat_source

LOW = '''"""The lower module."""
import math
from os.path import join
SIZE = 2.0
"""Explains SIZE."""
# why it doubles
def _twice(x: float) -> float:
    """Of sitl.low."""
    return SIZE * x
def lower(x: float) -> float:
    return _twice(x) + math.floor(0.5)
def unused() -> str:
    return join("a", "b")
'''
HIGH = '''"""The upper module."""
from sitl.low import SIZE as LOW_SIZE
from sitl.low import lower
SIZE = 5.0
def _twice(x: float) -> float:
    return 2.0 * x
class Upper:
    SIZE = 7.0
    def value(self) -> float:
        return SIZE + sum(x for x in (1.0, 1.0)) + _twice(0.5)
    def shadowed(self, _twice: float, lower: float = LOW_SIZE) -> float:
        return _twice + lower
def everything() -> tuple[float, ...]:
    other = Upper()
    return lower(3.0), other.value(), other.shadowed(1.0), Upper.SIZE, SIZE
'''


def modules(text: str) -> dict[str, str]:
    return {"sitl.high": text, "sitl.low": LOW}


def test_names_are_kept_apart() -> None:
    text = flat_source("sitl.high", modules(HIGH))
    names: dict[str, object] = {}
    exec(text, names)
    assert names["everything"]() == (6.0, 8.0, 3.0, 7.0, 5.0)  # type: ignore[operator]
    assert "unused" not in names and "join" not in text and "import math" in text
    assert "# why it doubles\ndef _twice_low(" in text and '"""Explains SIZE."""' in text
    assert "sitl.low import" not in text


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(ValueError, match="sitl.low does not define middle"):
        flat_source("sitl.high", modules("from sitl.low import middle\nx = middle(1.0)\n"))


def test_two_libraries_of_one_name_are_refused() -> None:
    text = "from cmath import floor as math\nfrom sitl.low import lower\ny = math(lower(1.0))\n"
    with pytest.raises(ValueError, match="two imports have the name math"):
        flat_source("sitl.high", modules(text))
