"""Serve a simulated rover to the official firmware until Ctrl-C: for `twin serve`."""

from __future__ import annotations

import time
from pathlib import Path

from rover_sweep.errors import LinkError, UsageError


def serve_twin(place: Path, ardurover: Path | None, physics: bool, instance: int, seed: int) -> None:
    """Start the firmware with the variant as its physics, or the physics alone; wait for Ctrl-C."""
    from sitl.plant.variant import load_variant

    variant = place / "variant.toml" if place.is_dir() else place
    if not variant.is_file():
        raise UsageError(f"{place} has no variant.toml; give the folder that `rover-sweep twin` wrote")
    try:
        load_variant(variant.resolve())
    except ValueError as error:
        raise UsageError(str(error)) from error
    if physics:
        _serve_physics(variant, instance, seed)
    else:
        _serve_firmware(variant, ardurover, instance, seed)


def _serve_physics(variant: Path, instance: int, seed: int) -> None:
    from rover_sweep.cli.views.output import narration
    from sitl.json_server import main

    narration().print(
        f"start the firmware with `ardurover --model JSON:127.0.0.1 --instance {instance}`; Ctrl-C ends this",
        soft_wrap=True,
        markup=False,
    )
    main(["--variant", str(variant.resolve()), "--instance", str(instance), "--seed", str(seed)])


def _serve_firmware(variant: Path, ardurover: Path | None, instance: int, seed: int) -> None:
    from firmware_params.param_files import shipped
    from rover_sweep.cli.views.output import narration, results
    from sitl import launcher

    home = variant.parent / "served"
    try:
        running = launcher.start_ardurover(
            launcher.find_ardurover(ardurover),
            home,
            variant=variant.resolve(),
            seed=seed,
            instance=instance,
            defaults=[shipped("identification")],
        )
    except launcher.LaunchError as error:
        raise LinkError(f"{error}; --physics serves the JSON interface alone") from error
    with running:
        results().print(running.connection, markup=False)
        narration().print(
            f"the twin is served: connect a ground station to {running.connection}; its logs are in {home}; "
            "Ctrl-C ends it",
            soft_wrap=True,
            markup=False,
        )
        _wait(running)


def _wait(running: object) -> None:
    """Until Ctrl-C. LinkError where the firmware or its physics ends by itself."""
    try:
        while not (words := running.last_words()):  # type: ignore[attr-defined]
            time.sleep(1.0)
    except KeyboardInterrupt:
        return
    raise LinkError(f"the simulated rover ended by itself: {words}")
