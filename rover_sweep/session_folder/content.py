"""What session.json says, as frozen values and as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from rover_sweep.identify.multisine import Multisine
from rover_sweep.identify.sweep import BiasSweep, Doublet, Manoeuvre, Sweep

FORMAT = "rover-sweep session 2"

# begun: being driven; done: came to its end; stopped: by applet, pilot or abort; cut: link or program died.
State = Literal["begun", "done", "stopped", "cut"]
Span = tuple[float, float]
_KINDS: Mapping[str, type[Manoeuvre]] = {
    "sweep": Sweep, "bias_sweep": BiasSweep, "doublet": Doublet, "multisine": Multisine,
}  # fmt: skip


@dataclass(frozen=True)
class PlannedRun:
    """One run of a session; name is that of its .tlog. speed [m/s]: the one to hold, where that is known."""

    name: str
    manoeuvre: Manoeuvre
    speed: float | None = None


@dataclass(frozen=True)
class DrivenRun:
    """A run that was begun. name: of the plan; tlog: file name in the folder, which tells repeats apart.

    manoeuvre: None where the tlog does not tell it. reason: why it ended, in words. span: s since boot,
    from the switch to the last state. number: the applet's run counter. left_armed: by this program, as
    far as is known. quality: of the telemetry streams. verdict: on it, as in `live.snapshot.Verdict`.
    """

    name: str
    tlog: str
    manoeuvre: Manoeuvre | None
    state: State
    reason: str = ""
    span: Span | None = None
    number: int = 0
    left_armed: bool = False
    quality: tuple[Mapping[str, Any], ...] = ()
    verdict: Mapping[str, Any] | None = None

    @property
    def label(self) -> str:
        """The run's name, with a number where it was driven again."""
        return self.tlog.removesuffix(".tlog")


@dataclass(frozen=True)
class FetchedLog:
    """A log of the vehicle that is here. number, size [bytes], time_utc [s]: as the vehicle lists it.

    runs: labels of those that it holds whole.
    """

    file: str
    number: int
    size: int
    time_utc: int
    runs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Content:
    """A session. vehicle: as in `vehicle.identity.Vehicle`; settings, parameters: what was set for driving.

    logs_before: (number, size, time_utc) of what lay on the vehicle when the session began, None: unknown.
    """

    vehicle: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    plan: tuple[PlannedRun, ...] = ()
    runs: tuple[DrivenRun, ...] = ()
    logs: tuple[FetchedLog, ...] = ()
    logs_before: tuple[tuple[int, int, int], ...] | None = None

    @property
    def to_drive(self) -> tuple[PlannedRun, ...]:
        """The planned runs of which none came to its end, in the plan's order."""
        done = {(run.name, run.manoeuvre) for run in self.runs if run.state == "done"}
        return tuple(run for run in self.plan if (run.name, run.manoeuvre) not in done)

    def run(self, label: str) -> DrivenRun:
        """The run of that label. KeyError without one."""
        return {run.label: run for run in self.runs}[label]


def to_json(content: Content) -> dict[str, Any]:
    """As plain values for JSON."""
    return {"format": FORMAT, "span_unit": "s since boot"} | asdict(content)


def from_json(data: Mapping[str, Any]) -> Content:
    """The reverse of `to_json`. KeyError, TypeError or ValueError for anything else."""
    before = data["logs_before"]
    return Content(
        vehicle=dict(data["vehicle"]),
        settings=dict(data["settings"]),
        parameters=dict(data["parameters"]),
        plan=tuple(
            PlannedRun(run["name"], _manoeuvre(run["manoeuvre"]), run.get("speed")) for run in data["plan"]
        ),
        runs=tuple(_run(run) for run in data["runs"]),
        logs=tuple(FetchedLog(**{**log, "runs": tuple(log["runs"])}) for log in data["logs"]),
        logs_before=None if before is None else tuple((n, size, utc) for n, size, utc in before),
    )


def _run(data: Mapping[str, Any]) -> DrivenRun:
    span, manoeuvre = data["span"], data["manoeuvre"]
    return DrivenRun(
        **{
            **data,
            "manoeuvre": None if manoeuvre is None else _manoeuvre(manoeuvre),
            "span": None if span is None else (float(span[0]), float(span[1])),
            "quality": tuple(data["quality"]),
        }
    )


def _manoeuvre(data: Mapping[str, Any]) -> Manoeuvre:
    return _KINDS[data["kind"]](**data)
