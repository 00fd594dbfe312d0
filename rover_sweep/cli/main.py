"""The command line `rover-sweep`: one line per subcommand, loaded only when it is called.

Narration and errors go to stderr, results to stdout. Exit codes: 0 done, 1 a rover that does not fit
(`firmware check`, `preflight`, `params diff`), 2 usage, 3 data refused, 4 link, 130 interrupted.
"""

from __future__ import annotations

import importlib
import io
import os
import sys
from collections.abc import Sequence

import click

from rover_sweep._version import __version__
from rover_sweep.cli.views.output import tell_error
from rover_sweep.errors import RoverSweepError

# The matrices here are small: threads of the linear algebra library cost more than they bring.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# name -> one line of help, here so that `--help` imports nothing. `dry-run` is `commands.dry_run.dry_run`.
COMMANDS: dict[str, str] = {
    "dry-run": "The whole job on a simulated rover, no hardware needed.",
    "session": "The whole afternoon on one screen, by single keys.",
    "run": "Drive, record, judge and identify a real rover.",
    "resume": "Drive what a session left to drive.",
    "status": "What a session holds, and what is to drive.",
    "firmware": "Applet and parameters: write, check, install.",
    "preflight": "What must be right before a run, and put right.",
    "params": "A rover's parameters: compare, set, save.",
    "logs": "The autopilot's own logs: list, fetch.",
    "design": "A sweep or doublet on paper, before it is driven.",
    "identify": "Recorded runs in, identified models and a report out.",
    "diagnose": "What the model leaves out: where, what, how much.",
    "plan": "Which runs tell which effects apart, before they are driven.",
    "coherence": "Is this run good enough? The verdict alone.",
    "replay": "Play a recording: pause, jump, any speed.",
    "redrive": "A log's own steering and speed through a simulation.",
    "study": "The paper's comparison, repeated on a virtual rover.",
    "export": "A model for MATLAB, python-control, or as JSON.",
    "gains": "Steering gains for the autopilot, with margins.",
    "inertia": "Moment of inertia from a swing test.",
    "bench": "The steering on blocks: gain, play, lag into the vehicle file.",
    "vehicle": "Print an example vehicle file, or check yours.",
}


class LazyGroup(click.Group):
    """A group that imports a subcommand's module only when that subcommand is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        name = cmd_name.replace("-", "_")
        command = getattr(importlib.import_module(f"rover_sweep.cli.commands.{name}"), name)
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            raise click.UsageError(_no_such_command(args[0]), ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


def _no_such_command(name: str) -> str:
    import difflib

    near = difflib.get_close_matches(name, COMMANDS, 1)
    return f"there is no command {name!r}" + (f"; did you mean {near[0]}?" if near else "")


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="rover-sweep", message="%(prog)s %(version)s")
def cli() -> None:
    """Find out how a rover really steers: design a sweep, drive it, identify models, verify them.

    Begin with `rover-sweep dry-run`, which needs no hardware.
    """


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command line (sys.argv by default); returns its exit code, a user's mistake included."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a plain ASCII terminal shows ? for ±, and no traceback
    try:
        result = cli.main(args=arguments, prog_name="rover-sweep", standalone_mode=False)
        sys.stdout.flush()
        return result if isinstance(result, int) else 0
    except RoverSweepError as error:
        tell_error(str(error), getattr(error, "__notes__", ()))
        return error.exit_code
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        return 2
    except click.ClickException as error:
        tell_error(f"{error.format_message()}{_see_help(error)}")
        return error.exit_code
    except (click.Abort, KeyboardInterrupt) as error:
        tell_error("interrupted", getattr(error, "__notes__", ()))
        return 130
    except BrokenPipeError:  # the reader of our output went away, as in `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _see_help(error: click.ClickException) -> str:
    context = error.ctx if isinstance(error, click.UsageError) else None
    return f" (see {context.command_path} --help)" if context else ""


def main() -> None:
    """Entry point of the `rover-sweep` program."""
    sys.exit(run())


if __name__ == "__main__":
    main()
