"""One recorded manoeuvre: signals in SI units and ISO axes on one clock.

Axes are ISO 8855 (x forward, y left, z up): a left turn has positive r, a_y and steering angle;
an outward roll in a left turn is positive phi. `rover_sweep.logs` converts ArduPilot's FRD axes.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.results import ShortTable, Shown, plain_number
from rover_sweep.errors import UsageError, missing_extra

# Methods of results whose code lies in a room above: imported when called, so that no circle arises.
#
# Data, spectra and models must load without matplotlib and pandas, yet `.plot()` belongs to them.


def drawing(name: str) -> Callable[..., Any]:
    """The function of `rover_sweep.drawing.drawn` with that name."""
    found: Callable[..., Any] = getattr(import_module("rover_sweep.drawing.drawn"), name)
    return found


def data_frame(columns: Any, index: Any = None, index_name: str | None = None) -> Any:
    """A pandas.DataFrame of {column: values}; UsageError without pandas.

    index: values, or None to count the rows; index_name: its name.
    """
    frame = _pandas().DataFrame(columns, index=index)
    if index_name is not None:
        frame.index.name = index_name
    return frame


def keyed_frame(columns: Mapping[str, Any], keys: Mapping[str, Any]) -> Any:
    """A pandas.DataFrame of {column: values} with the index {name: values} of several levels."""
    return data_frame({**keys, **columns}).set_index(list(keys))


def joined_frames(frames: Mapping[str, Any], name: str) -> Any:
    """Joins pandas.DataFrames; their keys become the outer index of this name."""
    found = _pandas().concat(frames)
    found.index.names = [name, *found.index.names[1:]]
    return found


def _pandas() -> Any:
    try:
        return import_module("pandas")
    except ImportError:
        raise missing_extra("to_frame() needs pandas", "pandas") from None


Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Mask = NDArray[np.bool_]
MOTIONS = ("r", "ay", "p", "vy")  # of a run, as it was measured
OUTPUTS = ("r", "ay", "vydot", "p")  # responses of the models
ASSUMED = "factory value, assumed"  # source of a low-pass that was neither recorded nor given
AT_LOOP = "at the main loop"  # end of the source of commands time-stamped at the main loop that applied them
Kind = Literal["sweep", "bias_sweep", "doublet", "multisine", "throttle", "other"]
Origin = Literal["commanded", "measured", "unknown"]  # of a recorded steering
STEERING_CHANNELS = ("pwm", "delta", "servo")  # those with an origin


@dataclass(frozen=True, eq=False, repr=False)
class Signal:
    """A measured signal on its own time stamps.

    t: (n,) s on the recording's clock, strictly increasing. x: (n,) in `unit`.
    hold: True for a staircase (a PWM keeps x[k] from t[k] to t[k+1]), False for samples of a continuous
    signal. source: message and field, such as "IMU.GyrZ". origin: of a steering, whether it was commanded,
    so that the servo is behind it, or measured behind the servo; of other signals it has no meaning.
    """

    t: Array
    x: Array
    unit: str
    source: str = ""
    hold: bool = False
    origin: Origin = "unknown"

    def __post_init__(self) -> None:
        if self.t.shape != self.x.shape or self.t.ndim != 1:
            raise ValueError(
                f"Signal {self.source}: t {self.t.shape} and x {self.x.shape} must be equal, 1-d"
            )
        if self.t.size > 1 and not np.all(np.diff(self.t) > 0):
            raise ValueError(f"Signal {self.source}: time stamps must increase strictly")
        if self.origin not in get_args(Origin):
            words = "it must be commanded, measured or unknown"
            raise ValueError(f"Signal {self.source}: the origin is {self.origin!r}; {words}")

    def __repr__(self) -> str:
        span = f", {self.t[0]:.2f} to {self.t[-1]:.2f} s" if self.t.size else ""
        return f"Signal in {self.unit} from {self.source or '-'}: t and x of {self.t.size} samples{span}"

    @property
    def rate(self) -> float:
        """Median sampling rate, Hz (0 with fewer than two samples)."""
        return float(1.0 / np.median(np.diff(self.t))) if self.t.size > 1 else 0.0

    def between(self, start: float, end: float) -> Signal:
        """The samples with start <= t <= end; a staircase starts with its value at `start`."""
        lo, hi = np.searchsorted(self.t, start, "left"), np.searchsorted(self.t, end, "right")
        t, x = self.t[lo:hi], self.x[lo:hi]
        if self.hold and lo > 0 and (t.size == 0 or t[0] > start):
            t, x = np.concatenate(([start], t)), np.concatenate((self.x[lo - 1 : lo], x))
        return replace(self, t=t, x=x)

    def on(self, grid: Array) -> Array:
        """Values (n,) at the times of an even `grid` (n,) [s].

        Samples are interpolated linearly. A staircase is averaged over the grid cell around each time, which
        keeps its integral.
        """
        if not self.hold:
            return np.interp(grid, self.t, self.x)
        step = grid[1] - grid[0] if grid.size > 1 else 1e-3
        edges = np.concatenate((grid - step / 2, [grid[-1] + step / 2]))
        area = np.concatenate(([0.0], np.cumsum(self.x[:-1] * np.diff(self.t))))
        k = np.clip(np.searchsorted(self.t, edges, "right") - 1, 0, self.t.size - 1)
        return np.diff(area[k] + self.x[k] * (edges - self.t[k])) / step


@dataclass(frozen=True)
class LowPass:
    """A known second-order Butterworth low-pass of a sensor, as ArduPilot's LowPassFilter2p."""

    cutoff_hz: float
    source: str = ""

    def response(self, w: Array) -> NDArray[np.complex128]:
        """Frequency response (n,) at w (n,) [rad/s]: 1 / (1 + sqrt(2) s/w0 + (s/w0)^2)."""
        s = 1j * w / (2 * np.pi * self.cutoff_hz)
        return 1.0 / (1.0 + np.sqrt(2.0) * s + s * s)


@dataclass(frozen=True)
class Note:
    """A sentence for the user about a recording or design. level: 'info' or 'warning'.

    fault: short name of a fault that makes results from the channels in `spoils` wrong; '' for none.
    """

    level: Literal["info", "warning"]
    text: str
    fault: str = ""
    spoils: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Recording(Shown):
    """One run: channels on one clock, the time of the manoeuvre, and known data of the sensors.

    channels, as far as recorded:
      pwm    steering output [us], a staircase (hold=True)
      delta  road-wheel angle [rad], left positive; from pwm by `steered`, or as recorded (CSV)
      r, p   yaw and roll rate [rad/s]; phi roll angle [rad]; psi heading [rad], unwrapped, left positive
      ay     lateral specific force at the IMU [m/s^2], not transferred to the CG, gravity included
      vy     lateral velocity at the IMU [m/s]; speed: forward velocity [m/s]
      throttle  throttle output [us], a staircase
      servo  measured position of the steering servo, in us of its output (CSRV)
    span: (start, end) s of the manoeuvre, from before fade-in to after fade-out; spectra use it.
    standstill, straight: intervals (start, end) s for biases and the noise floor.
    filters: known sensor low-pass per channel name (r, p: INS_GYRO_FILTER; ay: INS_ACCEL_FILTER).
    sources: (path name, sha256) of its files. vehicle: {key: value} of the log that identify the vehicle.
    limits: {parameter: value} that bound the steering, as logged: SERVOn_MIN, _MAX, _TRIM, SWP_PWM_MAX [us],
    SWP_R_MAX, SWP_P_MAX [deg/s].

    >>> runs["run1"]["r"].unit, round(runs["run1"].mean_speed, 2)
    ('rad/s', 2.48)
    """

    name: str
    channels: Mapping[str, Signal]
    span: tuple[float, float]
    kind: Kind = "other"
    standstill: tuple[tuple[float, float], ...] = ()
    straight: tuple[tuple[float, float], ...] = ()
    filters: Mapping[str, LowPass] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    firmware: str = ""
    sources: tuple[tuple[str, str], ...] = ()
    vehicle: Mapping[str, str] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)

    def __getitem__(self, channel: str) -> Signal:
        return self.channels[channel]

    def __contains__(self, channel: str) -> bool:
        return channel in self.channels

    def without(self, names: Collection[str]) -> Recording:
        """The recording without some of its channels."""
        return replace(self, channels={n: s for n, s in self.channels.items() if n not in names})

    def manoeuvre(self, channel: str) -> Signal:
        """The channel within `span`."""
        return self.channels[channel].between(*self.span)

    def uniform(self, rate: float) -> tuple[Array, dict[str, Array]]:
        """All channels over `span` at `rate` [Hz]: (t (n,) [s], {name: (n,)})."""
        start, end = self.span
        t = start + np.arange(int((end - start) * rate) + 1) / rate
        return t, {name: signal.on(t) for name, signal in self.channels.items()}

    def plot(self, channels: Sequence[str] | None = None, axes: Any = None) -> Any:
        """Draws channels over time and returns their matplotlib axes (n,).

        channels: names; default steering, r, ay, p and speed. axes: as many to draw on (one, or a sequence);
        default a new figure. UsageError for an unknown channel or another number of axes.

        >>> [axes.get_ylabel() for axes in runs["run1"].plot(["r", "speed"])]
        ['yaw rate r, deg/s', 'speed V, m/s']
        """
        return drawing("draw_run")(self, channels, axes)

    def to_frame(self, rate: float | None = None) -> Any:
        """The manoeuvre as a pandas.DataFrame: each channel in SI units, with the time t [s] as index.

        rate [Hz]: of the common grid; default that of the yaw rate, or else of the fastest channel. Samples
        are interpolated, a PWM is averaged over each cell. UsageError without pandas or for a rate of 0 or
        less.

        >>> frame = runs["run1"].to_frame(rate=50)
        >>> frame.index.name, list(frame.columns)[:3], frame.shape[0]
        ('t', ['pwm', 'r', 'p'], 3050)
        """
        if rate is not None and not rate > 0:
            raise UsageError(f"the rate is {rate}; give a number of samples per second above 0")
        rates = {name: signal.rate for name, signal in self.channels.items()}
        t, columns = self.uniform(rate or rates.get("r") or max(rates.values()))
        return data_frame(columns, t, "t")

    def table(self) -> ShortTable:
        """Unit, rate and source of each channel; the warnings."""
        rows = tuple((n, s.unit, plain_number(s.rate, 3), s.source) for n, s in self.channels.items())
        speed = f", mean speed {self.mean_speed:.2f} m/s" if "speed" in self else ""
        title = f"{self.name}: {self.kind} of {self.span[1] - self.span[0]:.1f} s{speed}"
        warnings = tuple(n.text for n in self.notes if n.level == "warning")
        return ShortTable(title, ("channel", "unit", "Hz", "source"), rows, warnings)

    @property
    def mean_speed(self) -> float:
        """Mean forward speed over the manoeuvre, m/s."""
        samples = self.manoeuvre("speed").x
        if samples.size == 0:
            raise ValueError(
                f"{self.name}: no speed was recorded between {self.span[0]:g} and {self.span[1]:g} s"
            )
        return float(np.mean(samples))

    def bias(self, channel: str) -> float | None:
        """Mean of a channel at standstill, None without a recorded standstill."""
        parts = [self.channels[channel].between(a, b).x for a, b in self.standstill]
        samples = np.concatenate(parts) if parts else np.empty(0)
        return float(np.mean(samples)) if samples.size else None


def grouped_warnings(runs: Iterable[Recording]) -> tuple[str, ...]:
    """The warnings on recordings, each once: "run1 and 2 more: what is wrong"."""
    names: dict[str, list[str]] = {}
    for run in runs:
        for note in (n for n in run.notes if n.level == "warning"):
            names.setdefault(note.text, []).append(run.name)
    return tuple(
        f"{of[0]}{f' and {len(of) - 1} more' if len(of) > 1 else ''}: {text}" for text, of in names.items()
    )


def steering_origin(origins: Iterable[str]) -> str:
    """The origin of the steering of several runs: an `Origin`, "mixed", or "" without any."""
    different = set(origins)
    return different.pop() if len(different) == 1 else "mixed" if different else ""


def steering_of(runs: Iterable[Recording]) -> dict[str, Signal]:
    """{name of the run: its road-wheel angle, else its steering output}, without runs that have neither."""
    return {run.name: run[c] for run in runs for c in ("pwm", "delta") if c in run}


def origin_remark(steering: Mapping[str, Signal]) -> str:
    """A sentence on a steering that was measured, of unknown origin, or both kinds; "" for a command.

    steering: {name of a run or log: its steering}.
    """
    of = {
        origin: ", ".join(f"{n} ({s.source or '-'})" for n, s in steering.items() if s.origin == origin)
        for origin in dict.fromkeys(s.origin for s in steering.values())
    }
    match steering_origin(of):
        case "measured":
            return f"the steering was measured in {of['measured']}, so the model excludes the servo"
        case "unknown":
            return (
                f"whether the steering was commanded or measured is unknown in {of['unknown']}: if measured, "
                'the model excludes the servo; say it in the column map with origin = "commanded" or '
                '"measured" (in Python: in the Signal)'
            )
        case "mixed":
            words = "; ".join(f"{origin} in {names}" for origin, names in of.items())
            return f"the steering has different origins, so the model includes the servo in part: {words}"
    return ""


def steered(recording: Recording, trim_us: float, rad_per_us: float, source: str = "pwm") -> Recording:
    """The recording with `delta` [rad, left positive] computed from `pwm`, or from `servo`.

    In ArduPilot a larger PWM normally turns right, so delta = -(pwm - trim_us) * rad_per_us with a positive
    rad_per_us [rad/us]; it is negative for a linkage that turns left on a larger PWM.
    """
    pwm = recording[source]
    delta = replace(pwm, x=-(pwm.x - trim_us) * rad_per_us, unit="rad")
    return replace(recording, channels={**recording.channels, "delta": delta})


def stretches(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """(first, last) indices of each stretch of True in a mask (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2)]


# Unique names of runs whose files have equal names, as in two sessions.


def source_names(sources: Sequence[str]) -> Mapping[str, str]:
    """{source: name}: the stem of its file, with folder or suffix where stems are equal."""
    files = {source: _file(source) for source in sources}
    same_stem: dict[str, list[str]] = {}
    for source, path in files.items():
        same_stem.setdefault(path.stem, []).append(source)
    return {s: _name(files[s], [files[o] for o in group]) for group in same_stem.values() for s in group}


def _file(source: str) -> Path:
    """The file that names the runs of a source; the .BIN of a pair."""
    parts = [source] if Path(source).is_file() else source.split("+")
    named = next((part for part in parts if part.lower().endswith(".bin")), parts[0])
    return Path(named).expanduser().resolve()


def _name(path: Path, same_stem: Sequence[Path]) -> str:
    """The shortest name that differs from those of the other files; sources of one file share it."""
    names: list[Callable[[Path], str]] = [
        lambda p: p.stem,
        lambda p: f"{p.parent.name}/{p.stem}",
        lambda p: p.name,
    ]
    names += [lambda p, n=n: "/".join(p.parts[-n:]) for n in range(2, len(path.parts) + 1)]  # type: ignore[misc]
    others = set(same_stem) - {path}
    return next((n(path) for n in names if n(path) not in {n(other) for other in others}), str(path))


def named(run: Recording, source: str, name: str) -> Recording:
    """A run renamed after its source. name: from `source_names`."""
    stem = _file(source).stem
    return run if name == stem else replace(run, name=name + run.name.removeprefix(stem))


# One recorded throttle sweep: throttle output and speed on one clock.


@dataclass(frozen=True, eq=False)
class ThrottleRun:
    """A throttle sweep and the coasting after it.

    pwm: throttle output [us], a staircase; speed: along the heading [m/s], of the EKF. span: (start, end) s
    of the applet's override. swept: frequencies (lowest, highest) [rad/s] of the sweep. parameters: of the
    autopilot, by name. stopped: why the applet ended it early, "" if not. sources: (path name, sha256).
    """

    name: str
    pwm: Signal
    speed: Signal
    span: tuple[float, float]
    swept: tuple[float, float]
    parameters: Mapping[str, float] = field(default_factory=dict)
    stopped: str = ""
    firmware: str = ""
    sources: tuple[tuple[str, str], ...] = ()

    @property
    def neutral_us(self) -> float:
        """PWM of the standing motor."""
        return self._output("TRIM", 1500.0)

    @property
    def travel_us(self) -> float:
        """PWM from neutral to full throttle, negative for a reversed output."""
        forward = not self._output("REVERSED", 0.0)
        return (self._output("MAX", 1900.0) if forward else self._output("MIN", 1100.0)) - self.neutral_us

    def drive(self, t: Array) -> Array:
        """Throttle (n,) as a share of full, averaged over the cells around an even grid t (n,) [s]."""
        return (self.pwm.on(t) - self.neutral_us) / self.travel_us

    def _output(self, key: str, usual: float) -> float:
        outputs = (n for n in range(1, 17) if self.parameters.get(f"SERVO{n}_FUNCTION") == THROTTLE_FUNCTION)
        return self.parameters.get(f"SERVO{next(outputs, 3)}_{key}", usual)


THROTTLE_FUNCTION = 70  # SERVOn_FUNCTION of the motor
