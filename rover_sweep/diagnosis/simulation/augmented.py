"""The baseline with the effects that were found: all numbers that its simulation needs.

The modules that simulate, linearise or export it are imported where they are used, to keep imports fast.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rover_sweep.data.geometry import GRAVITY, Geometry
from rover_sweep.data.recording import AT_LOOP, LowPass, Recording, steering_origin

if TYPE_CHECKING:
    from rover_sweep.diagnosis.effects import Effect
    from rover_sweep.diagnosis.simulation.candidates import Model
    from rover_sweep.diagnosis.simulation.table_law import TableLaw

DERIVATIVES = tuple(f"{row}_{c}" for row in "YLN" for c in ("v", "p", "r", "phi", "delta"))


@dataclass(frozen=True, eq=False)
class AugmentedModel:
    """A baseline, the effects added to it, and the coordinates of both, fitted together.

    baseline: "kinematic", "bicycle", "roll-yaw" or "lumped". rover: the known numbers, SI units, ISO axes.
    effects: names of laws. x: {coordinate: value}, named as in `nominal`. speed: mean of the fitted
    runs [m/s].
    filters: known low-passes of the channels. steering: (trim_us, rad_per_us) of the vehicle file. wait:
    part of the delay in which a command waits for the autopilot's main loop [s]. happened_in: name of the
    run with a change of ground. steering_origin: of the runs ("commanded", "measured", "unknown" or "mixed"),
    "" in a file of an older version. happened_at: instant of the change [s] from the start of that manoeuvre.
    happened_order: place of that run in the order of driving.
    """

    baseline: str
    rover: Geometry
    effects: tuple[str, ...]
    x: Mapping[str, float]
    speed: float
    filters: Mapping[str, LowPass] = field(default_factory=dict)
    steering: tuple[float, float] | None = None
    wait: float = 0.0
    happened_in: str = ""
    happened_at: float | None = None
    laws: tuple[TableLaw, ...] = ()
    """Laws without a name, fitted together with the coordinates."""
    happened_order: int = 0
    steering_origin: str = ""

    @property
    def name(self) -> str:
        """The baseline and its effects, such as "roll-yaw with tyre_relaxation"."""
        places = dict.fromkeys(law.place for law in self.laws)
        parts = (*self.effects, *(f"laws at the {place}" for place in places))
        return " with ".join((self.baseline, " and ".join(parts))) if parts else self.baseline

    @property
    def lumped(self) -> bool:
        """True if derivatives replace tyres and springs."""
        return self.baseline == "lumped"

    @property
    def simulated(self) -> Model:
        """The model for the simulation."""
        from rover_sweep.data.geometry import Tolerances
        from rover_sweep.diagnosis.simulation.candidates import Model
        from rover_sweep.diagnosis.simulation.table_law import with_laws

        own = self.baseline, self.rover, Tolerances(), self.effects, self.happened_in
        return with_laws(Model(*own, happened_order=self.happened_order), self.laws)

    @property
    def added(self) -> tuple[Effect, ...]:
        """The laws of its effects."""
        from rover_sweep.diagnosis.effects import form_named

        return tuple(form_named(effect) for effect in self.effects)

    @property
    def numbers(self) -> dict[str, float]:
        """{name: physical number}, SI units.

        The fields of `single_track.VehicleNumbers` (0 for absent effects), imu_x, imu_z, and L_eff without
        tyres.
        For a lumped model: the derivatives "Y_v" to "N_delta" (those by v and r times the speed), m, g,
        imu_x, imu_z.
        """
        from math import exp

        if self.lumped:
            own = {name: self.x[name] for name in DERIVATIVES if name in self.x}
            place = {name: self.value(name) for name in ("imu_x", "imu_z")}
            return own | {"m": self.rover.mass, "g": GRAVITY} | place

        from rover_sweep.diagnosis.simulation.simulator import vehicle_numbers

        numbers = vehicle_numbers(self.simulated, self.x)._asdict()
        found = {name: float(value) for name, value in numbers.items()}
        found["imu_x"] = self.rover.imu_x + self.x.get("imu_x", 0.0)
        found["imu_z"] = self.rover.imu_z + self.x.get("imu_z", 0.0)
        if not self.simulated.slip:
            found["L_eff"] = exp(self.x["ln_L_eff"]) if "ln_L_eff" in self.x else self.rover.wheelbase
        return found

    def value(self, coordinate: str) -> float:
        """A coordinate by name, 0 if the model does not have it."""
        return float(self.x.get(coordinate, 0.0))

    def reported(self, effect: Effect) -> dict[str, tuple[float, str, str]]:
        """The parameters of one of its effects for a user, {parameter: (value, unit, convention)}."""
        found = effect.reported(self.x)
        if effect.in_one_run and "t" in found and self.happened_at is not None:
            found["t"] = (self.happened_at, *found["t"][1:])
        return found


def augmented(
    model: Model, x: Mapping[str, float], runs: Sequence[Recording], begins: Sequence[float]
) -> AugmentedModel:
    """The model fitted to runs. begins: start of each run's grid on the clock of its recording [s]."""
    at = None
    for run, begin in zip(runs, begins, strict=True):
        if run.name == model.happened_in and "surface_change.t" in x:
            at = x["surface_change.t"] + begin - run.span[0]
    lengths = [run.span[1] - run.span[0] for run in runs]
    speed = sum(run.mean_speed * s for run, s in zip(runs, lengths, strict=True)) / sum(lengths)
    return AugmentedModel(
        model.baseline,
        model.rover,
        model.effects,
        dict(x),
        speed,
        dict(runs[0].filters),
        wait=_wait(runs[0]),
        happened_in=model.happened_in,
        happened_at=at,
        happened_order=model.happened_order,
        steering_origin=steering_origin(run["delta"].origin for run in runs),
    )


def _wait(run: Recording) -> float:
    """Half a main loop [s] if commands have the time at which they were set, else 0.

    The gyro is logged once per loop, so its rate is that of the loop, 20 to 400 Hz in ArduRover.
    """
    steering = run["delta"]
    waited = steering.hold and steering.origin != "measured" and not steering.source.endswith(AT_LOOP)
    known = waited and 20.0 <= run["r"].rate <= 400.0
    return 0.5 / run["r"].rate if known else 0.0
