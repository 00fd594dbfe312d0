"""The compiled simulation says so before the one run that compiles it."""

from pathlib import Path
from types import SimpleNamespace

from rover_sweep.diagnosis.simulation.single_track import must_compile


def _loop(index: Path) -> SimpleNamespace:
    return SimpleNamespace(_cache=SimpleNamespace(_cache_file=SimpleNamespace(_index_path=str(index))))


def test_a_loop_that_is_kept_on_disk_is_not_compiled_again(tmp_path: Path) -> None:
    index = tmp_path / "single_track.nbi"
    assert must_compile(_loop(index))
    index.write_bytes(b"kept")
    assert not must_compile(_loop(index))


def test_a_numba_that_does_not_say_is_not_a_fault() -> None:
    assert not must_compile(object())


def test_the_simulation_is_found_on_disk_once_it_ran() -> None:
    import numpy as np

    from rover_sweep.diagnosis.simulation.single_track import VehicleNumbers, single_tracks

    zero, speed = np.zeros(3), np.full(3, 2.0)
    numbers = np.array(VehicleNumbers(5, 4, 0.05, 0.1, 0.2, 0, 0.2, 0.2, 40, 40, 20, 1, 9.81))
    drive = (zero, speed, speed, zero, zero, zero, numbers)
    single_tracks(drive, drive, (False, False), True, 0.01)
    assert not must_compile()
