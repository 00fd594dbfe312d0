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
