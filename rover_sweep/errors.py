"""The project's own errors. Only the edges (CLI, logs, vehicle link, files) raise them.

A message is one clear sentence: what happened, the value seen, what to do. The exit code is
part of the contract of the command line: 2 usage, 3 data refused, 4 link.
"""


class RoverSweepError(Exception):
    """Base of every error that a user can do something about."""

    exit_code = 1


class UsageError(RoverSweepError):
    """A wrong option, parameter or vehicle file."""

    exit_code = 2


class DataRefused(RoverSweepError):
    """A recording that cannot be used: damaged, empty, foreign, static, unexcited."""

    exit_code = 3


class LinkError(RoverSweepError):
    """The vehicle cannot be reached, refuses, or falls silent."""

    exit_code = 4
