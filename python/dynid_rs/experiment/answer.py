"""What the next experiment will decide: for programs, for a terminal, and for the page of plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dynid_rs.base.quoting import shown
from dynid_rs.base.wording import ANOTHER_FUNCTION, kind_words
from dynid_rs.diagnosis.along import NEEDS_MORE
from dynid_rs.diagnosis.open_questions import OpenQuestions, Question
from dynid_rs.diagnosis.waves import UNKNOWN
from dynid_rs.experiment.designing import LIKELY, Compared, NextExperiment
from dynid_rs.report.tables import cell, table
from dynid_rs.report.text import esc, percent, significant

Section = Mapping[str, Any]

WORTH_SAYING = 0.01
"""Probability of its first answer below which a question is one of many: kept for programs, not shown to people."""


def to_json(found: NextExperiment) -> dict[str, Any]:
    """Every question with its odds now and the chance that each motion settles it; `next` of a design's JSON."""
    compared = {"this_motion": found.expected, "random_motion": found.random, "exciting_motion": found.exciting}
    questions = [
        {
            **_question(found.asked, question),
            "probability": _probability(question),
            **{name: _chances(own, k) for name, own in compared.items()},
        }
        for k, question in enumerate(found.questions)
    ]
    return {
        "duration_s": found.design.duration,
        "questions": questions,
        "left_to_others": [
            {
                **_question(found.asked, question),
                "probability": _probability(question),
                "needs": _needs(found.asked, question),
            }
            for question in found.others
        ],
        "nats": {name: own.nats for name, own in compared.items()},
        "random_times_as_long": found.random_times,
        "error_beyond_noise": {
            "now": found.excess.now.tolist(),
            "this_motion": found.excess.designed.tolist(),
            "random_motion": found.excess.random.tolist(),
            "exciting_motion": found.excess.exciting.tolist(),
        },
        "is_wanted": found.is_wanted,
        "n_evaluations": found.n_evaluations,
    }


def _question(asked: OpenQuestions, question: Question) -> dict[str, Any]:
    names = asked.plan.robot.joint_names

    def said(k: int) -> dict[str, Any]:
        candidate = asked.candidates[k]
        return {"kind": candidate.kind, "joints": [names[j] for j in candidate.joints]}

    rival = said(question.second.candidates[0]) if question.second.candidates else None
    return {**said(question.first.candidates[0]), "or": rival}


def _probability(question: Question) -> float:
    from scipy.special import expit

    return float(expit(question.log_odds))


def _chances(own: Compared, k: int) -> dict[str, float]:
    chance = own.chances[k]
    return {"settles": chance.right, "settles_wrongly": chance.wrong, "if_so": chance.first, "if_not": chance.second}


def _needs(asked: OpenQuestions, question: Question) -> str:
    kinds = [asked.candidates[k].kind for k in question.candidates]
    return next(NEEDS_MORE[kind] for kind in kinds if kind in NEEDS_MORE)


def words(question: Section, n_joints: int) -> str:
    """``friction hysteresis on joint_2 or joint spring on joint_2``; of what may be nothing, with a question mark."""
    first = _named(question, n_joints)
    return f"{first} or {_named(question['or'], n_joints)}" if question["or"] else f"{first}?"


def _named(entry: Section, n_joints: int) -> str:
    places = [shown(name) for name in entry["joints"]]
    if entry["kind"] == UNKNOWN:
        return f"{kind_words(ANOTHER_FUNCTION)} of {places[0]}"
    where = "the whole robot" if len(places) == n_joints > 2 else " and ".join(places)
    return f"{kind_words(entry['kind'])} on {where}"


def shown_questions(section: Section, which: str = "questions") -> list[dict[str, Any]]:
    """Questions that a person would ask."""
    return [q for q in section[which] if q["or"] or q["probability"] >= WORTH_SAYING]


def _certainty(section: Section, joints: Sequence[str]) -> list[str]:
    """How far the model's error within the limits is from the noise alone, on the joint where it is farthest."""
    now, then = (section["error_beyond_noise"][name] for name in ("now", "this_motion"))
    worst = max(range(len(now)), key=lambda j: now[j])
    said = [
        f"anywhere within the limits the error on {shown(joints[worst])}, the least known joint, exceeds the noise by "
        f"at most {percent(now[worst])} now, and {percent(then[worst])} after this motion (19 times of 20)"
    ]
    if not section["is_wanted"]:
        said.append("no question that is open would rather be settled, and only noise is left: nothing more to record")
    return said


def sentences(section: Section, joints: Sequence[str]) -> list[str]:
    """What it comes to."""
    questions = shown_questions(section)
    others = len(section["questions"]) - len(questions)
    likely = [q for q in questions if q["this_motion"]["settles"] >= LIKELY]
    said = []
    if not questions:
        said.append(
            "nothing is open that a motion could decide: this one shows most about torques within the limits that the "
            "model knows least"
        )
    else:
        plural = "s" if len(questions) > 1 else ""
        said.append(
            f"{section['duration_s']:g} s of this motion will rather settle {len(likely)} of {len(questions)} open "
            f"question{plural}"
        )
    for question in questions:
        if question["this_motion"]["settles"] < LIKELY:
            chance = percent(question["this_motion"]["settles"])
            said.append(f"left out: {words(question, 0)} It would rather stay open ({chance})")
    if others:
        said.append(f"it looks at {others} kinds at places that the runs are silent about, too, each unlikely")
    times = section["random_times_as_long"]
    if times is None:
        said.append("random motion within the same limits does not tell as much in sixty-four times that time")
    elif times <= 1.0:
        said.append("random motion within the same limits tells as much in that time")
    else:
        said.append(
            f"random motion within the same limits has to be {significant(times)} times as long to tell as much"
        )
    return said + _certainty(section, joints)


def left_sentences(section: Section, joints: Sequence[str]) -> list[str]:
    """What no motion of some seconds decides, and what would."""
    return [
        f"{words(q, len(joints))} no motion of seconds tells: it takes {q['needs']}" for q in section["left_to_others"]
    ]


HEAD = ("question", "now", "this motion settles it", "random motion", "exciting motion")


def rows(section: Section, joints: Sequence[str]) -> list[tuple[str, ...]]:
    """Of a table under `HEAD`: probabilities that the first answer is right, and that it is settled rightly."""
    return [
        (
            words(q, len(joints)),
            percent(q["probability"]),
            *(percent(q[name]["settles"]) for name in ("this_motion", "random_motion", "exciting_motion")),
        )
        for q in shown_questions(section)
    ]


def html(section: Section, joints: Sequence[str]) -> str:
    """The same for the page of plots."""
    texts = (*sentences(section, joints), *left_sentences(section, joints))
    said = "".join(f"<p>{esc(text[0].upper() + text[1:])}.</p>\n" for text in texts)
    body = [[esc(question), *(cell(value) for value in values)] for question, *values in rows(section, joints)]
    note = (
        "<p>Now: probability of the first answer after the runs so far. Then the chance that a question is settled "
        "rightly, at odds of 19 to 1, by the motion after them.</p>\n"
    )
    return said + (table(list(HEAD), body, label="Open questions") + note if body else "")
