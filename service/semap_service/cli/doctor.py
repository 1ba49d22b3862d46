"""semap doctor"""

from __future__ import annotations

import sys
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from semap_service.cli.output import print_json, say, visible
from semap_service.cli.session import AsJson, Dsn, database

if TYPE_CHECKING:
    from semap.store.operate.doctor.verification import Verification, Verified

Verify = Annotated[
    bool,
    typer.Option("--verify", help="Recompute all relations and compare them with the stored ones."),
]
OneMap = Annotated[
    str | None, typer.Option("--map", metavar="MAP", show_default=False, help="With --verify: only this map.")
]
Repair = Annotated[
    bool, typer.Option("--repair", help="With --verify: correct differences, while writers wait.")
]


def doctor(
    verify: Verify = False,
    map_name: OneMap = None,
    repair: Repair = False,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Check the database, the flow of events and this machine, with a remedy for each problem.

    Each check is ok, warn (it works, but needs attention) or wrong. Nothing is changed. The exit status is 1
    if any check is wrong.

    With --verify, it recomputes all relations from maps, queries and states, and compares them with the
    stored ones. Writers continue meanwhile. With --repair as well, differences are corrected, and logged as
    changes.
    """
    if (repair and not verify) or (map_name is not None and not verify):
        raise typer.BadParameter("--map and --repair go with --verify.")
    if verify:
        _verify(dsn, map_name, repair, as_json)
    else:
        _examine(dsn, as_json)


def _examine(dsn: str | None, as_json: bool) -> None:
    from semap.store.operate.doctor.finding import Level  # noqa: PLC0415
    from semap_service.operations.doctor.examination import examine_all  # noqa: PLC0415

    is_wrong = False
    findings = []
    for finding in examine_all(dsn):
        is_wrong |= finding.level == Level.WRONG
        findings.append(asdict(finding))
        if not as_json:
            say(f"{finding.level:<5}  {finding.check:<12}  {finding.message}")
            for line in finding.remedy.splitlines():
                say(f"{'':<21}-> {line}")
    if as_json:
        print_json({"ok": not is_wrong, "findings": findings})
    if is_wrong:
        raise typer.Exit(1)


def _verify(dsn: str | None, map_name: str | None, repair: bool, as_json: bool) -> None:
    from semap.store.operate.doctor.verification import verify  # noqa: PLC0415

    is_seen = sys.stderr.isatty() and not as_json

    def progress(said: str) -> None:
        if is_seen:
            typer.echo(f"\r\033[K{visible(said)} ...\r", nl=False, err=True)

    with database(dsn, map_name) as own:
        verification = verify(own, progress)
        with verification.connection:
            found = _look(verification, map_name, as_json)
            said: dict[str, Any] = {"verified": [asdict(each) for each in found]}
            if repair and verification.differing:
                repaired = list(verification.repair())
                said["repaired"] = [asdict(each) for each in repaired]
                for each in repaired:
                    if not as_json:
                        say(f"repaired  {each.map_name}: {each.crossings} relations began or ended by it")
                found = _look(verification, map_name, as_json)
                said["verified_again"] = [asdict(each) for each in found]
    is_wrong = any(each.differ for each in found)
    if as_json:
        print_json({"ok": not is_wrong, **said})
    elif verification.differing and not repair:
        say("-> Make what differs anew: semap doctor --verify --repair")
    if is_wrong:
        raise typer.Exit(1)


def _look(verification: Verification, map_name: str | None, as_json: bool) -> list[Verified]:
    found = []
    for each in verification.look(map_name):
        found.append(each)
        if as_json:
            continue
        level = "wrong" if each.differ else "ok"
        note = f" ({each.note})" if each.note else ""
        say(f"{level:<5}  {each.map_name}  {each.what}: {each.rows} looked at, {each.differ} differ{note}")
        for thing, stored, wanted in each.examples:
            say(f"{'':<7}{thing}: stored is {stored}; it should be {wanted}")
    return found
