"""What the names of columns say: which channel, in which unit, measured or commanded."""

from __future__ import annotations

import re
from functools import cache

from rover_sweep.data.recording import Origin

SAYS = 0.3  # weight from which a name says a role
# Logarithms of odds, roughly as in the files that were seen: what a name of weight 1 says, which is wrong in
# some per cent of them; against a set value for a measurement, a rear wheel's angle for the steering, and a
# yaw rate that odometry computed from the steering; and against a unit of another quantity.
SAID, SET_VALUE, REAR_WHEEL, COMPUTED, OTHER_UNIT = 4.0, 4.0, 3.0, 2.0, 6.0
# {role: ((pattern, weight), ...)}: matched against the name in lower case, words joined by blanks
_PATTERNS: dict[str, tuple[tuple[str, float], ...]] = {
    "time": (
        (r"\b(time|timestamp|stamp|time ?us|time ?s|t|ts|datetime|date|utc)\b", 1.0),
        (r"\b(zeit|zeitstempel|uhrzeit|datum)\b", 1.0),
        (r"\b(elapsed|clock|epoch|sec|secs|seconds|s)\b", 0.6),
    ),
    "r": (
        (r"\byaw ?(rate|vel|velocity|speed)\b|\byaw ?dot\b|\b(d ?psi|psi ?dot|turn ?rate)\b", 1.0),
        (r"\b(gyro?|gyr|omega|ang ?vel|angular velocity|ang|rotation rate|w|av|imu) ?z\b|\b[gw]z\b", 1.0),
        (r"\bz ?(gyro|rate)\b|\bangular (velocity )?(rate )?z\b", 1.0),
        (r"\bvehicle angular velocity xyz 2\b", 1.0),
        (r"\b(gierrate|gier(winkel)?geschwindigkeit|drehrate)\b", 1.0),
        (r"\b(omega|ang(ular)? ?vel(ocity)?|w imu|gyro)\b(?! ?[xy]\b)|^r$|^w$", 0.8),
        (r"^rate$", 0.5),
    ),
    "p": (
        (r"\broll ?(rate|vel|velocity|speed|dot)\b|\b(phi ?dot|d ?phi)\b", 1.0),
        (r"\b(gyro?|gyr|omega|ang ?vel|angular velocity|ang|rotation rate|imu) ?x\b|\b[gw]x\b|^p$", 0.9),
        (r"\bvehicle angular velocity xyz 0\b", 1.0),
    ),
    "psi": (
        (r"\b(yaw|heading|psi|azimuth|hdg|theta)\b(?! ?(rate|vel|speed|dot|acc))", 1.0),
        (r"\bphi ?y\b|\beuler ?z\b|\bcourse\b|\bcog\b|\bphi\b", 0.6),
        (r"\b(gierwinkel|kurs)\b", 1.0),
    ),
    "speed": (
        (r"\b(speed|velocity|vel|v|spd|vehicle ?speed|ground ?speed)\b(?! ?(y|z|n|e|d)\b)", 0.8),
        (r"\b(v ?x|vel ?x|velocity ?x|linear x|vx|v ?long|longitudinal (speed|velocity))\b", 1.0),
        (r"\bencoder\b|\bgspd\b|\bspd\b|\bwheel speed\b", 0.8),
        (r"\b(fahr)?geschwindigkeit\b", 1.0),
    ),
    "ay": (
        (r"\bvehicle acceleration xyz 1\b", 1.0),
        (r"\b(a|acc|accel|acceleration|linear acceleration|imu) ?y\b|\by ?(acc|accel)\b", 1.0),
        (r"\blat(eral)? ?(acc|accel|acceleration|g)\b|\blat g\b|\bg force lat\w*\b", 1.0),
        (r"\ba ?lat\b|\bquerbeschleunigung\b", 1.0),
    ),
    "ax": (
        (r"\bvehicle acceleration xyz 0\b", 1.0),
        (r"\b(a|acc|accel|acceleration|linear acceleration) ?x\b|\bx ?(acc|accel)\b", 1.0),
        (r"\blong(itudinal)? ?(acc|accel|acceleration|g)\b|\ba ?long\b", 1.0),
    ),
    "vy": ((r"\b(v ?y|vel ?y|velocity ?y|linear y|lat(eral)? (speed|velocity|vel)|v ?lat)\b", 1.0),),
    "steering": (
        (r"\bdelta\b|\bsteer(ing)?\b|\bsteering ?angle\b|\bsteer ?angle\b|\broad ?wheel ?angle\b", 1.0),
        (r"\b(swa|hand ?wheel|steering ?wheel|servo|wheel ?angle|c ?1|ch ?1|rudder)\b", 0.8),
        (r"\blenk(ung|winkel|radwinkel|einschlag)?\b", 1.0),
        (r"\bactuator (servos|controls 0) control [02]\b|\bangular z\b|\bsteer\w*\b", 0.5),
    ),
    "other": (
        (r"\b(gyro?|gyr|omega|ang ?vel|angular velocity|ang|av|imu|w|g) ?y\b|\bpitch\b", 1.0),
        (r"\b(acc|accel|acceleration|a) ?z\b|\bmag\w*|\b(current|voltage|battery|temp\w*|fuel)\b", 1.0),
        (r"\b(throttle|motor|brake|gear|rpm|ticks?|pressure)\b", 1.0),
        (r"\b(lat|lon|latitude|longitude|altitude|alt|satellites|hdop|error|cov\w*|quality|mode)\b", 1.0),
    ),
    "trial": ((r"^(trial|run|lap|session|experiment|test|segment|episode)( ?(id|number|no|nr))?$", 1.0),),
    "bad": ((r"^(bad|invalid|outlier|reject|leave ?out)$", 1.0),),
}
_COMMANDED = re.compile(r"\b(cmd|command|des|target|ref|set ?point|sp\b|goal|request|drive speed|ackermann)")
_MEASURED = re.compile(
    r"\b(meas\w*|actual|act|feedback|fb|fdbk|enc|encoder|pot|potentiometer|report\w*|sensor|gemessen|ist)\b"
)
_SENT = re.compile(
    r"\b(drive steering angle|rc|joy\w*|stick|soll|rcou|output|actuator (servos|controls|outputs)( \d)?)\b"
)
_ARRIVAL = re.compile(r"\b(arriv\w*|receiv\w*|rosbag ?time\w*|bag ?time\w*|log ?time|recorded|exported)\b")
_REAR = re.compile(r"\b(rear|rl|rr|hinten|hinterrad)\b|\w(rl|rr)$")
_NOT = {
    "steering": re.compile(r"\b(rate|torque|vel|velocity|speed|dot|delta ?delta|d delta|effort|current)\b"),
    "speed": re.compile(
        r"\b(ang|angular|yaw|wheel (fl|fr|rl|rr)|wind|rpm|steer\w*|err\w*|cov\w*|acc\w*|control)\b"
    ),
    "r": re.compile(r"\b(acc\w*|err\w*|cov\w*|mag\w*|vel encoder)\b"),
}
_DEGREES = re.compile(r"\b(lat|latitude|lon|lng|long|longitude)$")
_ROTATION = re.compile(r"\b(e ?rpm|erpm|rpm|rps|revs?|revolutions|drehzahl)\b")
_STEERED = re.compile(r"\b(steer\w*|hand|swa|yaw)\b")
UNIT_WORDS: dict[str, str] = {  # in brackets or as the last word of a name: the unit
    **dict.fromkeys(("degps", "dps", "deg s", "degrees s", "degs", "deg sec", "deg per s", "° s"), "deg/s"),
    **dict.fromkeys(("radps", "rad s", "rads", "rad sec"), "rad/s"),
    **dict.fromkeys(("deg", "degree", "degrees", "°"), "deg"),
    **dict.fromkeys(("rad", "radian", "radians"), "rad"),
    **dict.fromkeys(("kmh", "kph", "kmph", "km h"), "km/h"),
    **dict.fromkeys(("mph",), "mph"),
    **dict.fromkeys(("kn", "kt", "kts", "knots"), "kn"),
    **dict.fromkeys(("m s", "mps", "ms 1"), "m/s"),
    **dict.fromkeys(("m s 2", "m s2", "m s^2", "mps2", "ms2", "mss", "m s s"), "m/s^2"),
    **dict.fromkeys(("rpm", "erpm", "1 min", "u min"), "rpm"),
    **dict.fromkeys(("ft s", "fps", "ft sec"), "ft/s"),
    **dict.fromkeys(("ft s 2", "ft s2", "ft s^2", "fps2"), "ft/s^2"),
    "g": "g",
    "us": "us",
    "usec": "us",
    "ms": "ms",
    "msec": "ms",
    "ns": "ns",
    "nsec": "ns",
    "nanosec": "ns",
    "pwm": "us",
}


_UNITS_OF: dict[str, tuple[str, ...]] = {  # of rates also without "per second", as some names have them
    "r": ("rad/s", "deg/s", "rad", "deg"),
    "speed": ("m/s", "km/h", "mph", "kn", "ft/s", "rpm"),
    "ay": ("m/s^2", "g", "ft/s^2"),
    "steering": ("rad", "deg", "us"),
}


def words_of(name: str) -> str:
    """The name in lower-case words: "angX" and "ang_x" are "ang x", "/imu.linear.z" is "imu linear z"."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    words = re.sub(r"[^a-z0-9^°]+", " ", apart.lower()).strip()
    return words.replace("gyroscope", "gyro").replace("accelerometer", "accel")  # as phones call them


@cache
def name_weight(role: str, name: str) -> float:
    """0 to 1: how much a column's name says that it has this role."""
    words = re.sub(r"\b(rad|deg|degs|m|s|g|us|km h|kmph)$", "", words_of(without_unit(name))).strip()
    words = words or words_of(name)
    last = words_of(re.split(r"[./]", without_unit(name))[-1])
    found = max(0.8 * _weight(role, words), _weight(role, last))
    if role == "r" and "odom" in words:  # often computed from the steering
        found *= 0.6
    return found * (0.5 if role not in ("steering", "time") and is_commanded(name) else 1.0)


def _weight(role: str, words: str) -> float:
    if (wrong := _NOT.get(role)) and wrong.search(words):
        return 0.0
    return max((weight for p, weight in _PATTERNS[role] if re.search(p, words)), default=0.0)


def is_arrival(name: str) -> bool:
    """True for the time at which a message was received, recorded or exported: later than its stamp."""
    return name.endswith("%time") or bool(_ARRIVAL.search(words_of(name)))


def is_another(role: str, name: str) -> bool:
    """True for a name that says another role than this one, and says it more clearly."""
    rivals = (r for r in _PATTERNS if r not in (role, "trial", "bad"))
    return max(name_weight(rival, name) for rival in rivals) >= max(0.6, name_weight(role, name) + 0.01)


def says_nothing(name: str) -> bool:
    """True for a name that says no role at all, such as column 3, states[3] or Signal_7."""
    return all(name_weight(role, name) < SAYS for role in _PATTERNS)


def name_odds(role: str, name: str) -> float:
    """Logarithm of the odds that a column of this name has this role, against one whose name says nothing."""
    rivals = max(name_weight(rival, name) for rival in _PATTERNS if rival not in (role, "trial", "bad"))
    own = name_weight(role, name)
    words = words_of(name)
    unlikely = REAR_WHEEL if role == "steering" and _REAR.search(words) else 0.0
    if role != "steering" and is_commanded(name):
        unlikely += SET_VALUE
    if (unit := unit_in(name)) and unit not in _UNITS_OF.get(role, (unit,)):
        unlikely += OTHER_UNIT
    if role == "r" and "odom" in words:
        unlikely += COMPUTED
    return SAID * own - SAID * max(0.0, rivals - own) - unlikely


def says_anything(name: str) -> bool:
    """True for a name that may be that of a channel, of a position or of a quaternion's part."""
    roles = (role for role in _PATTERNS if role not in ("other", "time"))
    last = words_of(without_unit(name)).split()[-1:]
    return bool({"x", "y", "z", "w", "east", "north", "lon", "lat"} & set(last)) or any(
        name_weight(role, name) >= 0.3 for role in roles
    )


def is_degrees(name: str) -> bool:
    """True for a name that says latitude or longitude."""
    return bool(_DEGREES.search(words_of(without_unit(name))))


def is_rotation(name: str) -> bool:
    """True for the revolutions of a wheel or a motor: a speed of unknown scale."""
    turns = unit_in(name) in ("rpm", "rad/s", "deg/s") and re.search(r"\b(wheel|motor|shaft)", words_of(name))
    return bool(_ROTATION.search(words_of(name)) or (turns and not _STEERED.search(words_of(name))))


def is_numbered(name: str) -> bool:
    """True for a name such as column 3 or states[3], which says nothing but a place."""
    return re.search(r"(column |\[|_)\d+\]?$", name) is not None


def is_commanded(name: str) -> bool:
    """True for a set value, which is not a measurement."""
    return bool(_COMMANDED.search(words_of(name)))


def origin_in(name: str) -> Origin:
    """Whether a steering of this name was commanded or measured; "unknown" where it does not say."""
    words = words_of(name)
    sent = is_commanded(name) or bool(_SENT.search(words))
    if sent == bool(_MEASURED.search(words)):
        return "unknown"
    return "commanded" if sent else "measured"


def without_unit(name: str) -> str:
    """The name without a unit in brackets at its end; a number there is a place in a list."""
    return re.sub(r"[\[(](?!\d+[\])])[^\])]*[\])]\s*$", "", name.strip("# "))


def unit_in(name: str) -> str:
    """The unit that a name tells, as in "omega(rad/s)" or "speed_kmh"; "" for none."""
    found = re.search(r"[\[(]([^\])]*)[\])]\s*$", name)
    if found and (unit := UNIT_WORDS.get(words_of(found[1].replace("²", "2")))):
        return unit
    last = words_of(name).split()[-1:]
    return UNIT_WORDS.get(last[0], "") if last and len(last[0]) > 1 else ""
