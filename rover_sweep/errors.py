"""The errors of this project that users see. Only the edges (CLI, logs, vehicle link, files) raise them.

A message is one sentence: what happened, the value, what to do. Scripts rely on the exit codes:
2 usage, 3 data refused, 4 link.
"""


class RoverSweepError(Exception):
    """Base of every error that a user can act on."""

    exit_code = 1


class UsageError(RoverSweepError):
    """A wrong option, parameter or vehicle file."""

    exit_code = 2


def missing_extra(need: str, extra: str) -> UsageError:
    """need: "X needs library Y"; extra: of pyproject.toml. The package itself is on no index."""
    return UsageError(
        f"{need}, which is not installed; in the folder of rover-sweep, run: pip install -e '.[{extra}]'"
    )


class DataRefused(RoverSweepError):
    """A recording that cannot be used: damaged, empty, of an unknown format, or without steering."""

    exit_code = 3


class LinkError(RoverSweepError):
    """The vehicle cannot be reached, refuses, or falls silent."""

    exit_code = 4
