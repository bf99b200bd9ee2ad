"""What the library says of its parameters, in the options of `dynid excite`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

OPTIONS = {
    "n_harmonics": "--harmonics",
    "n_restarts": "--restarts",
    "max_iter": "--iterations",
    "time_limit": "--time-limit",
    "n_jobs": "--jobs",
    "random_state": "--seed",
    "noise_std": "--noise",
    "criterion": "--criterion",
    "duration": "--duration",
    "rate": "--criterion-rate",
}
"""Parameters of `FourierExcitation` and the options that set them."""
PHRASES = {
    "the rate of the trajectory": "--rate",
    "choose another start": "choose another --start",
    "choose a start": "choose a --start",
    "at least 0, or None": "at least 0",
    "allow more restarts": "raise --restarts",
    "or lower `slowest` or its velocity limit": "or lower its velocity limit",
}
"""What they do in plain words."""

_WORD = re.compile(rf"(?<![-\w])({'|'.join(OPTIONS)})(?![-\w])")


def in_options(text: str) -> str:
    """A sentence of the library with options in the place of parameters."""
    for words, option in PHRASES.items():
        text = text.replace(words, option)
    return _WORD.sub(lambda found: OPTIONS[found[1]], text)


@contextmanager
def options_named() -> Iterator[None]:
    """Refusals of the body name what was typed; those of files are what they are."""
    from dynid_rs.excitation.constraints import StartError

    try:
        yield
    except ValueError as error:
        if type(error) not in (ValueError, StartError):
            raise
        raise ValueError(in_options(str(error))) from None
