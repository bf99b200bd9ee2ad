"""Channels and contacts first: what is no model's matter.

A channel that is not what it is called ends the diagnosis. What something from outside did is neither fitted nor
scored. Clocks, gains and encoders are hypotheses like all others (`structural/`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from dynid_rs.base.findings import Finding
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.runs.preprocessing import prepare
from dynid_rs.runs.recording import Recording
from dynid_rs.sensors import Contact, channel_errors, find_contacts, windows_of
from dynid_rs.sensors.messages import contact_findings

N_SEARCHES = 3
"""Searches for contact, each with what the one before found taken out of the fit."""


def examine(
    setup: Setup,
    train: Sequence[Recording],
    test: Sequence[Recording] = (),
    on_progress: Callable[[str], None] = lambda step: None,
) -> tuple[Setup, ThreeLoopIdentifier | None, list[Finding]]:
    """Look at channels and contacts.

    Parameters
    ----------
    setup : Setup
        What is believed so far.
    train, test : sequence of Recording
        As recorded. Test runs are searched for contact only, so that they are scored fairly, and after the training
        runs are done with: nothing of them touches a fit.
    on_progress : callable
        Called with a few words before every step.

    Returns
    -------
    setup : Setup
        With the excluded windows. As it was where a finding is an error.
    fit : ThreeLoopIdentifier or None
        Of the declared model; None where a finding is an error.
    findings : list of Finding
        Errors; or warnings of channels, and contacts.
    """
    on_progress("channels")
    said = channel_errors(setup.robot, train, test)
    if any(finding.severity == "error" for finding in said):
        return setup, None, said
    on_progress("contacts")
    fit = setup.identifier(residual=None).fit(list(train))
    runs = [prepare(recording, fit.band_, fit.rate_) for recording in train]
    contacts: list[Contact] = []
    for _ in range(N_SEARCHES):
        contacts = find_contacts(fit, runs)
        windows = windows_of(contacts, setup.excluded)
        if windows == setup.excluded:
            break
        setup = replace(setup, excluded=windows)
        fit = setup.identifier(residual=None).fit(list(train))
    if test:
        unseen = find_contacts(fit, runs, [prepare(recording, fit.band_, fit.rate_) for recording in test])
        setup = replace(setup, excluded=windows_of(unseen, setup.excluded))
        contacts += unseen
    return setup, fit, [*said, *contact_findings(contacts, [*train, *test])]
