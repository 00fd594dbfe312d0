"""The site builds without a warning, README stays short, and its set-up commands are those of CI."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from printed_pages import PAGES, ROOT, calls

from rover_sweep.cli.main import COMMANDS, run


@pytest.mark.parametrize("run_notebooks", ["0", pytest.param("1", marks=pytest.mark.slow)])
def test_the_site_builds_strictly(run_notebooks: str, tmp_path: Path) -> None:
    pytest.importorskip("material")
    pytest.importorskip("mkdocstrings")
    call = [sys.executable, "-m", "mkdocs", "build", "--strict", "-q", "-f", "docs/mkdocs.yml"]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1", "RUN_NOTEBOOKS": run_notebooks}
    done = subprocess.run(
        [*call, "-d", str(tmp_path)], cwd=ROOT, capture_output=True, text=True, env=environment
    )
    assert done.returncode == 0, done.stdout + done.stderr
    api = (tmp_path / "api.html").read_text()
    assert "<td>replicates for the 90 % intervals" in api and "<td><code>gyro_hz</code></td>" in api
    notebook = (tmp_path / "notebooks/identify.html").read_text()
    assert "coherence" in notebook and ("data:image/png" in notebook) == (run_notebooks == "1")


def test_the_readme_is_short_and_its_test_command_is_that_of_ci() -> None:
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) < 150
    (line,) = [row for row in text.splitlines() if row.startswith("python3 -m venv") and "pytest" in row]
    assert line in (ROOT / ".ci/run").read_text().splitlines()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)", page.read_text())
    assert not [link for link in links if "://" not in link and not (page.parent / link).exists()]


@pytest.mark.parametrize("page", [p for p in PAGES if calls(p)], ids=lambda page: page.name)
def test_options_of_printed_commands_exist(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words in calls(page):
        depth = 2 if words[1] in ("firmware", "params", "logs", "twin") and words[2:3] else 1
        names = [w for w in words[1 : 1 + depth] if not w.startswith("-") and re.fullmatch("[a-z-]+", w)]
        assert names[0] in COMMANDS and run([*names, "--help"]) == 0, words
        known = capsys.readouterr().out
        assert not [w for w in words if w.startswith("--") and w not in known], words


def test_every_command_has_a_row() -> None:
    rows = [row for row in (ROOT / "docs/commands.md").read_text().splitlines() if row.startswith("| `")]
    named = " ".join(row.split("|")[1] for row in rows)
    assert not [name for name in COMMANDS if not re.search(rf"[ `]{name}[` ]", named)]
