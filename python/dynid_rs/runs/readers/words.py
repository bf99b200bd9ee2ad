"""Words in the names of columns, in the languages of vendors, and what they mean."""

from __future__ import annotations

import re
from collections.abc import Mapping

_WORDS: Mapping[str, str] = {
    "position": "q pos position positions angle angles ang theta winkel lage jnt axispos axisact istposition gelenk "
    "istwinkel posact apos jointpos pose",
    "velocity": "dq qd qdot vel velocity velocities speed spd omega geschwindigkeit drehzahl istgeschwindigkeit rpm",
    "acceleration": "ddq qdd acc accel acceleration beschleunigung",
    "torque": "tau torque torques trq tq moment moments effort efforts eff drehmoment istmoment motormoment gearmoment "
    "torqueact",
    "current": "current currents curr cur amp amps ampere strom iststrom iq motorcurrent macur",
    "temperature": "temp temperature temperatures temperatur",
    "time": "t time times timestamp timestamps zeit stamp clock ipoc datetime",
}
_OF = {word: meaning for meaning, words in _WORDS.items() for word in words.split()}
_ROLES: Mapping[str, str] = {
    "reference": "ref reference target cmd command commanded desired des set soll setpoint goal sollposition demand",
    "motor": "motor mot mtr rotor encoder enc motorposition motorwinkel motorpos",
    "model": "model ext external estimated est gravity grav coriolis friction filtered ff feedforward hat disturbance "
    "limit max min",
    "error": "err error diff deviation following schleppfehler lag tracking",
    "actual": "act actual ist meas measured feedback fbk fb real istposition istmoment iststrom",
}
_ROLE_OF = {word: role for role, words in _ROLES.items() for word in words.split()}
_PARTS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")


def words_of(name: str) -> list[str]:
    """Words of a name in small letters: `ActualQ_1` gives actual, q; numbers are left out."""
    found = []
    for part in re.split(r"[^0-9A-Za-zäöüÄÖÜß]+", name):
        if part.lower() in _OF or part.lower() in _ROLE_OF:
            found.append(part.lower())
        else:
            found += [word.lower() for word in _PARTS.findall(part) if not word.isdigit()]
    return found


def meanings(name: str) -> set[str]:
    """What a name may mean: ``"position"``, ``"torque"``, ..."""
    return {_OF[word] for word in words_of(name) if word in _OF}


def roles(name: str) -> set[str]:
    """What a name says of its source: ``"reference"``, ``"motor"``, ``"model"``, ``"error"``, ``"actual"``."""
    return {_ROLE_OF[word] for word in words_of(name) if word in _ROLE_OF}
