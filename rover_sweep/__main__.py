"""Entry point of the `rover-sweep` program, and of `python -m rover_sweep`."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line and exit with its code."""
    try:
        from rover_sweep.cli.main import run

        code = run()
    except KeyboardInterrupt:  # while the program was still being loaded
        print("rover-sweep: interrupted", file=sys.stderr)
        code = 130
    sys.exit(code)


if __name__ == "__main__":
    main()
