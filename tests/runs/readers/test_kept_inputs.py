"""What a fuzzer kept for the readers in Python (`make fuzz-readers`) is read or refused in a sentence, without it."""

import importlib.util
from pathlib import Path

import pytest

FUZZ = Path(__file__).resolve().parents[3] / "fuzz"


def ways_in():
    spec = importlib.util.spec_from_file_location("ways_in", FUZZ / "python" / "ways_in.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.WAYS_IN


WAYS_IN = ways_in()


@pytest.mark.parametrize("way", WAYS_IN)
def test_kept_inputs(way):
    kept = sorted((FUZZ / "corpus" / way).iterdir())
    assert any(path.name.startswith("seed_") for path in kept)
    for path in kept:
        try:
            WAYS_IN[way](path.read_bytes())
        except Exception as error:
            raise AssertionError(f"{path.name}: {type(error).__name__}") from error


def test_what_is_no_refusal_is_found(monkeypatch):
    """The harness passes on whatever a reader should not raise, and a sentence that a terminal cannot show."""
    table = WAYS_IN["table"]
    reader = table.__globals__
    for wrong in (KeyError("t"), reader["DataError"]("a\x1b[2J")):

        def read(*_arguments, wrong=wrong):
            raise wrong

        monkeypatch.setitem(reader, "read_recordings", read)
        with pytest.raises((KeyError, AssertionError)):
            table(b"t,q_0\n")
