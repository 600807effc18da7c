"""Names of columns as words: what a column of any logger's spelling may be called.

``VehSpd``, ``ESP_Gierrate``, ``carState.steeringAngleDeg`` and ``"Steering, Measured [rad]"``
are split at capitals, signs and the joints of known words, each word is brought to one spelling,
and words that say where a signal comes from do not count.  What is left is compared with the
phrases of a role.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

_WORDS = {
    "yaw": "yaw gier gieren lacet",
    "psi": "psi",
    "psi dot": "psip psidot dpsi psipkt psipunkt psid yawd",
    "rate": "rate rt",
    "speed": "speed spd velocity velo vel geschwindigkeit geschw tempo vitesse",
    "dot": "dot punkt pkt",
    "acceleration": "acceleration accel acc beschleunigung beschl",
    "steer": "steer steering strg str stg lenk lenkung lenken",
    "hand wheel": "handwheel steeringwheel steerwheel stwheel stw stwhl strgwhl strwhl lenkrad "
    "handrad lrad hndwhl",
    "hand wheel angle": "swa stwa sas lrw lwi",
    "road wheel angle": "rwa",
    "wheel": "wheel whl whls wheels",
    "road": "road tire tyre rwheel",
    "road wheel": "roadwheel",
    "front wheel": "vorderrad",
    "wheel steer angle": "radlenkwinkel radeinschlag radeinschlagwinkel",
    "hand": "hand driver fahrer",
    "front": "front vorne frt fa va",
    "rear": "rear hinten hinterachse ra ha",
    "left": "left links",
    "right": "right rechts rh",
    "lateral": "lateral lat quer",
    "longitudinal": "longitudinal longi long lgt laengs längs forward fwd",
    "angle": "angle ang angl winkel wnkl position pos",
    "angular": "angular",
    "command": "command cmd cmnd commanded kommando soll sollwert request requested req demand "
    "dmd desired des setpoint sp set target tgt tar ref reference",
    "gyro": "gyro gyroscope gyr drehrate",
    "turn rate": "turnrate",
    "omega": "omega",
    "omega z": "omegaz wz avz gyrz gyroz",
    "delta": "delta dlt",
    "v": "v",
    "v x": "vx",
    "v y": "vy",
    "time": "time zeit uhrzeit timestamp timestamps times sec seconds secs stamp clock tstamp "
    "datetime zeitstempel",
    "ground": "ground gnd horizontal",
    "heading": "heading",
    "torque": "torque trq moment tq",
}
_SPELLINGS = {surface: words for words, all_ in _WORDS.items() for surface in all_.split()}

_ORIGINS = frozenset(
    "vehicle veh car ego fzg fahrzeug kfz host body chassis sensor sensors sens measured meas "
    "measurement mess messwert actual act ist istwert value val values wert sig signal data can "
    "esp esc abs eps dsc imu gps ins gnss vbox adma oxts rt3000 log logger raw filt filtered "
    "filter lp corrected corr cal calibrated msg message bus state carstate control "
    "controlsstate actuators model sim plant platform "
    "out output outputs in input inputs the of current cur total abs hz fused est estimated "
    "channel ch rel relative system sys since start elapsed utc kin kinematics dyn dynamics "
    "coorsys c0 c1 ref0 cog cg com twist pose odom odometry main".split()
)
_NEGATIONS = frozenset(
    "acceleration error err valid validity status stat quality qual std stddev var variance cov "
    "covariance counter cnt checksum crc torque offset bias limit max min flag fault wheel rear "
    "lateral y left right fl fr rl rr vl vr hl hr heading roll pitch command gradient dot rate "
    "speed angle accuracy acc jerk diff deviation latitude longitude lon temperature temp "
    "voltage".split()
)
_VAGUE = frozenset("yaw delta omega command psi v angle rate gyro".split())


@dataclass(frozen=True, slots=True, order=True)
class Match:
    """How well a column's name fits a role, the least first.

    Attributes
    ----------
    kind : int
        0 for the plant's own name, 1 a full name, 2 one with words of unknown meaning, 3 one
        that the plant warns of, 4 a symbol or vague word.
    order : int
        Among symbols and vague words, the place in the plant's list.
    extra : int
        How many words say where the signal comes from.
    suffix : str
        The unit at its end.
    """

    kind: int
    order: int
    extra: int
    suffix: str = ""


OWN, FULL, UNSURE, WARNED, VAGUE = range(5)


def match(
    column: str, phrases: tuple[tuple[str, ...], ...], own: int, warned: Iterable[str]
) -> Match | None:
    """How a column's words fit any of the phrases, the first `own` of which are the plant's.

    Phrases are canonical words, as `words` gives them; `warned` are phrases, joined by blanks.
    """
    found = [
        match_
        for order, phrase in enumerate(phrases)
        if (match_ := _fit(words(column), phrase, order, order < own, warned)) is not None
    ]
    return min(found, default=None)


def _fit(
    said: tuple[str, ...], phrase: tuple[str, ...], order: int, own: bool, warned: Iterable[str]
) -> Match | None:
    if not set(phrase) <= set(said):
        return None
    rest = [word for word in dict.fromkeys(said) if word not in phrase and not word.isdigit()]
    if any(word in _NEGATIONS for word in rest):
        return None
    unknown = [word for word in rest if word not in _ORIGINS]
    vague = len(phrase) == 1 and (len(phrase[0]) < 3 or phrase[0] in _VAGUE)
    if unknown and (len(phrase) == 1 or vague):
        return None
    if vague and rest and not own:
        return Match(VAGUE, order, len(rest))
    if " ".join(phrase) in warned:
        return Match(WARNED, 0, len(rest))
    kind = UNSURE if unknown else OWN if own else VAGUE if vague else FULL
    return Match(kind, order if kind == VAGUE else 0, len(rest))


@cache
def words(name: str) -> tuple[str, ...]:
    """A column's name, without its unit in brackets, as canonical words."""
    found: list[str] = []
    for token in _tokens(bare(name)):
        for part in _segments(token) or (token,):
            found += _SPELLINGS.get(part, part).split()
    text = " ".join(found)
    # A steering wheel is the hand wheel; the wheel that steers is another.
    return tuple(text.replace("steer wheel angle", "hand wheel angle").split())


@cache
def _segments(token: str) -> tuple[str, ...]:
    """A token cut into known words of three letters or more, as few as possible; or nothing."""
    known = token in _SPELLINGS or token in _ORIGINS
    if known or len(token) < 5:
        return (token,) if known else ()
    best: list[tuple[str, ...] | None] = [(), *[None] * len(token)]
    for end in range(3, len(token) + 1):
        for start in range(end - 2):
            before, word = best[start], token[start:end]
            if before is None or (word not in _SPELLINGS and word not in _ORIGINS):
                continue
            now = best[end]
            if now is None or len(before) + 1 < len(now):
                best[end] = (*before, word)
    return best[-1] or ()


def bare(column: str) -> str:
    """A column's name without its unit in brackets."""
    return re.sub(r"\[.*?\]|\(.*\)", "", column).strip()


def _tokens(name: str) -> list[str]:
    """Split at signs, capitals and digits: ``vEgo2`` is v, ego, 2."""
    parts = re.split(r"[\W_]+", name)
    cut = (_CAPITALS.findall(part) if part.lower() not in _SPELLINGS else [part] for part in parts)
    return [token.lower() for tokens in cut for token in tokens]


_CAPITALS = re.compile(r"[A-ZÄÖÜ]+(?![a-zäöüß])|[A-ZÄÖÜ]?[a-zäöüß]+|\d+|[^\W\d_a-zA-ZäöüßÄÖÜ]+")
