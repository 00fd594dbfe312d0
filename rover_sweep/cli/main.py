"""The command line `rover-sweep`: one line per subcommand, loaded only when it is called.

Progress and errors go to stderr, results to stdout. Exit codes: 0 done, 1 a check of the rover failed
(`firmware check`, `preflight`, `params diff`), 2 usage, 3 data refused, 4 link, 130 interrupted.
"""

from __future__ import annotations

import difflib
import errno
import importlib
import io
import os
import sys
from collections.abc import Sequence

import click

from rover_sweep._version import __version__
from rover_sweep.cli.views.output import NAME as PLAIN_LETTERS
from rover_sweep.cli.views.output import print_error
from rover_sweep.errors import RoverSweepError

# The matrices are small: more threads in the linear algebra library would slow it down.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)

# {section: {name: one line of help}}, here so that `--help` imports nothing.
SECTIONS: dict[str, dict[str, str]] = {
    "A field day": {
        "dry-run": "Run the whole workflow on a simulated rover (no hardware).",
        "vehicle": "Print an example vehicle file, or check yours.",
        "design": "Check a sweep or doublet on paper before driving it.",
        "firmware": "Write, check or install the Lua applet and parameters.",
        "preflight": "Check everything needed before a run; fix on request.",
        "session": "Work through a whole session on one screen.",
        "run": "Drive a real rover, record, check the data, identify.",
        "resume": "Drive the remaining runs of a session.",
        "status": "Show a session's runs and what remains to drive.",
    },
    "Analysis": {
        "identify": "Identify models from recorded runs and write a report.",
        "coherence": "Check whether a run's coherence is good enough.",
        "diagnose": "Find effects that the model leaves out, and their size.",
        "investigate": "Drive, diagnose, choose the next run, until it is settled.",
        "plan": "Show which effects a set of runs can separate.",
        "gains": "Compute steering gains for the autopilot, with margins.",
        "export": "Export a model for MATLAB, python-control, or as JSON.",
        "study": "Repeat the paper's comparison on a virtual rover.",
    },
    "Recordings and simulation": {
        "columns": "Find what the columns of an unknown file are.",
        "replay": "Play a recording: pause, jump, any speed.",
        "view": "Plot any channel of a log against another, on a page.",
        "redrive": "Repeat a log's steering and speed in a simulation.",
        "twin": "Correct a simulation until it agrees with recordings.",
    },
    "The rover and the fleet": {
        "params": "Compare, set or save a rover's parameters.",
        "logs": "List and download the autopilot's logs.",
        "bench": "Measure the steering on blocks: gain, play, lag.",
        "inertia": "Compute a moment of inertia from a swing test.",
        "batch": "Show what drifted on a fleet over a season.",
    },
}
COMMANDS = {name: words for section in SECTIONS.values() for name, words in section.items()}


MODULES = {
    "dry_run": "run",
    "plan": "investigate",
    "replay": "redrive",
    "resume": "run",
    "status": "params",
    "twin": "diagnose",
    "view": "logs",
}  # of the commands that have no module of their own


class LazyGroup(click.Group):
    """A group that imports a subcommand's module only when that subcommand is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        name = cmd_name.replace("-", "_")
        module = importlib.import_module(f"rover_sweep.cli.commands.{MODULES.get(name, name)}")
        command = getattr(module, name)
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            near = difflib.get_close_matches(args[0], COMMANDS, 1)
            meant = f"; did you mean {near[0]}?" if near else ""
            raise click.UsageError(f"there is no command {args[0]!r}{meant}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        for section, commands in SECTIONS.items():
            with formatter.section(section):
                formatter.write_dl(list(commands.items()))


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="rover-sweep", message="%(prog)s %(version)s")
def cli() -> None:
    """Measure how a rover steers: design a sweep, drive it, identify models, verify them.

    Start with `rover-sweep dry-run`, which needs no hardware.
    """


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command line (sys.argv by default) and return its exit code; usage errors do not raise."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the caller, as with >&-
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=PLAIN_LETTERS)  # a plain ASCII terminal shows +- for ±, no traceback
    try:
        result = cli.main(args=arguments, prog_name="rover-sweep", standalone_mode=False)
        sys.stdout.flush()
        return result if isinstance(result, int) else 0
    except RoverSweepError as error:
        print_error(str(error), getattr(error, "__notes__", ()))
        return error.exit_code
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        return 2
    except click.ClickException as error:
        context = error.ctx if isinstance(error, click.UsageError) else None
        help_words = f" (see {context.command_path} --help)" if context else ""
        print_error(f"{error.format_message()}{help_words}")
        return error.exit_code
    except (click.Abort, KeyboardInterrupt) as error:
        print_error("interrupted", getattr(error, "__notes__", ()))
        return 130
    except SystemError as error:  # Ctrl-C within compiled code comes wrapped
        if not isinstance(error.__cause__ or error.__context__, KeyboardInterrupt):
            raise
        print_error("interrupted")
        return 130
    except BrokenPipeError:  # the reader of our output has closed, as with `| head`
        _to_nowhere()
        return 0
    except OSError as error:
        if error.errno not in FULL:
            raise
        _to_nowhere()
        print_error(f"the output cannot be written: {error.strerror}; free some space, or write elsewhere")
        return 1


def _to_nowhere() -> None:
    """Standard output goes nowhere from here on: what is still in its buffer would fail again at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
