"""rover-sweep: finds out, in an afternoon on a car park, how a rover really steers.

From logs to models in Python, with a sweep, a doublet to verify on, and the vehicle file:

    >>> import rover_sweep as rs
    >>> runs = rs.read("run1.BIN", "run4.BIN", vehicle="rover.toml")
    >>> [(run.name, run.kind) for run in runs]
    [('run1', 'sweep'), ('run4', 'doublet')]
    >>> result = rs.identify(runs)
    >>> result.models["roll-yaw"].parameters["tau"].unit
    's'
    >>> axes = result.plot(["r", "ay"])
    >>> table = result.to_frame()
    >>> files = result.report("report")

Runs, responses, models, diagnoses and simulations print as tables. `.plot()` draws them with matplotlib,
`.to_frame()` gives a pandas.DataFrame (`pip install -e '.[pandas]'` in the checkout). All values are in SI
units and ISO axes (x forward, y left, z up); frequencies are in rad/s.

`read`, `identify`, `bode`, `load_result`, `identify_speed`, `identify_driving`, `diagnose`,
`load_diagnosis`, `compare`, `simulate`, `to_control`, `to_scipy` and `harmonics` are documented at their
definitions: in `rover_sweep.api`, `rover_sweep.identification.conversion` and
`rover_sweep.spectra.harmonics`. Modules are imported at first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rover_sweep._version import __version__ as __version__

if TYPE_CHECKING:
    from rover_sweep.api.diagnose import FullDiagnosis as FullDiagnosis
    from rover_sweep.api.diagnose import compare as compare
    from rover_sweep.api.diagnose import diagnose as diagnose
    from rover_sweep.api.diagnose import load_diagnosis as load_diagnosis
    from rover_sweep.api.driving import DrivingIdentification as DrivingIdentification
    from rover_sweep.api.driving import identify_driving as identify_driving
    from rover_sweep.api.identify import Result as Result
    from rover_sweep.api.identify import bode as bode
    from rover_sweep.api.identify import identify as identify
    from rover_sweep.api.identify import load_result as load_result
    from rover_sweep.api.read import Runs as Runs
    from rover_sweep.api.read import read as read
    from rover_sweep.api.simulate import Simulation as Simulation
    from rover_sweep.api.simulate import simulate as simulate
    from rover_sweep.api.speed import SpeedIdentification as SpeedIdentification
    from rover_sweep.api.speed import identify_speed as identify_speed
    from rover_sweep.errors import DataRefused as DataRefused
    from rover_sweep.errors import RoverSweepError as RoverSweepError
    from rover_sweep.errors import UsageError as UsageError
    from rover_sweep.identification.conversion import to_control as to_control
    from rover_sweep.identification.conversion import to_scipy as to_scipy
    from rover_sweep.manoeuvre.multisine import Multisine as Multisine
    from rover_sweep.spectra.harmonics import Harmonics as Harmonics
    from rover_sweep.spectra.harmonics import harmonics as harmonics

_HOMES = {
    "api.read": ("Runs", "read"),
    "api.identify": ("Result", "bode", "identify", "load_result"),
    "api.diagnose": ("FullDiagnosis", "compare", "diagnose", "load_diagnosis"),
    "api.driving": ("DrivingIdentification", "identify_driving"),
    "api.simulate": ("Simulation", "simulate"),
    "api.speed": ("SpeedIdentification", "identify_speed"),
    "identification.conversion": ("to_control", "to_scipy"),
    "manoeuvre.multisine": ("Multisine",),
    "spectra.harmonics": ("Harmonics", "harmonics"),
    "errors": ("DataRefused", "RoverSweepError", "UsageError"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}
__all__ = ["__version__", *_HOME_OF]


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*(name for name in globals() if name.startswith("__")), *__all__})
