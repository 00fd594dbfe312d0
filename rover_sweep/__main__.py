"""`python -m rover_sweep` is `rover-sweep`."""

from rover_sweep.cli.main import main

main()
