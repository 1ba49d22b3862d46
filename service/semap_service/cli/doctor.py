"""semap doctor"""

from __future__ import annotations

from dataclasses import asdict

import typer

from semap_service.cli.output import print_json
from semap_service.cli.session import AsJson, Dsn


def doctor(as_json: AsJson = False, dsn: Dsn = None) -> None:
    """Look whether all is well: the database, the flow of events, this machine. Say what to do where not.

    Each check is ok, warn (it works, but look after it) or wrong. Nothing is changed. Exit status 1 where
    something is wrong.
    """
    from semap_service.operations.doctor.examination import examine_all  # noqa: PLC0415
    from semap_service.operations.doctor.finding import Level  # noqa: PLC0415

    is_wrong = False
    findings = []
    for finding in examine_all(dsn):
        is_wrong |= finding.level == Level.WRONG
        findings.append(asdict(finding))
        if not as_json:
            typer.echo(f"{finding.level:<5}  {finding.check:<12}  {finding.message}")
            for line in finding.remedy.splitlines():
                typer.echo(f"{'':<21}-> {line}")
    if as_json:
        print_json({"ok": not is_wrong, "findings": findings})
    if is_wrong:
        raise typer.Exit(1)
