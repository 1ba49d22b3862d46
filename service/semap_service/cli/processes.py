"""semap up, work, serve"""

from __future__ import annotations

from typing import Annotated

import typer

from semap_service.cli.session import Dsn, database

Host = Annotated[
    str, typer.Option(help="Address to listen on. There are no passwords: keep it on this machine.")
]
Port = Annotated[int, typer.Option(help="Port to listen on.", min=1, max=65535)]

CHECK_S = 0.5
GRACE_S = 2


def up(host: Host = "127.0.0.1", port: Port = 8000, dsn: Dsn = None) -> None:
    """Run everything: PostGIS (semap's own, without --dsn), the rule worker and the service."""
    from semap_service.port import require_free  # noqa: PLC0415
    from semap_service.supervisor import Supervisor, stop_signal  # noqa: PLC0415

    require_free(host, port)
    stop = stop_signal()
    typer.echo("Starting the database ...")
    with database(dsn) as opened, Supervisor(opened) as supervisor:
        supervisor.start("work")
        supervisor.start("serve", "--host", host, "--port", str(port))
        typer.echo(f"semap is up: http://{host}:{port}/ (Ctrl-C stops it)")
        typer.echo("Next, in another terminal:")
        typer.echo("  semap map import BUILDING.geojson")
        typer.echo("  semap ingest tracks TRACKS.csv --map BUILDING")
        typer.echo("  semap events --follow")
        while not stop.wait(CHECK_S):
            supervisor.check()
            if dsn is None:
                revive_server()
        typer.echo("Stopping ...")


def revive_server() -> None:
    """Start semap's own server again where it has died."""
    from semap.cluster import Cluster, default_home, lease  # noqa: PLC0415

    if not Cluster(default_home()).is_running():
        typer.echo("The database server died; it is started again.", err=True)
        with lease(default_home()):
            pass


def work(dsn: Dsn = None) -> None:
    """Run the rule worker: it reads changes of relations off the log and writes events.

    One worker reads at a time; a second one waits and takes over.
    """
    from semap.worker.rule_worker import work as follow  # noqa: PLC0415
    from semap_service.supervisor import stop_signal  # noqa: PLC0415

    stop = stop_signal()
    with database(dsn) as opened:
        follow(opened, stop)


def serve(host: Host = "127.0.0.1", port: Port = 8000, dsn: Dsn = None) -> None:
    """Run the service: REST and WebSocket over HTTP."""
    import uvicorn  # noqa: PLC0415

    from semap_service.app import create_app  # noqa: PLC0415
    from semap_service.port import require_free  # noqa: PLC0415
    from semap_service.supervisor import stop_signal  # noqa: PLC0415

    require_free(host, port)
    with database(dsn) as opened:
        stop_signal()
        uvicorn.run(
            create_app(opened),
            host=host,
            port=port,
            log_level="warning",
            access_log=False,
            timeout_graceful_shutdown=GRACE_S,
        )
