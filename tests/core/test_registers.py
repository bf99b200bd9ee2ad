"""No formula in lanes is compiled without the registers of its path: there every instruction would be a call."""

import re
import shutil
import subprocess

import pytest

from dynid_rs import _core

FEW = 20
"""Calls of single instructions in one function: arguments that are nowhere near any motion take a way of their own, and
what is done once per run may."""

needs_objdump = pytest.mark.skipif(shutil.which("objdump") is None, reason="objdump is not here (apt install binutils)")


@needs_objdump
def test_instructions_on_lanes_are_no_calls():
    """Friction handed on as a function took eleven times as long as now, to the same bits."""
    program = ["objdump", "--disassemble", "--demangle", "--no-show-raw-insn", _core.__file__]
    calls, functions, inside = {}, 0, ""
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as listing:
        for line in listing.stdout:
            if line.endswith(">:\n"):
                inside, functions = line.strip(), functions + 1
            elif re.search(r"\bcall\b.*<core::core_arch::", line):
                calls[inside] = calls.get(inside, 0) + 1
    assert functions > 1000, "the module has no symbols"
    assert {name: count for name, count in calls.items() if count > FEW} == {}
