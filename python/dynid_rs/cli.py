"""The command line: `dynid`."""

from __future__ import annotations

import typer

from dynid_rs.base.guide import DOCUMENTATION, page
from dynid_rs.commands._arguments import Command
from dynid_rs.commands._run import run_app
from dynid_rs.commands.cache import cache
from dynid_rs.commands.compare import compare
from dynid_rs.commands.contact import contact
from dynid_rs.commands.demo import demo
from dynid_rs.commands.diagnose import diagnose
from dynid_rs.commands.estimate import estimate
from dynid_rs.commands.excite import excite
from dynid_rs.commands.export import export
from dynid_rs.commands.fleet import fleet
from dynid_rs.commands.identify import identify
from dynid_rs.commands.init import init
from dynid_rs.commands.inspect import inspect
from dynid_rs.commands.payload import payload
from dynid_rs.commands.report import report
from dynid_rs.commands.simulate import simulate
from dynid_rs.commands.watch import watch

app = typer.Typer(
    help="Torque models of robot arms: identified from measured runs, run in the control loop.",
    epilog=f"Documentation: {DOCUMENTATION}",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
LOGS, FLEETS = f"\b\nLogs that are read:\n{page('how_to/logs')}", f"\b\nFleets:\n{page('how_to/fleet')}"
READ = dict.fromkeys((init, inspect, identify, diagnose, payload, watch, contact, estimate), LOGS) | {fleet: FLEETS}
"""What stands below the help of a command."""
for command in (
    demo,
    init,
    inspect,
    excite,
    identify,
    diagnose,
    compare,
    payload,
    watch,
    contact,
    estimate,
    export,
    simulate,
    report,
    fleet,
    cache,
):
    app.command(cls=Command, epilog=READ.get(command))(command)


def _version(value: bool) -> None:
    if value:
        from dynid_rs._core import __version__

        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _options(
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Print the version."),
) -> None:
    """Options of `dynid` itself."""


def main() -> None:
    """Entry point."""
    run_app(app)
