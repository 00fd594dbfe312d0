"""The nominal model with the effects that were found: all numbers that it takes to simulate it.

Light on purpose: what simulates, linearises or translates it is imported where that is done.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rover_sweep.data.geometry import GRAVITY, Geometry
from rover_sweep.data.recording import AT_LOOP, LowPass, Recording

if TYPE_CHECKING:
    from rover_sweep.diagnosis.effects import Effect
    from rover_sweep.diagnosis.simulation.candidates import Model
    from rover_sweep.diagnosis.simulation.simulator import Structure

DERIVATIVES = tuple(f"{row}_{c}" for row in "YLN" for c in ("v", "p", "r", "phi", "delta"))
SLOWEST_LOOP, FASTEST_LOOP = 20.0, 400.0  # Hz, of ArduRover's main loop


@dataclass(frozen=True, eq=False)
class AugmentedModel:
    """A baseline, the effects added to it, and the coordinates that were fitted to both together.

    baseline: "kinematic", "bicycle", "roll-yaw" or "lumped". rover: what was known beforehand, SI units,
    ISO axes. effects: ids. x: {coordinate: value} named as in `nominal`. speed: mean
    of the runs it was fitted to, m/s. filters: known low-passes of the channels. steering: (trim_us,
    rad_per_us) of the vehicle file. wait: share of the delay in which a command waits for the autopilot's
    main loop, s. happened_in: run of a change of ground; happened_at: its instant, s from the start of that
    run's manoeuvre.
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

    @property
    def name(self) -> str:
        """The baseline and what was added, as "roll-yaw with tyre_relaxation"."""
        return " with ".join((self.baseline, " and ".join(self.effects))) if self.effects else self.baseline

    @property
    def lumped(self) -> bool:
        """True where derivatives stand in place of tyres and springs."""
        return self.baseline == "lumped"

    @property
    def structure(self) -> Structure:
        """What the simulation takes."""
        from rover_sweep.data.tolerances import Tolerances
        from rover_sweep.diagnosis.simulation.candidates import Model

        model = Model(self.baseline, self.rover, Tolerances(), self.effects, self.happened_in)
        return model.structure

    @property
    def added(self) -> tuple[Effect, ...]:
        """The effects themselves."""
        from rover_sweep.diagnosis.effects import library

        return tuple(library()[effect] for effect in self.effects)

    @property
    def numbers(self) -> dict[str, float]:
        """Physical numbers, SI units: m, ms, h, Ixx, Izz, Ixz, a, b, Cf, Cr, k_phi, b_phi, g, and of effects
        inv_mu, sigma, k_load, e_roll, T_roll (0 where absent); imu_x, imu_z; L_eff without tyres. Of a lumped
        model the derivatives "Y_v" .. "N_delta", those by v and r times the speed, m, g, imu_x, imu_z."""
        from math import exp

        if self.lumped:
            own = {name: self.x[name] for name in DERIVATIVES if name in self.x}
            place = {name: self.value(name) for name in ("imu_x", "imu_z")}
            return own | {"m": self.rover.mass, "g": GRAVITY} | place

        from rover_sweep.diagnosis.simulation.simulator import vehicle_numbers

        numbers = vehicle_numbers(self.structure, self.x)._asdict()
        found = {name: float(value) for name, value in numbers.items()}
        found["imu_x"] = self.rover.imu_x + self.x.get("imu_x", 0.0)
        found["imu_z"] = self.rover.imu_z + self.x.get("imu_z", 0.0)
        if not self.structure.slip:
            found["L_eff"] = exp(self.x["ln_L_eff"]) if "ln_L_eff" in self.x else self.rover.wheelbase
        return found

    def value(self, coordinate: str) -> float:
        """A coordinate, 0 where the model has none of that name."""
        return float(self.x.get(coordinate, 0.0))

    def reported(self, effect: Effect) -> dict[str, tuple[float, str, str]]:
        """What a user reads of one of its effects, {parameter: (value, unit, convention)}."""
        found = effect.reported(self.x)
        if effect.in_one_run and self.happened_at is not None:
            found["t"] = (self.happened_at, *found["t"][1:])
        return found


def augmented(
    model: Model, x: Mapping[str, float], runs: Sequence[Recording], begins: Sequence[float]
) -> AugmentedModel:
    """The model that was fitted to runs. begins: of each run's grid, on the recording's clock [s]."""
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
    )


def _wait(run: Recording) -> float:
    """Half a main loop [s], where the command stands where it was set: the gyro is logged every loop."""
    steering = run["delta"]
    waited = steering.hold and not steering.source.endswith(AT_LOOP)
    told = waited and SLOWEST_LOOP <= run["r"].rate <= FASTEST_LOOP
    return 0.5 / run["r"].rate if told else 0.0
