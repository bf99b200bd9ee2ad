"""Sensors and clocks first: channels, contacts, delays and gains are looked for before any physics.

A channel that is not what it is called stops here. A torque channel on another clock is put on the encoders'; what
something from outside did is neither fitted nor scored. Both are corrected in the `Setup`, and said.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dynid_rs.diagnosis.sensors.beside import Beside
from dynid_rs.diagnosis.sensors.channels import channel_findings
from dynid_rs.diagnosis.sensors.clocks import TorqueDelay, choose_delay, delay_parts, measure_delay, moved_delay
from dynid_rs.diagnosis.sensors.contact import Contact, find_contacts, windows_of
from dynid_rs.diagnosis.sensors.gains import gain_findings, torque_gains
from dynid_rs.diagnosis.sensors.messages import contact_findings, delay_entries, delay_findings, encoder_entries
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.findings import Finding
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.preprocessing import choose_band, common_rate, prepare
from dynid_rs.recording import Recording
from dynid_rs.training import prepare_training_runs

__all__ = [
    "Contact",
    "TorqueDelay",
    "channel_errors",
    "channel_findings",
    "choose_delay",
    "delay_parts",
    "examine",
    "find_contacts",
    "gain_findings",
    "measure_delay",
    "moved_delay",
    "torque_gains",
    "windows_of",
]

N_SEARCHES = 3
"""Searches for contact, each with what the one before found taken out of the fit."""
N_REFITS = 2
"""Fits after a delay was found; each brings it ten times closer."""
SETTLED = 0.3
"""A delay that moves by less than this part of its standard error is found."""


def examine(
    setup: Setup,
    train: Sequence[Recording],
    test: Sequence[Recording] = (),
    on_progress: Callable[[str], None] = lambda step: None,
    *,
    of_one: bool = True,
) -> tuple[Setup, list[Finding], list[dict[str, Any]]]:
    """Look at sensors and clocks.

    Parameters
    ----------
    setup : Setup
        What is believed so far; effects that it has are fitted beside everything.
    train, test : sequence of Recording
        As recorded. Test runs are searched for contact only, so that they are scored fairly; nothing is fitted to them.
    on_progress : callable
        Called with a few words before every step.
    of_one : bool
        Whether a single joint's torque channel may have a clock of its own.

    Returns
    -------
    setup : Setup
        With the torque channel's delay and the excluded windows. As it was where a finding is an error: with a channel
        that is not what it is called, nothing else can be said.
    findings : list of Finding
        Errors first, then contacts, delays and gains.
    entries : list of dict
        For the list of effects: `kind` "torque_delay" or "encoder_delay", `joints` (indices), `value`, `std_error` [s],
        `interval` (95 %), `p_value`, `significant`.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1, user_api="blas"):
        on_progress("channels")
        errors = channel_errors(setup, train, thorough=False)
        on_progress("contacts")
        if errors:
            # A hard push may look like anything: with it taken out, the channels are asked again.
            errors = _still_wrong(setup, train)
        if errors:
            return setup, errors, []
        declared = setup
        fit, setup, contacts = _without_contacts(declared, train, test)
        on_progress("clocks")
        beside = Beside(fit)
        delay = choose_delay(delay_parts(fit, beside), of_one=of_one)
        for _ in range(N_REFITS if delay.places else 0):
            # What looked like contact may have been the delay: searched for anew.
            late = replace(declared, torque_delay=declared.torque_delay + delay.per_joint)
            fit, setup, contacts = _without_contacts(late, train, test)
            beside = Beside(fit)
            step = measure_delay(delay_parts(fit, beside), delay.places)
            delay = moved_delay(delay, step)
            setup = replace(setup, torque_delay=declared.torque_delay + delay.per_joint)
            if np.all(np.abs(step.per_joint) < SETTLED * np.max(step.std_error)):
                break
        on_progress("gains")
        findings = [
            *contact_findings(contacts, [*train, *test]),
            *delay_findings(setup.robot, delay, two_encoders=fit.encoder_delay_ is not None),
            *gain_findings(fit, beside),
        ]
    return setup, findings, [*delay_entries(delay), *encoder_entries(fit.encoder_delay_)]


def channel_errors(setup: Setup, train: Sequence[Recording], *, thorough: bool = True) -> list[Finding]:
    """Channels that are not what they are called; `thorough`: the cause is searched for."""
    recordings = [setup.corrected(recording) for recording in train]
    runs = prepare_training_runs(recordings, choose_band(recordings), common_rate(recordings), setup.excluded)
    findings = channel_findings(setup.robot, runs, recordings[0].torque_unit, thorough=thorough)
    return [finding for finding in findings if finding.severity == "error"]


def _still_wrong(setup: Setup, train: Sequence[Recording]) -> list[Finding]:
    """Errors that are left when what looks like contact is taken out, after a thorough search for their cause."""
    try:
        _, without, contacts = _without_contacts(setup, train, ())
        return channel_errors(without if contacts else setup, train, thorough=True)
    except ValueError:  # nothing can be fitted to such channels
        return channel_errors(setup, train, thorough=True)


def _without_contacts(
    setup: Setup, train: Sequence[Recording], test: Sequence[Recording]
) -> tuple[ThreeLoopIdentifier, Setup, list[Contact]]:
    """Fit the declared model, with windows in which something from outside acts taken out until no more are found."""
    runs = [setup.corrected(recording) for recording in train]
    fit = setup.identifier(residual=None).fit(runs)
    every = [prepare(recording, fit.band_, fit.rate_) for recording in [*runs, *map(setup.corrected, test)]]
    contacts: list[Contact] = []
    names = {recording.name for recording in runs}
    for _ in range(N_SEARCHES):
        contacts = find_contacts(fit, every)
        windows = windows_of(contacts, setup.excluded)
        if windows == setup.excluded:
            break
        refit = any(windows.get(name, ()) != setup.excluded.get(name, ()) for name in names)
        setup = replace(setup, excluded=windows)
        if not refit:
            break
        fit = setup.identifier(residual=None).fit(runs)
    return fit, setup, contacts
