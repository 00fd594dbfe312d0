"""What `identify` answers to a drawn log, against the rover's true numbers, and the counts by grade."""

from __future__ import annotations

import tempfile
import time
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import degrees, inf, sqrt
from pathlib import Path
from typing import Any

import rover_sweep as rs
from tests.foreign.plant import GRAVITY
from tests.recordings.draw import NEUTRAL, TEN_MINUTES, DrawnLog, Wanted, drawn_log
from tests.recordings.faults import BY_NAME
from tests.recordings.rovers import Truth

NEAR = 0.1
SCALES = (
    "curvature",
    "wheelbase_seen",
    "full_radius",
    "least_radius",
    "rad_per_us",
    "steering_ratio",
    "response_time",
)
"""Numbers of which 10 % means something; the others may be near 0."""
Document = dict[str, Any]


def answered(log: DrawnLog) -> Document:
    """The answer as plain data: level, numbers {name: [value, low, high, unit]}, sign of the gain, the texts.

    level: "good", "rough", "none", "refused" for an error with a sentence, "crashed" for any other.
    """
    started = time.monotonic()
    try:
        found = rs.identify_driving(*log.sources, wheelbase=log.wheelbase)
    except (rs.DataRefused, rs.UsageError) as refusal:
        return {"level": "refused", "text": str(refusal), "numbers": {}, "took": time.monotonic() - started}
    except Exception:
        text = traceback.format_exc(limit=-3)
        return {"level": "crashed", "text": text, "numbers": {}, "took": time.monotonic() - started}
    numbers = {q.name: [q.value, q.low, q.high, q.unit] for q in found.numbers}
    left_out = [why for why, seconds in found.driving.left_out.items() if seconds >= 1]
    said = [*found.reasons, *found.unknown, *left_out, *found.read, *(f"number {name}" for name in numbers)]
    return {
        "level": found.level,
        "numbers": numbers,
        "gain": found.fit["gain"] if found.fit else 0.0,
        "speed": found.speeds[1],
        "used": found.driving.seconds,
        "text": "\n".join(said),
        "took": time.monotonic() - started,
    }


def drawn_and_asked(seed: int, number: int, keep: Path | None, wanted: Wanted) -> Document:
    """{log, answer} of a drawn log. keep: the folder in which its files stay; it prints how to ask them."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "log" if keep is None else keep / f"{seed}-{number}"
        log = drawn_log(seed, number, folder, wanted)
        if keep is not None:
            base = f" --wheelbase {log.wheelbase:.4f}" if log.wheelbase else ""
            print(f"{log.truth}\nrover-sweep identify {' '.join(log.sources)}{base} --out DIR", flush=True)
        return {"log": log.document(), "answer": answered(log)}


# ---- One answer.


def true_value(name: str, log: Mapping[str, Any], answer: Mapping[str, Any]) -> float | None:
    """The truth of a number as the tool defines it; None of one that is not judged."""
    truth, angle = Truth(**log["truth"]), log["steering"] == "angle"
    speed, numbers = answer["speed"], answer["numbers"]
    known = "understeer" in numbers or "understeer_gradient" in numbers
    curvature = truth.curvature if known else truth.curvature_at(speed)
    delay = 0.0 if angle else truth.delay
    lag = truth.lag_at(speed) - (truth.servo if angle else 0.0)
    side = name.removesuffix("_left").removesuffix("_right")
    found: dict[str, Callable[[], float | None]] = {
        "curvature": lambda: curvature,
        "full_radius": lambda: truth.rad_per_us / (curvature / 100 * log["per"]),
        "wheelbase_seen": lambda: truth.rad_per_us / (curvature / 100 * log["per"]),
        "straight": lambda: _straight(truth, log, numbers["straight"][0]),
        "rad_per_us": lambda: truth.rad_per_us,
        "steering_ratio": lambda: 1 / log["per"],
        "least_radius": lambda: truth.tightest,
        "delay": lambda: delay,
        "lag": lambda: lag,
        "response_time": lambda: delay + lag,
        "understeer": lambda: truth.understeer,
        "understeer_gradient": lambda: degrees(truth.understeer * truth.wheelbase) * GRAVITY,
        "characteristic_speed": lambda: 1 / sqrt(truth.understeer) if truth.understeer > 0 else inf,
        "critical_speed": lambda: 1 / sqrt(-truth.understeer) if truth.understeer < 0 else inf,
        "bend": lambda: 100 * max(truth.bend, 0.0),  # of tyres, which only lose
    }
    return found[side]() if side in found else None


def _straight(truth: Truth, log: Mapping[str, Any], found: float) -> float:
    """Of an angle, whose sign depends on the axes, in the sign that was found."""
    if log["steering"] == "us":
        return truth.straight
    if log["steering"] == "angle":
        return 0.0
    size = abs(truth.straight - NEUTRAL) * truth.rad_per_us / log["per"]
    return size if found > 0 else -size


@dataclass(frozen=True)
class Marked:
    """One log and its answer. inside: of each judged number, whether its interval holds the truth; near: of
    those in SCALES, whether it is within 10 %; direction: whether it is right, None where none is said;
    off: by how many half intervals the worst number is off, and which one."""

    log: Mapping[str, Any]
    answer: Mapping[str, Any]
    inside: Mapping[str, bool]
    near: Mapping[str, bool]
    direction: bool | None
    named: bool
    off: tuple[float, str]

    @property
    def level(self) -> str:
        return str(self.answer["level"])

    @property
    def holds(self) -> bool:
        """Whether all intervals hold the truth."""
        return all(self.inside.values())

    @property
    def wrong(self) -> bool:
        """Whether anything that it says of the rover is wrong."""
        return not (self.holds and all(self.near.values()) and self.direction is not False)


def marked(log: Mapping[str, Any], answer: Mapping[str, Any]) -> Marked:
    inside: dict[str, bool] = {}
    near: dict[str, bool] = {}
    off = (0.0, "")
    for name, (value, low, high, _) in answer["numbers"].items():
        true = true_value(name, log, answer)
        if true is None or low is None or high is None:
            continue
        inside[name] = low <= true <= high
        if any(name.startswith(scale) for scale in SCALES):
            near[name] = abs(value / true - 1) <= NEAR
        off = max(off, (abs(value - true) / max((high - low) / 2, 1e-12), name))
    direction = None
    if "curvature" in answer["numbers"]:
        direction = (answer["gain"] > 0) == (log["truth"]["direction"] > 0)
    fault = BY_NAME.get(log["fault"])
    return Marked(log, answer, inside, near, direction, bool(fault and fault.says(answer["text"])), off)


# ---- The table.

GRADES = ("good", "rough")
HEAD = f"{'':34}{'logs':>5} |" + "".join(
    f"{grade.upper():>6}{'hold':>6}{'10 %':>6}{'dir.':>6} |" for grade in GRADES
)


def table(found: Sequence[Marked]) -> str:
    """Counts by grade: all, without a fault, kinds tuned on and left out, and each kind, profile, driving,
    engine. hold: of answers of this grade, those of which all intervals hold the truth; 10 %: all scales are
    within 10 %; dir.: of those that say a direction, right ones."""
    clean = [m for m in found if not m.log["fault"]]
    tuned = [m for m in found if m.log["fault"] and not m.log["left_out"]]
    left_out = [m for m in found if m.log["left_out"]]
    lines = [f"{HEAD}{'none':>6}{'refused':>8}{'crashed':>8}{'named':>7}"]
    lines += [_row("all", found), _row("without a fault", clean)]
    lines += [_row("... ten minutes", [m for m in clean if m.log["seconds"] >= TEN_MINUTES])]
    for title, key in (("", "profile"), ("", "driving"), ("", "engine")):
        for value in dict.fromkeys(sorted(m.log[key] for m in clean)):
            lines.append(_row(f"  {title}{value}", [m for m in clean if m.log[key] == value]))
    for title, rows in (("faults tuned on", tuned), ("faults left out", left_out)):
        lines.append(_row(title, rows))
        for kind in dict.fromkeys(sorted(m.log["fault"] for m in rows)):
            lines.append(_row(f"  {kind}", [m for m in rows if m.log["fault"] == kind]))
    return "\n".join(lines)


def _row(title: str, rows: Sequence[Marked]) -> str:
    words = f"{title[:33]:34}{len(rows):5} |"
    for grade in GRADES:
        own = [m for m in rows if m.level == grade]
        says = [m.direction for m in own if m.direction is not None]
        right = f"{sum(says)}/{len(says)}" if says else "-"
        counts = (str(sum(m.holds for m in own)), str(sum(all(m.near.values()) for m in own)), right)
        words += f"{len(own):6}" + "".join(f"{count if own else '-':>6}" for count in counts) + " |"
    levels = [m.level for m in rows]
    named = sum(m.named for m in rows) if any(m.log["fault"] for m in rows) else "-"
    return words + f"{levels.count('none'):6}{levels.count('refused'):8}{levels.count('crashed'):8}{named:>7}"


def numbers_table(found: Sequence[Marked]) -> str:
    """Of each number in answers that are GOOD: how often its interval holds the truth, and 10 %."""
    good = [m for m in found if m.level == "good"]
    lines = [f"{'numbers of GOOD answers':34}{'said':>5}{'hold':>6}{'10 %':>6}"]
    for name in sorted({name for m in good for name in m.inside}):
        own = [m for m in good if name in m.inside]
        near = [m.near[name] for m in own if name in m.near]
        close = str(sum(near)) if near else "-"
        lines.append(f"  {name:32}{len(own):5}{sum(m.inside[name] for m in own):6}{close:>6}")
    return "\n".join(lines)


# ---- The figures that are asked for.


def figures(found: Sequence[Marked]) -> str:
    """Each figure of the issue on grades, PASS or FALL SHORT."""
    good, rough = ([m for m in found if m.level == grade] for grade in GRADES)
    clean = [m for m in found if not m.log["fault"] and m.log["seconds"] >= TEN_MINUTES]
    says = [m.direction for m in good if m.direction is not None]
    alarms = [m for m in found if not m.log["fault"] and _alarm(m)]
    lines = [
        _figure("GOOD: all intervals of an answer hold the truth", (m.holds for m in good), 0.95),
        _figure("GOOD: intervals that hold the truth", (i for m in good for i in m.inside.values()), 0.95),
        _figure("GOOD: scales within 10 %", (all(m.near.values()) for m in good), 0.98),
        _figure("GOOD: direction right", says, 1.0),
        _figure("ROUGH: all intervals of an answer hold the truth", (m.holds for m in rough), 0.9),
        _figure("without a fault, ten minutes: GOOD", (m.level == "good" for m in clean), 0.8),
        _figure("no crash", (m.level != "crashed" for m in found), 1.0),
        f"without a fault, but one is named: {len(alarms)} of {sum(not m.log['fault'] for m in found)}",
    ]
    return "\n".join(lines)


def _figure(title: str, right: Iterable[bool], least: float) -> str:
    marks = list(right)
    if not marks:
        return f"NOT SEEN   {title}"
    share = sum(marks) / len(marks)
    verdict = "PASS" if share >= least else "FALL SHORT"
    shown = f"{sum(marks)} of {len(marks)}, {100 * share:.0f} %"
    return f"{verdict:10} {title}: {shown} (at least {100 * least:.0f} %)"


def _alarm(mark: Marked) -> bool:
    """Whether the answer to a log without a fault names one of those that its profile may have."""
    own = (f for f in BY_NAME.values() if mark.log["profile"] in f.profiles)
    return any(fault.says(mark.answer["text"]) for fault in own)


def line(mark: Marked) -> str:
    """One log in a line: what it is, the answer's grade, and what of it is wrong."""
    log, answer = mark.log, mark.answer
    words = (
        f"{log['seed']}/{log['number']} {log['engine']}, {log['driving']}, {log['profile']}, "
        f"{log['seconds']:.0f} s, {log['fault'] or 'no fault'}: {mark.level.upper()}"
    )
    if log["fault"]:
        words += ", named" if mark.named else ", not named"
    if mark.level in ("good", "rough"):
        words += "; WRONG:" if mark.wrong else "; right"
        wrong = [name for name, holds in mark.inside.items() if not holds or not mark.near.get(name, True)]
        words += ",".join(f" {_number(name, log, answer)}" for name in wrong)
        words += " direction" if mark.direction is False else ""
    else:
        words += f"; {answer['text'].strip().splitlines()[-1 if mark.level == 'crashed' else 0][:150]}"
    return f"{words} [{answer['took']:.0f} s]"


def _number(name: str, log: Mapping[str, Any], answer: Mapping[str, Any]) -> str:
    value, low, high, unit = answer["numbers"][name]
    return f"{name} {value:.4g} ({low:.4g} to {high:.4g}) {unit} for {true_value(name, log, answer):.4g}"


def worst(found: Sequence[Marked], count: int = 5) -> str:
    """The wrong answers that are farthest off: GOOD before ROUGH, a wrong direction first of all."""
    wrong = [m for m in found if m.level in GRADES and m.wrong]
    wrong.sort(key=lambda m: (GRADES.index(m.level), m.direction is not False, -m.off[0]))
    lines = [f"{line(m)}\n    {_command(m)}" for m in wrong[:count]]
    return "\n".join(["worst wrong answers:", *lines])


def _command(mark: Marked) -> str:
    return f"python -m tests.recordings --seed {mark.log['seed']} --only {mark.log['number']} --keep DIR"
