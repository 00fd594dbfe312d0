"""The commands of the pages run as printed, in page order, and leave nothing in the checkout.

`bash` runs them in a copy of the checkout, with a home of its own. The quick ones run by default; with
`pytest -m slow` all run except those of `NOT_RUN`, in the order of the site, in one home, as a reader would.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import matplotlib
import pytest
from printed_pages import PAGES, ROOT, answers, missing, printed

VEHICLE = "needs a vehicle at URL"
NETWORK = "installs from the network; continuous integration runs the line of README"
DRIVES = "needs drives in ACRO or AUTO; tests/gains reads recorded ones"
INSTALLED = "the tools of a developer on the checkout; tests/house runs the linters"
# The beginning of a command that is not run, why not, and a command that makes its output instead.
NOT_RUN = {
    "python3 -m venv .venv && .venv/bin/pip install -q -e . &&": (
        NETWORK,
        "rover-sweep dry-run --out ~/rover-day/dry-run",
    ),
    "python3 -m venv .venv && .venv/bin/pip install -q -e '.[test]'": (NETWORK, ""),
    "python3 -m venv .venv && . .venv/bin/activate": (NETWORK, ""),
    ".venv/bin/": (INSTALLED, ""),
    "rover-sweep firmware install --connect URL": (VEHICLE, ""),
    "rover-sweep preflight --connect URL": (VEHICLE, ""),
    "rover-sweep run --connect URL --vehicle rover.toml --sweep": (VEHICLE, "cp -r dry-run today"),
    "rover-sweep run --connect URL --vehicle rover.toml --throttle-sweep": (VEHICLE, ""),
    "rover-sweep columns LOG": ("needs a recording of your own; tests/logs makes some", ""),
    "rover-sweep identify LOG": ("needs a log of your own; tests/driving makes some", ""),
    "rover-sweep gains speed/report": ("needs the throttle sweep of a vehicle", ""),
    "rover-sweep gains today/report --connect URL": (VEHICLE, ""),
    "rover-sweep gains --check": (DRIVES, ""),
    "rover-sweep gains today/report --check": (DRIVES, ""),
    "rover-sweep bench": (VEHICLE, ""),
    "rover-sweep batch logs/": ("needs the logs of a season; the page's other call is run", ""),
    "python -m sitl.embedded": ("serves until it is stopped; tests/tui and tests/cli connect to it", ""),
    "rover-sweep session": ("a screen with keys; tests/tui presses them", ""),
}
# The beginning of a command that takes long or needs the result of one that does: only with `pytest -m slow`.
LONG = (
    "rover-sweep dry-run",
    "rover-sweep diagnose",
    "rover-sweep twin",
    "rover-sweep plan",
    "rover-sweep batch",
    "rover-sweep gains dry-run/report",
    "cp -r dry-run today",
    "for n in 1 2 3 4; do rover-sweep redrive",
    "rover-sweep identify run1.BIN+run1.tlog",
    "python - <<'END'\nimport rover_sweep as rs\n\nruns =",
    "python - <<'END'\nimport rover_sweep as rs\n\ndriven =",
)
QUICK = [p for p in PAGES if p.stem in ("README", "tutorial", "vehicle-file", "simulation", "throttle")]
SLOW = {"simulation": pytest.mark.slow, "throttle": pytest.mark.slow}


def beginning(command: str, of: tuple[str, ...]) -> str:
    return next((start for start in of if command.startswith(start)), "")


def runnable(page: Path) -> list[str]:
    """The commands of a page, with the replacement of those that are not run."""
    listed = tuple(NOT_RUN)
    found = [NOT_RUN[start][1] if (start := beginning(c, listed)) else c for c in printed(page)]
    return [command for command in found if command]


def quick(page: Path) -> list[str]:
    return [command for command in runnable(page) if not beginning(command, LONG)]


def folder_of_the_tutorial() -> list[str]:
    """The commands that copy the recordings of the examples into a folder of the reader's."""
    (block,) = re.findall(
        r"```sh\n(mkdir -p ~/rover-day\n.*?)```", (ROOT / "docs/tutorial.md").read_text(), re.DOTALL
    )
    return block.splitlines()


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    copy = tmp_path_factory.mktemp("checkout")
    for name in ("tests/data", "docs"):
        shutil.copytree(ROOT / name, copy / name)
    shutil.copy(ROOT / "README.md", copy)
    return copy


def tree(folder: Path) -> dict[str, tuple[int, int]]:
    """Size and time of change of each file, and the folders."""
    found = {path: path.stat() for path in folder.rglob("*")}
    return {str(path): (s.st_size, s.st_mtime_ns) if path.is_file() else (0, 0) for path, s in found.items()}


def follow(commands: list[str], checkout: Path, home: Path) -> str:
    """Run commands in one shell that begins in the checkout; returns what they print.

    Fails at the first exit code that is not 0.
    """
    before = tree(checkout)
    script = "\n".join(["set -ex", *folder_of_the_tutorial(), f"cd {checkout}", *commands])
    environment = os.environ | {
        "HOME": str(home),
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "MPLCONFIGDIR": matplotlib.get_configdir(),  # its list of fonts takes seconds to make
    }
    done = subprocess.run(
        ["bash", "-c", script],
        cwd=checkout,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert done.returncode == 0, done.stdout[-4000:]
    assert tree(checkout) == before, "a command changes the checkout"
    return done.stdout


def test_every_command_is_run_or_listed_with_a_reason() -> None:
    commands = [command for page in PAGES for command in printed(page)]
    unused = [start for start in NOT_RUN if not any(c.startswith(start) for c in commands)]
    unused += [s for s in LONG if not any(c.startswith(s) for page in PAGES for c in runnable(page))]
    assert not unused, "listed, but no page prints it"
    left = {command: page.name for page in PAGES if page not in QUICK for command in quick(page)}
    assert not [c for c in left if not c.startswith(("cd ", "mkdir ", "cp ", "for r in "))], left
    assert not [c for c in commands if "URL" in c and not beginning(c, tuple(NOT_RUN))]


def test_the_python_of_readme_is_that_of_its_page() -> None:
    blocks = [
        [c for c in printed(page) if "rs.identify" in c]
        for page in PAGES
        if page.name in ("README.md", "python.md")
    ]
    assert len(blocks) == 2 and blocks[0] == blocks[1] != []  # test_python_api runs it


@pytest.mark.parametrize("page", [pytest.param(p, id=p.stem, marks=SLOW.get(p.stem, ())) for p in QUICK])
def test_quick_commands_run_as_printed(page: Path, checkout: Path, tmp_path: Path) -> None:
    said = follow(quick(page), checkout, tmp_path)
    for commands, shown in answers(page):
        if not any(beginning(line, LONG) for line in commands.splitlines()):
            assert missing(shown, said) == []
    if page.stem == "tutorial":  # docs/draw_pictures.py copies them from this report
        drawn = {path.name for path in (tmp_path / "rover-day/report/pictures").iterdir()}
        copied = re.findall(r"pictures/(?!session)([\w-]+\.svg)", page.read_text())
        assert copied and set(copied) <= drawn


@pytest.mark.slow
def test_all_commands_run_in_the_order_of_the_site(checkout: Path, tmp_path: Path) -> None:
    """In one home: a page may use the results of an earlier one."""
    for page in PAGES:
        said = follow(runnable(page), checkout, tmp_path)
        assert not [line for _, shown in answers(page) for line in missing(shown, said)]
