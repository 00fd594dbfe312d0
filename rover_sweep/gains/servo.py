"""The servo in the loop of a model whose steering was measured: its lag and delay, in series with the model.

A model of a commanded steering includes its servo. One of a measured steering, as by an encoder or a servo's
telemetry, begins behind the servo; gains computed from it alone would be too high.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from rover_sweep.data.recording import steering_origin
from rover_sweep.data.results import NORMAL_90
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.identification.models import LAG, with_steering_lag
from rover_sweep.identification.state_space import ModelStructure

GUESSED_SERVO = 0.3  # relative half-width of a 90 % interval, of a number without a standard deviation
INSTANT = 0.001  # s; a shorter lag is added to the delay
WHERE = "[steering] servo_lag of the vehicle file"
Ends = tuple[float, float]


@dataclass(frozen=True)
class Servo:
    """First-order lag and delay [s] of a steering servo with their 90 % intervals [s].

    limited: whether a rate limit is known too, which no linear loop includes.
    """

    lag: float
    lag_ends: Ends
    delay: float
    delay_ends: Ends
    limited: bool = False

    @property
    def words(self) -> str:
        """Both numbers with their intervals, in ms."""
        parts = ((self.lag, self.lag_ends, "lag"), (self.delay, self.delay_ends, "delay"))
        return " and ".join(
            f"{1e3 * x:.3g} ms of {name} ({1e3 * ends[0]:.3g} to {1e3 * ends[1]:.3g} ms)"
            for x, ends, name in parts
            if x or name == "lag"
        )

    def before(
        self, structure: ModelStructure | None, intervals: Mapping[str, Ends]
    ) -> tuple[ModelStructure | None, dict[str, Ends]]:
        """The structure and its 90 % intervals with the servo before it."""
        if structure is None:
            return None, dict(intervals)
        (low, high), late = self.delay_ends, self.delay
        own: dict[str, Ends] = {}
        if self.lag_ends[1] < INSTANT:
            late, low, high = late + self.lag, low + self.lag_ends[0], high + self.lag_ends[1]
        else:
            own = {LAG.name: (max(self.lag_ends[0], 0.5 * INSTANT), self.lag_ends[1])}
            structure = with_steering_lag(structure).with_values({LAG.name: max(self.lag, 0.5 * INSTANT)})
        tau = structure.values.get("tau", 0.0)
        ends = intervals.get("tau", (tau, tau))
        if high > 0:
            own["tau"] = (ends[0] + low, ends[1] + high)
        return structure.with_values({"tau": tau + late}), own | {
            n: e for n, e in intervals.items() if n not in own
        }

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the loop includes of the servo."""
        said = (
            f"the steering was measured, so the model has no servo: the loop includes {self.words}, 90 % "
            "intervals, from [steering] of the vehicle file"
        )
        missing = "the vehicle file has no servo_delay: the loop has the servo's lag and no delay of it"
        limit = "the servo's rate limit is not included: it turns large, quick commands slower"
        return (said, *((missing,) if not self.delay_ends[1] else ()), *((limit,) if self.limited else ()))


def servo_of(vehicle: Vehicle | None, steering: Mapping[str, Any] | None) -> Servo | None:
    """The servo of a vehicle file, else of "steering" in an identification.json; None without a lag.

    Raises KeyError, TypeError or ValueError for an invalid entry.
    """
    names = ("servo_lag", "servo_delay", "servo_rate_limit")
    given = {n: (m.value, m.sd) for n in names if vehicle and (m := getattr(vehicle, n)) is not None}
    if "servo_lag" not in given:
        known = {n: steering[n] for n in names if steering and steering.get(n)}
        given = {
            n: (float(e["value"]), None if e["sd"] is None else float(e["sd"])) for n, e in known.items()
        }
    if "servo_lag" not in given:
        return None
    lag, delay = (given.get(n, (0.0, 0.0)) for n in names[:2])
    return Servo(lag[0], _ends(*lag), delay[0], _ends(*delay), "servo_rate_limit" in given)


def _ends(value: float, sd: float | None) -> Ends:
    half = GUESSED_SERVO * value if sd is None else NORMAL_90 * sd
    return max(value - half, 0.0), value + half


# Whether a model may set gains, by the origin of its runs' steering.


def origin_of(document: Mapping[str, Any]) -> str:
    """The origin of the steering in the fitted runs of an identification.json; "" of an older version."""
    fitted = {name for group in document["groups"] for name in group["runs"]}
    channels = [run["channels"].get("delta", {}) for run in document["runs"] if run["name"] in fitted]
    if not all("origin" in channel for channel in channels):
        return ""
    return steering_origin(str(channel["origin"]) for channel in channels)


def servo_doubts(origin: str, servo: Servo | None, named: Iterable[str] = ()) -> tuple[str, ...]:
    """Why a model may set no gains because of its steering's origin. named: the steering of its runs."""
    of = f" ({', '.join(dict.fromkeys(named))})" if any(named) else ""
    why = {
        "measured": f"the steering was measured{of}, so the model begins behind the servo, without its lag: "
        "identify with the recorded command (without --servo-telemetry), or give the servo's lag as "
        f"{WHERE} (--vehicle), which `rover-sweep bench` measures",
        "mixed": f"the steering was commanded in some runs and measured in others{of}, so the model includes "
        "the servo in part: identify the commanded runs alone",
        "unknown": f"it is unknown whether the steering was commanded or measured{of}, and a measured one "
        'lacks the servo: say it in the column map, as delta = {column = "steer", origin = "commanded"} or '
        '"measured" (in Python: Signal(..., origin="commanded")), and identify again; of a .BIN or .tlog, it '
        "is an older version that saved this result: identify again",
        "": "an older version of rover-sweep wrote this result, without whether the steering was commanded "
        "or measured: identify (or diagnose) again",
    }
    if origin == "commanded" or (origin == "measured" and servo is not None):
        return ()
    return (why[origin if origin in why else ""],)
