"""Secrets do not leave semap in what it says: passwords of DSNs, tokens, secrets of webhooks.

Whoever asks a service chooses some of the text, so that each pattern takes time in proportion to its length.
"""

from __future__ import annotations

import re

HIDDEN = "***"

SECRETS = (
    (re.compile(r"((?<![\w+.-])[\w+.-]{1,30}+://[^\s:/@]{0,100}+:)[^\s/]{0,500}(@)"), rf"\1{HIDDEN}\2"),
    (re.compile(r"((?<![^\s/@'\"])[^\s:/@'\"]{1,100}+:)[^\s/@'\"]{1,500}+(@[\w\[])"), rf"\1{HIDDEN}\2"),
    (re.compile(r"(\b(?:ssl)?password\s*=\s*)(?:'(?:[^'\\]|\\.)*'?|[^\s&'\"]+)", re.I), rf"\1{HIDDEN}"),
    (re.compile(r"(\bbearer[\s.]+)[^\s\"',]+", re.IGNORECASE), rf"\1{HIDDEN}"),
    (re.compile(r"\bsemap_[A-Za-z0-9_-]{30,}"), f"semap_{HIDDEN}"),
    (re.compile(r"\bwhsec_[A-Za-z0-9+/=_-]+"), f"whsec_{HIDDEN}"),
)


def redacted(text: str) -> str:
    """The text with each secret in it hidden."""
    for pattern, shown in SECRETS:
        text = pattern.sub(shown, text)
    return text
