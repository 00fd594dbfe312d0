"""What the pages of the documentation print: their fenced blocks, command by command, and inline commands."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
ORDER = re.findall(r"[ \[]([\w-]+\.md)", (DOCS / "mkdocs.yml").read_text().split("nav:")[1])
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(DOCS / name for name in ORDER)]


def printed(page: Path) -> list[str]:
    """Commands of the sh blocks and whole Python blocks of a page, in its order."""
    found: list[str] = []
    for language, text in re.findall(r"^```(\w*)\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE):
        if language == "sh":
            found += [line for line in text.replace("\\\n", " ").splitlines() if line]
        elif language in ("py", "python"):
            found.append(f"python - <<'END'\n{text}END")
    return found


def calls(page: Path) -> list[list[str]]:
    """The calls of rover-sweep in the sh blocks and in the text of a page, as words."""
    inline = re.findall(
        r"`(rover-sweep\s[^`]+)`", re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S)
    )
    lines = [*printed(page), *(text.replace("\n", " ") for text in inline)]
    words = [shlex.split(line, comments=True) for line in lines if line.startswith("rover-sweep")]
    return [each for each in words if not each[1].startswith("-")]


def answers(page: Path) -> list[tuple[str, str]]:
    """(commands of an sh block, the text block after it) of a page: what they print, some lines left out."""
    blocks = re.findall(r"^```(\w+)\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)
    pairs = zip(blocks, blocks[1:], strict=False)
    return [(first[1], then[1]) for first, then in pairs if (first[0], then[0]) == ("sh", "text")]


def missing(expected: str, printed: str) -> list[str]:
    """The expected lines of which no printed one has the same words and, within a tenth, the same numbers."""
    have: dict[str, list[list[float]]] = {}
    for line in printed.splitlines():
        words, numbers = _split(line)
        have.setdefault(words, []).append(numbers)
    return [line for line in expected.splitlines() if not _among(*_split(line), have)]


def _split(line: str) -> tuple[str, list[float]]:
    """Words, with # for each number, and the numbers."""
    number = r"(?<![\w.])-?\d+(?:\.\d+)?"
    return " ".join(re.sub(number, "#", line).split()), [float(x) for x in re.findall(number, line)]


def _among(words: str, numbers: list[float], have: dict[str, list[list[float]]]) -> bool:
    near = lambda a, b: abs(a - b) <= 0.1 * abs(a)  # noqa: E731
    return any(all(map(near, numbers, others)) for others in have.get(words, []))
