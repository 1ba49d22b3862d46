"""Home Assistant itself, by its own Python: its MQTT integration on a broker, asked over standard input.

python home_assistant_core.py PORT FOLDER    each line of input gets one line of output: all that it has, as JSON
"""

from __future__ import annotations

import asyncio
import json
import logging
import socket
import sys
from pathlib import Path

from homeassistant import bootstrap, config_entries, loader
from homeassistant.auth import auth_manager_from_config
from homeassistant.config_entries import ConfigEntry
from homeassistant.core import HomeAssistant
from homeassistant.helpers import device_registry
from homeassistant.setup import async_setup_component

WARNINGS: list[str] = []


class Keep(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        WARNINGS.append(record.getMessage())


async def start(port: int, folder: str) -> HomeAssistant:
    """Home Assistant with nothing but MQTT."""
    Path(folder, "configuration.yaml").touch()
    hass = HomeAssistant(folder)
    hass.config.skip_pip = True
    loader.async_setup(hass)
    hass.config_entries = config_entries.ConfigEntries(hass, {})
    await bootstrap.async_load_base_functionality(hass)
    hass.auth = await auth_manager_from_config(hass, [], [])
    await async_setup_component(hass, "homeassistant", {})
    with socket.create_server(("127.0.0.1", 0)) as free:
        http = {"http": {"server_host": "127.0.0.1", "server_port": free.getsockname()[1]}}
    await async_setup_component(hass, "http", http)
    entry = ConfigEntry(
        data={"broker": "127.0.0.1", "port": port},
        discovery_keys={},
        domain="mqtt",
        minor_version=2,
        options={},
        source="user",
        subentries_data=None,
        title="broker",
        unique_id=None,
        version=1,
    )
    await hass.config_entries.async_add(entry)
    await hass.async_start()
    return hass


def all_of(hass: HomeAssistant) -> str:
    states = {each.entity_id: {"state": each.state, **each.attributes} for each in hass.states.async_all()}
    devices = device_registry.async_get(hass).devices.values()
    return json.dumps(
        {"states": states, "devices": [each.name for each in devices], "warnings": WARNINGS}, default=str
    )


def say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


async def main(port: int, folder: str) -> None:
    logging.getLogger("homeassistant.components.mqtt").addHandler(Keep(logging.WARNING))
    hass = await start(port, folder)
    say(all_of(hass))
    while await asyncio.to_thread(sys.stdin.readline):
        say(all_of(hass))
    await hass.async_stop()


if __name__ == "__main__":
    asyncio.run(main(int(sys.argv[1]), sys.argv[2]))
