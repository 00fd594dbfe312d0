"""The loop drives, compares and corrects until it agrees or nothing helps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import pytest

from rover_sweep.comparison.answer import Agreement, Comparison, Correction, Difference
from rover_sweep.data.geometry import Geometry
from rover_sweep.data.results import ByName, Quantity
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.errors import UsageError
from rover_sweep.twin import loop
from rover_sweep.twin.loop import laws_of, together, twin_of, with_last_drive
from sitl.plant.variant import PlantParameters, load_variant

NOMINAL = load_variant("nominal")
MODEL = AugmentedModel("bicycle", Geometry(mass=2.66, a=0.203, b=0.188), (), {}, 2.0)


@dataclass
class FakeCompared:
    answer: Comparison
    used: object = None
    unused: object = None
    left: tuple = ()


@dataclass
class World:
    """The recordings' yaw inertia; a comparison says the factor to it, `gain` of the way."""

    true: float
    gain: float = 1.0
    held: float = 1.0
    drives: list[PlantParameters] = field(default_factory=list)
    laws: list[tuple[str, ...]] = field(default_factory=list)

    def drive(self, rover: PlantParameters) -> Sequence[object]:
        self.drives.append(rover)
        return [rover]

    def compare(self, simulated, laws, rover, changed):
        (rover,) = simulated
        self.laws.append(laws)
        factor = (self.true / rover.yaw_inertia) ** self.gain
        level = 1.0 + 10.0 * abs(self.true / rover.yaw_inertia - 1.0)
        found = () if abs(factor - 1.0) < 0.01 else (_izz(factor),)
        levels = (("run1", "sim1", False, level), ("run2", "sim2", True, self.held * level))
        agreement = tuple(Agreement(*one, {}) for one in levels)
        verdict = "differ" if found else "agree"
        return FakeCompared(Comparison(verdict, "", differences=found, agreement=agreement))


def _izz(factor: float) -> Difference:
    one, two = (ByName((Quantity("Izz", "", x, 0.9 * x, 1.1 * x),)) for x in (1.0, factor))
    return Difference("number", "Izz", one, two, {"Izz": factor}, True, 99.0, (), "Izz differs")


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch):
    for name in ("histories_of", "bode_of_runs"):
        monkeypatch.setattr(loop, name, lambda shown: ())
    monkeypatch.setattr(loop, "driven_again", lambda before, after, held_out: ())


def _twin(world: World, **more):
    return twin_of(NOMINAL, (), MODEL, world.drive, world.compare, **more)


def test_one_drive_where_it_agrees_and_another_with_the_correction():
    world = World(NOMINAL.yaw_inertia)
    twin, rover = _twin(world)
    assert len(world.drives) == 1 and rover == NOMINAL and twin.agrees
    assert "as it was" in twin.sentence and not twin.remarks

    world = World(0.09)
    twin, rover = _twin(world)
    assert len(world.drives) == 2 and rover.yaw_inertia == pytest.approx(0.09) and twin.agrees
    assert [c.entry for c in twin.corrections] == ["yaw_inertia"]
    assert [len(r.corrections) for r in twin.rounds] == [1, 0]
    assert "only relative to the mass" in twin.remarks[-1]


def test_goes_on_while_it_helps():
    world = World(0.14, gain=0.7)
    twin, rover = _twin(world)
    assert len(world.drives) > 2
    assert rover.yaw_inertia == pytest.approx(0.14, rel=0.05)
    assert len(twin.corrections) == 1  # of all rounds together
    assert twin.corrections[0].before == "0.071"


def test_a_correction_that_does_not_help_is_taken_back():
    world = World(0.09, gain=-1.0)
    twin, rover = _twin(world)
    assert rover == NOMINAL
    assert not twin.agrees
    assert not twin.corrections
    assert "taken back" in twin.remarks[0]


def test_a_correction_that_goes_too_far_is_halved():
    """The answer that it overshoots by is the square of the right factor: half of it is right."""
    world = World(0.16, gain=2.0)
    twin, rover = _twin(world)
    assert world.drives[1].yaw_inertia > 2.0 * 0.16
    assert rover.yaw_inertia == pytest.approx(0.16, rel=0.01)
    assert twin.agrees and [c.before for c in twin.corrections] == ["0.071"]


@pytest.mark.parametrize(("largest", "low", "high"), [(0.09, NOMINAL.yaw_inertia, 0.09), (0.0, 0.0, 0.0)])
def test_a_rover_that_overturns_with_a_correction_gets_half_of_it_or_none(largest, low, high):
    world = World(0.10)

    def drive(rover):
        if world.drives and rover.yaw_inertia > largest:
            raise UsageError("the simulated rover overturns")
        return world.drive(rover)

    twin, rover = twin_of(NOMINAL, (), MODEL, drive, world.compare)
    assert low < rover.yaw_inertia < high if largest else rover == NOMINAL
    assert "overturns" in twin.remarks[0]


def test_held_out_runs_decide_nothing_but_the_verdict():
    twin, rover = _twin(World(0.09, held=3.0))
    assert rover.yaw_inertia == pytest.approx(0.09) and not twin.agrees


def test_stops_when_asked():
    world = World(0.09)
    twin, _ = _twin(world, stop=lambda: True)
    assert len(world.drives) == 1
    assert not twin.agrees


def test_the_last_drive_decides_whether_it_agrees():
    world = World(0.09)
    twin, rover = _twin(world)
    other = World(0.12)
    after = with_last_drive(twin, rover, MODEL, other.drive, other.compare, "ardurover")
    assert twin.agrees
    assert not after.agrees
    assert after.rounds[-1].simulator == "ardurover"
    assert after.sentence.startswith("driven on ardurover")


def test_a_last_drive_that_fails_leaves_the_twin_as_it_was():
    world = World(0.09)
    twin, rover = _twin(world)

    def fails(rover):
        raise UsageError("the firmware did not arm")

    after = with_last_drive(twin, rover, MODEL, fails, world.compare, "ardurover")
    assert (after.agrees, after.rounds, after.corrections) == (twin.agrees, twin.rounds, twin.corrections)
    assert "the drive on ardurover does not count: the firmware did not arm" in after.remarks


def test_laws_of_the_variant_are_told_to_the_comparison():
    effects = {
        "tyre_saturation": {"mu": 0.6, "form": "brush"},
        "steering_backlash": {"b": 0.01},
        "speed_variation": {"D": 0.01},
        "surface_change": {"ratio": 0.7, "t": 10.0},
    }
    rover = replace(NOMINAL, effects=effects)
    assert laws_of(rover, MODEL) == ("tyre_saturation/brush", "steering_backlash")


def test_together_leaves_out_what_came_back():
    there = Correction("yaw_inertia", "1", "2", "", "there")
    back = Correction("yaw_inertia", "2", "1", "", "back")
    assert together([[there], [back]]) == ()
