"""rover-sweep: finds out, in an afternoon on a car park, how a rover really steers.

From logs to models in Python:

    import rover_sweep as rs
    runs = rs.read("run1.BIN", "run2.BIN", vehicle="rover.toml")
    result = rs.identify(runs)
    result.models["roll-yaw"]
    result.report("report")

`read`, `identify`, `load_result`, `diagnose`, `load_diagnosis`, `simulate`, `to_control` and `to_scipy` are
described where they are defined, in `rover_sweep.api`, `rover_sweep.diagnosis_api`, `rover_sweep.simulation`
and `rover_sweep.conversion`; nothing heavy is imported before one of them is used.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rover_sweep.api import Result as Result
    from rover_sweep.api import Runs as Runs
    from rover_sweep.api import identify as identify
    from rover_sweep.api import load_result as load_result
    from rover_sweep.api import read as read
    from rover_sweep.conversion import to_control as to_control
    from rover_sweep.conversion import to_scipy as to_scipy
    from rover_sweep.diagnosis_api import FullDiagnosis as FullDiagnosis
    from rover_sweep.diagnosis_api import diagnose as diagnose
    from rover_sweep.diagnosis_api import load_diagnosis as load_diagnosis
    from rover_sweep.errors import DataRefused as DataRefused
    from rover_sweep.errors import RoverSweepError as RoverSweepError
    from rover_sweep.errors import UsageError as UsageError
    from rover_sweep.simulation import Simulation as Simulation
    from rover_sweep.simulation import simulate as simulate

__version__ = "0.1.0"

_HOMES = {
    "Result": "api", "Runs": "api", "load_result": "api", "read": "api",
    "to_control": "conversion", "to_scipy": "conversion",
    "FullDiagnosis": "diagnosis_api", "diagnose": "diagnosis_api", "load_diagnosis": "diagnosis_api",
    "DataRefused": "errors", "RoverSweepError": "errors", "UsageError": "errors",
    "Simulation": "simulation", "simulate": "simulation",
}  # fmt: skip
__all__ = ["__version__", "identify", *_HOMES]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _CallablePackage(ModuleType):
    """`rover_sweep.identify` is the package of the pure core, and called it identifies."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return import_module(f"{__package__}.api").identify(*args, **kwargs)


import_module(f"{__name__}.identify")
sys.modules[f"{__name__}.identify"].__class__ = _CallablePackage
