"""With tokens the page asks for one, says what it lacks, and keeps it out of the address."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, expect
from served import Office, Served


@pytest.fixture(scope="module")
def guarded(page_database: str) -> Iterator[Served]:
    """A service that asks for tokens."""
    running = Served(page_database, options=())
    try:
        yield running.start()
    finally:
        running.stop()


def token(dsn: str, name: str, *options: str) -> str:
    made = subprocess.run(
        [sys.executable, "-m", "semap_service", "token", "add", name, "--json", *options],
        env={**os.environ, "SEMAP_DSN": dsn},
        stdout=subprocess.PIPE,
        check=True,
    )
    found: str = json.loads(made.stdout)["token"]
    return found


def sign_in(page: Page, secret: str) -> None:
    page.get_by_role("dialog").get_by_label("Token").fill(secret)
    page.get_by_role("dialog").get_by_role("button", name="Sign in").click()


def test_sign_in(page: Page, guarded: Served, office: Office, fails_requests: None) -> None:
    page.goto(f"{guarded.url}/#map={office.name}")
    dialog = page.get_by_role("dialog", name="Sign in")
    expect(dialog).to_be_visible()
    sign_in(page, "semap_wrong")
    expect(dialog.get_by_role("alert")).to_be_visible()
    secret = token(guarded.dsn, "editor", "--scope", "read", "--scope", "write")
    sign_in(page, secret)
    page.wait_for_selector("#status[data-state=live]")
    page.locator("#tab-edit").click()
    page.locator("#stage").focus()
    page.keyboard.press("o")
    page.get_by_text("Place in metres").click()
    for label, value in (("x of the door", "9"), ("y of the door", "7.5"), ("Direction in degrees", "90")):
        page.get_by_label(label).fill(value)
    page.get_by_role("button", name="Make the door").click()
    expect(page.get_by_role("form", name="Edit Door 1")).to_be_visible()
    change = office.get(f"/maps/{office.name}/changes")["changes"][0]
    assert change["author"].endswith("(editor)"), "the history names the token"
    expect(page.get_by_role("button", name="Undo: make the Door Door 1")).to_be_enabled()
    assert secret not in page.url


def test_what_a_token_may_not_do_is_shown_as_not_allowed(
    page: Page, guarded: Served, office: Office, fails_requests: None
) -> None:
    page.goto(f"{guarded.url}/#map={office.name}")
    sign_in(page, token(guarded.dsn, "looker", "--scope", "read"))
    page.wait_for_selector("#status[data-state=live]")
    for tab, button in (("edit", "Draw a room"), ("queries", "Add"), ("import", "Choose files…")):
        page.locator(f"#tab-{tab}").click()
        panel = page.locator(f"#panel-{tab}")
        if tab == "queries":
            panel.get_by_text("Add a query").click()
        expect(panel.get_by_role("note")).to_contain_text(
            "not allowed with the token looker: sign in with one that has the scope write."
        )
        expect(panel.get_by_role("button", name=button, exact=True)).to_be_disabled()
    page.locator("#sign-in").click()
    sign_in(page, token(guarded.dsn, "keeper", "--scope", "write", "--map", office.name))
    expect(page.locator("#panel-import").get_by_role("note")).to_contain_text(
        "sign in with one for all maps."
    )
    page.get_by_label("A building goes into").select_option("shown")
    expect(page.get_by_role("button", name="Choose files…")).to_be_enabled()
    page.locator("#tab-edit").click()
    expect(page.get_by_role("button", name="Draw a room")).to_be_enabled()
    expect(page.locator("#panel-edit").get_by_role("note")).to_have_count(0)


def test_a_token_that_may_only_read_says_so(
    page: Page, guarded: Served, office: Office, fails_requests: None
) -> None:
    page.goto(f"{guarded.url}/#map={office.name}")
    sign_in(page, token(guarded.dsn, "reader", "--scope", "read"))
    page.wait_for_selector("#status[data-state=live]")
    page.locator("#tab-rules").click()
    page.get_by_role("button", name="Turn off room_visits").click()
    expect(page.locator("#panel-rules").get_by_role("alert")).to_contain_text("write")
    assert office.get("/rules", map=office.name)["rules"][0]["enabled"]
