"""What a law without a name could be, and the run that would tell more, in words."""

from __future__ import annotations

from collections.abc import Sequence

from rover_sweep.diagnosis.simulation.table_law import TableLaw

QUANTITIES = {
    "delta": "the steering angle",
    "delta_dot": "the rate of the steering angle",
    "a_y": "a_y",
    "r": "r",
    "p": "p",
    "phi": "the roll angle",
    "beta": "the sideslip angle",
    "v": "the speed",
    "psi": "the heading",
    "t": "the time in the run",
    "r_dot": "the yaw acceleration",
    "p_dot": "the roll acceleration",
    "v_dot": "the longitudinal acceleration",
    "signal": "its own signal",
    "signal_dot": "the rate of its own signal",
}
FACTORS = {"delta": "steering angle", "a_y": "a_y", "r": "r", "v^2": "speed squared"}
_OVER = {
    "t": "something that changes while driving: tyres that warm up, a battery that sags, a load that moves",
    "v": "something that changes with speed",
    "psi": "the ground or the wind, which do not turn with the rover",
}
_COULD_BE = {
    ("steering", "delta"): "a steering linkage that is not linear",
    ("steering", "delta_dot"): "friction in the servo or the linkage",
    ("side force front", "delta"): "a steering linkage that is not linear",
    ("side force front", "a_y"): "front tyres that saturate, or steering that gives way under load",
    ("side force front", "beta"): "front tyres that saturate",
    ("side force front", "phi"): "roll steer of the front axle",
    ("side force rear", "a_y"): "rear tyres that saturate, or a rear axle that gives way under load",
    ("side force rear", "beta"): "rear tyres that saturate",
    ("side force rear", "phi"): "roll steer of the rear axle",
    ("side force", "phi"): "roll steer of both axles",
    ("yaw moment", "r"): "a locked differential or another yaw damping",
    ("yaw moment", "delta"): "wheel torques that differ between left and right, or tyre scrub in turns",
    ("yaw moment", "a_y"): "tyres that saturate differently at front and rear",
    ("roll moment", "p"): "friction or a nonlinear damper in the suspension",
    ("roll moment", "phi"): "a nonlinear spring or a stop in the suspension",
}
_NEXT = {
    "steering": "measure the road-wheel angle over the PWM at standstill, upwards and downwards",
    "side force": "drive steady turns to both sides at three speeds, each with three steering angles",
    "yaw moment": "drive steady turns to both sides at three speeds, then again while coasting",
    "roll moment": "tilt the body at standstill, release it and log its decay",
    "sensor": "turn or tilt the rover by hand through known angles and compare the sensor with them",
    "speed": "coast straight ahead, then in a turn, from the same speed",
}
_NEXT_OVER = {
    "t": "repeat the first run at the end of the session, without a pause and after one",
    "v": "drive the same steering angles at three speeds",
    "psi": "drive the same run in the opposite heading",
}


def could_be(law: TableLaw) -> str:
    """What the law could be, as a noun phrase."""
    if law.memory == "play":
        return "play, stiction or friction between servo and wheels"
    if law.memory == "resonance":
        if law.place == "steering":
            return "a linkage that gives"
        return "a mast of the IMU that sways" if law.place.startswith("sensor") else "a load that swings"
    if law.memory == "lag":
        what = "sensor or its filter" if law.place.startswith("sensor") else _lagging(law.place)
        return f"a {what} that lags by about {law.size:g} s"
    if law.place.startswith("sensor"):
        return _sensor(law.over)
    return _COULD_BE.get((law.place, law.over)) or _OVER.get(law.over) or f"a missing {law.place}"


def next_run(law: TableLaw) -> str:
    """The run or measurement that would tell more."""
    place = "sensor" if law.place.startswith("sensor") else law.place
    place = "side force" if place.startswith("side force") else place
    return _NEXT_OVER.get(law.over) or _NEXT[place]


def place_words(place: str) -> str:
    """The place as part of a sentence: "the yaw moment", "the sensor of a_y"."""
    return "the " + place.replace("sensor of ay", "sensor of a_y").replace("sensor of vy", "sensor of V_y")


def over_words(law: TableLaw) -> str:
    """What the law depends on: "r", "the time in the run, times a_y"."""
    what = QUANTITIES.get(law.over, law.over)
    if law.memory == "lag":
        what = f"what is new in {what} over {law.size:g} s"
    elif law.memory == "play":
        what = f"{what} behind a play"
    return f"{what}, times {FACTORS[law.times]}" if law.times else what


def short(law: TableLaw) -> str:
    """Place and quantity: "roll moment ~ phi", "roll moment ~ resonance of a_y at 1.4 Hz"."""
    if law.memory == "resonance":
        return f"{law.place} ~ resonance of {law.over} at {law.size:.2g} Hz"
    return f"{law.place} ~ {law.over}"


def laws_sentence(
    laws: Sequence[TableLaw], alternatives: tuple[str, ...], share: float | None, holds: bool
) -> str:
    """The laws of an unknown in a sentence.

    alternatives: places of the first. share: of the held-out residual that they remove, None without such
    runs. holds: they are in the model.
    """
    first, *others = laws
    words = f"{_acts(first, (first.place, *alternatives))}"
    words += "".join(f"; {_acts(law, (law.place,))}" for law in others)
    them, are = ("them", "they are") if others else ("it", "it is")
    goes = f"of the residual of held-out runs goes with {them}"
    if not holds:
        return f"{words}; too little {goes}, so {are} not in the model"
    removed = f"; {100 * min(share, 1.0):.0f} % {goes}" if share else ""
    it = "the first" if others else "it"
    return f"{words}{removed}; {it} could be {could_be(first)}; to confirm it, {next_run(first)}"


def _acts(law: TableLaw, places: tuple[str, ...]) -> str:
    at = " or ".join(place_words(p) for p in places)
    if law.memory == "resonance":
        number = f"{law.size:.2g} Hz (damping ratio {law.damping:.2g})"
        return f"a resonance at {number}, driven by {over_words(law)}, acts on {at}"
    return f"a law over {over_words(law)} acts on {at}"


def _lagging(place: str) -> str:
    return {"steering": "servo or linkage", "roll moment": "suspension"}.get(place, "tyre force")


def _sensor(over: str) -> str:
    if over == "signal":
        return "a wrong scale of the sensor"
    if over in ("signal_dot", "r_dot", "p_dot"):
        return "a lag of the sensor, or another position of it"
    return _OVER.get(over, "a sensor that is tilted or measures another motion too")
