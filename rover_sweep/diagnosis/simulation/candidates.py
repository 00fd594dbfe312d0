"""The effects that a model can lack, and the model with one effect added or removed."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from rover_sweep.data.geometry import GRAVITY, Geometry
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.diagnosis.effects import Effect, form_named, forms_of, library
from rover_sweep.diagnosis.effects.kinds import DegreeOfFreedom, SpeedEffect
from rover_sweep.diagnosis.simulation import lumped_baseline
from rover_sweep.diagnosis.simulation.experiment import Experiment
from rover_sweep.diagnosis.simulation.nominal import Coordinate, coordinates
from rover_sweep.diagnosis.simulation.structure import Structure

SAME_SPEED = 0.12  # relative
DEGREES_OF_FREEDOM = frozenset(e.id for e in library().values() if isinstance(e, DegreeOfFreedom))


@dataclass(frozen=True)
class Model:
    """A baseline with effects: the structure to simulate and the coordinates to fit.

    baseline: "kinematic", "bicycle", "roll-yaw" or "lumped". spread: normal tolerances of a rover. effects:
    names of laws. happened_in: name of the run with a surface change, happened_order: its place in
    time. two_clocks: steering and motion have two clocks. given: ids of effects that belong to the
    baseline: an inference does not ask about them.
    """

    baseline: str
    rover: Geometry
    spread: Tolerances
    effects: tuple[str, ...] = ()
    happened_in: str = ""
    two_clocks: bool = False
    happened_order: int = 0
    given: frozenset[str] = frozenset()

    @property
    def slip(self) -> bool:
        """True if the tyres slip."""
        return self.baseline != "kinematic" or "tyre_slip" in self.effects

    @property
    def roll(self) -> bool:
        """True if the body rolls."""
        if self.baseline == "lumped":
            return bool(self.rover.sprung_mass and self.rover.h and self.rover.roll_inertia)
        return self.baseline == "roll-yaw" or "roll_dof" in self.effects

    @property
    def lumped(self) -> bool:
        """True if derivatives replace tyres and springs."""
        return self.baseline == "lumped"

    @property
    def structure(self) -> Structure:
        """The structure that is simulated."""
        found = tuple(form_named(e) for e in self.effects if e not in DEGREES_OF_FREEDOM)
        # the V_y of the derivatives is the measured one, at the IMU
        rover = replace(self.rover, imu_x=0.0, imu_z=0.0) if self.lumped else self.rover
        return Structure(
            rover, self.slip, self.roll, found, self.happened_in, self.lumped, self.happened_order
        )

    @property
    def free(self) -> tuple[Coordinate, ...]:
        """The fitted coordinates: nominal ones (without prior if an effect releases them) and added ones.

        A coordinate that an effect releases to one value only is held there.
        """
        nominal = self._nominal()
        released = {k: v for e in self.effects for k, v in self._released(form_named(e)).items()}
        out = []
        for c in nominal:
            if c.name in released:
                low, high = released[c.name]
                c = replace(c, low=low, high=high, prior=None, step=c.step if high > low else 0.0)
            out.append(c)
        for name in self.effects:
            out += added_coordinates(self.law(name))
        return tuple(out)

    def _nominal(self) -> tuple[Coordinate, ...]:
        if not self.lumped:
            return coordinates(self.baseline, self.rover, self.spread, self.slip, self.roll)
        common = coordinates(self.baseline, self.rover, self.spread, False, False)
        steering = tuple(c for c in common if c.name != "scale")  # Y_delta, L_delta and N_delta include it
        return (*steering, *lumped_baseline.derivatives(self.rover, self.roll))

    def _released(self, effect: Effect) -> Mapping[str, tuple[float, float]]:
        """Bounds that an effect releases. With one clock only a response before the command is an offset."""
        if effect.id == "clock_offset" and not self.two_clocks:
            return {"delay": (effect.releases["delay"][0], self.spread.delay)}
        return effect.releases

    def law(self, name: str) -> Effect:
        """A law by its name, with the sizes that it has on this rover."""
        return form_named(name).sized(self._growth)

    def laws(self, effect: str) -> tuple[Effect, ...]:
        """All laws of the effect with this id, with the sizes that they have on this rover."""
        return tuple(law.sized(self._growth) for law in forms_of(effect))

    @property
    def _growth(self) -> Mapping[str, float]:
        """How much larger this rover is than 0.5 m and 3 N m of ms g h, for which the sizes were set."""
        moment = (self.rover.sprung_mass or 0.0) * GRAVITY * (self.rover.h or 0.0)
        return {"wheelbase": max(self.rover.wheelbase / 0.5, 1.0), "roll moment": max(moment / 3.0, 1.0)}

    def with_effect(self, effect: str, run: str = "", order: int = 0) -> Model:
        """This model with a law added, by its name; run, order: in which it happened."""
        more = replace(self, effects=(*self.effects, effect))
        return replace(more, happened_in=run, happened_order=order) if run else more

    def without(self, effect: str) -> Model:
        """This model with an effect removed, whatever its form; effect: its id."""
        return replace(self, effects=tuple(e for e in self.effects if form_named(e).id != effect))

    @property
    def laws_and_run(self) -> tuple[str, ...]:
        """The laws by their names and the run in which one begins: what tells models of a rover apart."""
        return (*self.effects, self.happened_in)

    @property
    def ids(self) -> tuple[str, ...]:
        """The ids of the effects, without their forms."""
        return tuple(form_named(e).id for e in self.effects)


def added_coordinates(effect: Effect) -> list[Coordinate]:
    """The coordinates that an effect adds, without those that it releases."""
    return [
        Coordinate(effect.key(p.name), 0.0, p.low, p.high, p.size) for p in effect.parameters if not p.nominal
    ]


def possible(
    model: Model, runs: Sequence[Experiment], only: Collection[str] = (), without: Collection[str] = ()
) -> tuple[list[Effect], dict[str, str]]:
    """(effects that these runs can show in addition, {effect: why they cannot show it}).

    Effects on the speed are left out: the measured speed drives the model, and `speed_loss` tests them.
    """
    found, unseen = [], {}
    for effect in (model.law(name) for name in library()):
        if isinstance(effect, SpeedEffect) or effect.id in model.ids or effect.id in without:
            continue
        if only and effect.id not in only:
            continue
        why = why_unseen(effect, model, runs)
        if why:
            unseen[effect.id] = why
        else:
            found.append(effect)
    return found, unseen


def why_unseen(effect: Effect, model: Model, runs: Sequence[Experiment]) -> str:
    """Why an effect cannot show in these runs with this model, "" if it can."""
    recorded = {c for run in runs for c in run.measured}
    has = "roll-yaw" if model.slip and model.roll else "bicycle" if model.slip else "kinematic"
    has = "lumped" if model.lumped else has
    if effect.id in DEGREES_OF_FREEDOM:
        if model.baseline not in effect.baselines:
            return "the lumped derivatives include it" if model.lumped else "the baseline includes it"
    elif has not in effect.baselines:
        return f"acts in {' or '.join(effect.baselines)} models, the baseline is {has}"
    if not recorded & set(effect.channels):
        return f"none of {', '.join(effect.channels)} was recorded"
    if effect.id == "imu_tilt" and model.lumped:
        return "the lumped derivatives include the mixing of p and r, and bias_ay the constant"
    if effect.id == "imu_offset" and model.lumped and "vy" not in recorded:
        return "no V_y was recorded, so the lumped derivatives include it"
    if effect.id == "cross_slope" and not any(run.has_heading for run in runs):
        return "no heading was recorded"
    if effect.id == "roll_dof" and not (
        model.rover.sprung_mass and model.rover.h and model.rover.roll_inertia
    ):
        return "the vehicle file has no sprung mass, height or roll inertia"
    return ""


def same_speed(a: Experiment, b: Experiment) -> bool:
    """True for runs whose mean speeds are within 12 %."""
    low, high = sorted((a.mean_speed, b.mean_speed))
    return high < (1 + SAME_SPEED) * low
