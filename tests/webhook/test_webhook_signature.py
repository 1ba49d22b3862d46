"""Messages are signed so that the official library verifies them."""

import json
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from semap_service.webhooks.signature import new_secret, shown, signed_headers
from standardwebhooks.webhooks import Webhook, WebhookVerificationError

OWN, OTHER = new_secret(), new_secret()


@given(st.text(max_size=200), st.uuids())
def test_the_official_library_verifies_a_message(text: str, id_: object) -> None:
    body = json.dumps({"said": text}, ensure_ascii=False).encode(errors="replace")
    headers = signed_headers(str(id_), int(time.time()), body, [OWN])
    assert Webhook(shown(OWN)).verify(body, headers) == json.loads(body)
    with pytest.raises(WebhookVerificationError):
        Webhook(shown(OTHER)).verify(body, headers)
    with pytest.raises(WebhookVerificationError):
        Webhook(shown(OWN)).verify(body + b" ", headers)
    with pytest.raises(WebhookVerificationError):
        Webhook(shown(OWN)).verify(body, {**headers, "webhook-id": "other"})


def test_while_a_secret_is_replaced_both_verify() -> None:
    headers = signed_headers("a", int(time.time()), b"{}", [OWN, OTHER])
    for secret in (OWN, OTHER):
        Webhook(shown(secret)).verify(b"{}", headers)
    assert len({new_secret() for _ in range(100)}) == 100
