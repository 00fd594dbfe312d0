"""Simulates a model with the recorded steering and speed of a run: `rs.simulate`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.api.save import is_diagnosis, result_document, result_file
from rover_sweep.data.recording import Array, Recording, data_frame, steered
from rover_sweep.data.results import ShortTable, Shown, plain_number
from rover_sweep.diagnosis.result import Diagnosis
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.identification.model_results import ModelResult

UNITS = {"r": "rad/s", "ay": "m/s^2", "p": "rad/s", "vy": "m/s", "vydot": "m/s^2"}


@dataclass(frozen=True, eq=False, repr=False)
class Simulation(Shown):
    """The channels of a run as simulated by a model.

    run, model: their names. t (n,) s on the recording's clock. signals, measured: {channel: (n,)}
    of r, p [rad/s], ay [m/s^2], vy [m/s], vydot [m/s^2], ISO axes; measured: as recorded, minus the gyros'
    biases at standstill.
    """

    run: str
    model: str
    t: Array
    signals: Mapping[str, Array]
    measured: Mapping[str, Array]

    def error(self, channel: str) -> float:
        """RMS of measured minus simulated, in the unit of the channel; UsageError without that channel."""
        if channel not in self.measured or channel not in self.signals:
            both = ", ".join(c for c in self.signals if c in self.measured)
            raise UsageError(f"{self.run} has no channel {channel!r} to compare; it has {both}")
        return float(np.sqrt(np.mean((self.measured[channel] - self.signals[channel]) ** 2)))

    def plot(self, channels: Sequence[str] | None = None, axes: Any = None) -> Any:
        """Draws simulated and measured channels over time; returns matplotlib axes (channels,).

        channels: names, default the recorded ones. axes: as many to draw on; default a new figure.

        >>> len(rs.simulate(result.models["roll-yaw"], runs["run4"]).plot(["r", "ay"]))
        2
        """
        from rover_sweep.drawing.drawn import draw_simulation

        return draw_simulation(
            f"{self.run} by the {self.model} model", self.t, self.signals, self.measured, channels, axes
        )

    def to_frame(self) -> Any:
        """A pandas.DataFrame with the time t [s] as index; UsageError without pandas.

        Columns: each channel as simulated ("r") and, where recorded, as measured ("r_measured"), SI units.

        >>> list(rs.simulate(result.models["roll-yaw"], runs["run4"]).to_frame())[:5]
        ['r', 'ay', 'vydot', 'p', 'r_measured']
        """
        measured = {f"{name}_measured": x for name, x in self.measured.items()}
        return data_frame({**self.signals, **measured}, self.t, "t")

    def table(self) -> ShortTable:
        """RMS of each recorded channel and of the model's error."""
        rows = [
            (
                c,
                UNITS[c],
                plain_number(float(np.sqrt(np.mean(self.measured[c] ** 2))), 3),
                plain_number(self.error(c), 3),
            )
            for c in self.signals
            if c in self.measured
        ]
        title = f"{self.run} by the {self.model} model, {self.t[-1] - self.t[0]:.1f} s"
        return ShortTable(title, ("channel", "unit", "rms", "rms of the error"), tuple(rows))


def simulate(model: AugmentedModel | Diagnosis | ModelResult, run: Recording) -> Simulation:
    """The model driven by the run's steering and measured speed, sensors and their low-passes included.

    model: a diagnosis, its `.model`, or a model of an identification (linear, at the run's mean speed and
    from rest, so without the r and a_y of a trim error). run: a recording with `delta` [rad], as from `read`
    with a vehicle; with PWM only, the steering data of the diagnosis are used. UsageError for a diagnosis
    without a model, DataRefused for a run without steering or speed.

    An identified model on a run that was not fitted:

    >>> again = rs.simulate(result.models["roll-yaw"], runs["run4"])
    >>> sorted(again.signals), again.t.shape == again.signals["r"].shape
    (['ay', 'p', 'r', 'vydot'], True)
    >>> round(again.error("r"), 2)  # rms of measured minus simulated yaw rate [rad/s]
    0.02

    A diagnosed model includes the effects that were found, here the play of the linkage:

    >>> with_play = rs.simulate(found, worn["run4"])
    >>> with_play.model
    'roll-yaw with steering_backlash'
    >>> with_play.error("r") < 0.02
    True
    """
    found = model_of(model) if isinstance(model, Diagnosis) else model
    if not isinstance(found, AugmentedModel | ModelResult):
        kind = type(model).__name__
        raise UsageError(f"the first argument ({kind}) is not a model; give a diagnosis or its model")
    if not isinstance(run, Recording):
        kind = type(run).__name__
        raise UsageError(f"the second argument ({kind}) is not a recorded run; give one of rs.read(...)")
    from rover_sweep.diagnosis.problem.residuals import centred
    from rover_sweep.diagnosis.simulation.experiment import RATE
    from rover_sweep.diagnosis.simulation.experiment import experiment as resampled
    from rover_sweep.diagnosis.simulation.simulator import Sensors, motion, sensed
    from rover_sweep.identification.verify import simulated_outputs

    steering = found.steering if isinstance(found, AugmentedModel) else None
    if "delta" not in run and "pwm" in run and steering:
        run = steered(run, *steering)
    for channel, what in (("delta", "steering angle"), ("speed", "speed")):
        if channel not in run:
            raise DataRefused(
                f"{run.name} has no {what} to drive a model with; read it with its vehicle file"
            )
    experiment = resampled(run)
    if isinstance(found, AugmentedModel):
        name, structure = found.name, found.simulated
        moved = motion(experiment, structure, found.x)
        shown = sensed(experiment, structure, found.x, moved)
        signals = Sensors.of(experiment).through(shown, moved["V"], structure, found.x)
    else:
        name, own = found.fit.structure.name, found.fit.structure
        signals = simulated_outputs(own, experiment.mean_speed, experiment.steer, RATE, run.filters)
    return Simulation(run.name, name, experiment.begin + experiment.t, signals, centred(experiment))


def model_of(found: Diagnosis) -> AugmentedModel:
    """The augmented model of a diagnosis; UsageError when it has none."""
    if found.model is None:
        why = found.sentence if found.verdict == "refused" else "it is from a version that did not save one"
        raise UsageError(f"this diagnosis holds no model: {why}; diagnose again")
    return found.model


def diagnosis_file(place: Path) -> Path | None:
    """The diagnosis file given by a file or a folder (itself or its report/); None for anything else."""
    path = result_file(place, "diagnosis.json")
    if path != place or path is None:
        return path
    try:
        return path if is_diagnosis(result_document(path)) else None
    except UsageError:
        return None


def read_augmented_model(path: Path) -> tuple[AugmentedModel, str]:
    """(model, verdict) of a diagnosis.json or a saved diagnosis; UsageError if it has no model."""
    from rover_sweep.api.diagnose import load_diagnosis

    found = load_diagnosis(path)
    return model_of(found), found.verdict


def exported(path: Path, name: str | None, speed: float | None) -> dict[str, Any]:
    """The linear part as plain data; see `exported_augmented`."""
    from rover_sweep.report.export.exported_model import exported_augmented

    model, verdict = read_augmented_model(path)
    if name not in (None, model.name):
        raise UsageError(f"{path} has only the model {model.name!r}; remove --model {name}")
    return exported_augmented(model, verdict, speed)
