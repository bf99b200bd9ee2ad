"""No formula in lanes is compiled without the registers of its path: there every instruction would be a call."""

import platform
import re
import shutil
import subprocess

import pytest

from dynid_rs import _core

FEW = 20
"""Calls of single instructions in one function: arguments that are nowhere near any motion take a way of their own, and
what is done once per run may."""

needs_objdump = pytest.mark.skipif(
    platform.machine() != "x86_64" or shutil.which("objdump") is None,
    reason="lanes of x86-64 are looked at, with objdump (apt install binutils)",
)


@needs_objdump
def test_instructions_on_lanes_are_no_calls():
    """Friction handed on as a function took about ten times as long as now, to the same bits."""
    program = ["objdump", "--disassemble", "--demangle", "--no-show-raw-insn", _core.__file__]
    calls, functions, inside = {}, 0, ""
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as listing:
        for line in listing.stdout:
            if line.endswith(">:\n"):
                inside, functions = line.strip(), functions + 1
            elif re.search(r"\bcallq?\b.*<core::core_arch::", line):
                calls[inside] = calls.get(inside, 0) + 1
    assert listing.returncode == 0
    assert functions > 1000, "the module has no symbols"
    assert {name: count for name, count in calls.items() if count > FEW} == {}
