"""Requests that mean no good, made from /openapi.json: for each operation, each parameter and body."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

ENDLESS = frozenset({"stream_events"})
"""What does not end by itself."""

DESTROYS = frozenset({"delete"})

KNOWN = {
    "name": "office", "map": "office", "id": "1", "collectionId": "office.instances",
    "featureId": "1", "operator": "near_objects", "grid": "g", "geometry": "Body", "type": "Position2D",
    "dead_letter_id": "1", "tGeometryId": "1", "quantity": "velocity", "tPropertyName": "speed",
    "at": "2026-01-31T12:00:00Z", "from": "1", "to": "2", "target": "map", "source": "map",
}  # fmt: skip
"""Values that lead to something where the benchmark has put it."""

LONG = 14_000
TEXTS = {
    "parentheses": "(" * LONG,
    "nots": "NOT " * (LONG // 8),
    "and_or": "a=1 AND b=2 OR " * (LONG // 24) + "a=1",
    "filter": " OR ".join(f"type LIKE '%{n}%a%b%c'" for n in range(220)),
    "digits": "9" * LONG,
    "letters": "a" * LONG,
    "letters_of_others": "é" * (LONG // 6),
    "commas": "0," * (LONG // 2),
    "quotes": "'" * (LONG // 3),
    "brackets": "[" * (LONG // 3),
    "objects": '{"a":' * (LONG // 12),
    "stamp": f"2026-01-31T12:00:00.{'0' * LONG}Z",
    "slashes": "../" * (LONG // 3),
    "nothing": "\0",
    "spaces": " " * (LONG // 3),
    "infinite": "1e400",
    "negative": "-1",
}

HEADERS = {
    "If-None-Match": ['"', '"a", ' * 5000, "W/" * 14000],
    "If-Match": ['"a-gzip", ' * 2500],
    "Accept-Encoding": ["gzip;q=0," * 3000, "," + " " * 28000, "gzip" + " " * 28000 + "x"],
    "Accept": ["a/b;q=0.1," * 2500],
    "Prefer": ["respond-async" + " " * 28000, ";" * 28000],
    "Range": ["bytes=" + ",".join(f"{n}-{n}" for n in range(5000))],
    "Content-Type": ["application/json;" + "a=b;" * 6000, "multipart/form-data; boundary=" + "-" * 20000],
    "Cookie": ["a=b; " * 5000],
    "X-Request-Id": ["x" * 28000],
    "Forwarded": ["for=" + "[" * 20000],
    "X-Forwarded-For": ["1.1.1.1," * 3000],
    "Semap-Message": ["é" * 14000],
    "Authorization": ["Bearer " + "x" * 28000],
}


@dataclass(frozen=True)
class Attack:
    """One request: what it is called, and what is sent.

    is_file  it brings a file, which the service may give to a process of its own
    """

    operation: str
    means: str
    method: str
    target: str
    headers: Mapping[str, str]
    body: bytes = b""
    is_file: bool = False


def attacks(described: Mapping[str, Any], body_bytes: int) -> Iterator[Attack]:
    """Every attack on every operation that ends.

    body_bytes  about so long are large bodies of JSON
    """
    bodies = dict(json_bodies(body_bytes))
    for path, operations in described["paths"].items():
        for method, operation in operations.items():
            if operation["operationId"] not in ENDLESS:
                yield from _attacks(described, path, method, operation, bodies)
    yield Attack("none", "method", "PATCH", "/health", {})
    yield Attack("none", "path", "GET", "/" + "a/" * 7000, {})


def json_bodies(size: int) -> Iterator[tuple[str, str]]:
    """Values as JSON, each about so long."""
    yield "many_keys", "{" + ",".join(f'"{n:x}":1' for n in range(size // 9)) + "}"
    yield "many_numbers", "[" + ",".join(["0"] * (size // 2)) + "]"
    yield "many_texts", "[" + ",".join(['"a"'] * (size // 4)) + "]"
    yield "many_lists", "[" + ",".join(["[]"] * (size // 3)) + "]"
    yield "many_objects", "[" + ",".join(['{"a":0}'] * (size // 8)) + "]"
    yield "places", "[[" + ",".join(["[0,1]"] * (size // 6)) + "]]"
    yield "floats", "[" + ",".join(["1.25e-7"] * (size // 8)) + "]"
    yield "large_numbers", "[" + ",".join(["9" * 4299] * (size // 4300)) + "]"
    yield "one_number", "9" * size
    yield "one_text", '"' + "a" * (size - 2) + '"'
    yield "one_text_of_others", '"' + "\\ud83d\\ude00" * (size // 12) + '"'
    yield "one_text_of_lines", '"' + "a:\\n" * (size // 4) + '"'
    yield "one_text_of_brackets", '"' + "[" * (size - 2) + '"'
    yield "one_text_of_anchors", '"' + "- &a b\\n" * (size // 8) + '"'
    yield "nested_lists", "[" * (size // 2) + "]" * (size // 2)
    yield "nested_objects", '{"a":' * (size // 6) + "0" + "}" * (size // 6)
    yield "nested_a_little", ",".join(["[" * 90 + "]" * 90] * (size // 181)).join("[]")


def _attacks(
    described: Mapping[str, Any],
    path: str,
    method: str,
    operation: Mapping[str, Any],
    bodies: Mapping[str, str],
) -> Iterator[Attack]:
    name, verb = operation["operationId"], method.upper()
    parameters = list(operation.get("parameters", ()))
    plain = _filled(path, {})
    content = operation.get("requestBody", {}).get("content", {})
    if method not in DESTROYS and not content:
        yield Attack(name, "as it is", verb, plain + _needed(parameters), {})
    for each in parameters:
        for title, text in TEXTS.items():
            written = quote(text, safe="")[: 15 * 1024].rsplit("%", 1)[0] or "a"
            if each["in"] == "path":
                target = _filled(path, {each["name"]: written}) + _needed(parameters)
                yield Attack(name, f"{each['name']}: {title}", verb, target, {})
            elif each["in"] == "query" and method not in DESTROYS:
                others = _needed([p for p in parameters if p is not each])
                joint = "&" if others else "?"
                yield Attack(
                    name,
                    f"{each['name']}: {title}",
                    verb,
                    f"{plain}{others}{joint}{each['name']}={written}",
                    {},
                )
    if method in DESTROYS:
        return
    for header, values in HEADERS.items():
        for number, value in enumerate(values):
            sent = {header: value.encode().decode("latin-1")}
            yield Attack(
                name, f"{header} {number}", verb, plain + _needed(parameters), sent, b"{}" if content else b""
            )
    if "application/json" in content:
        schema = _resolved(described, content["application/json"]["schema"])
        for means, text in _documents(described, schema, bodies):
            yield Attack(name, means, verb, plain, {"Content-Type": "application/json"}, text.encode())
    elif content:
        schema = _resolved(described, content["multipart/form-data"]["schema"])
        yield from _forms(name, verb, plain, schema, bodies)


def _documents(
    described: Mapping[str, Any], schema: Mapping[str, Any], bodies: Mapping[str, str]
) -> Iterator[tuple[str, str]]:
    """Each value in place of the document, and of each member of it and of those."""
    for title, text in bodies.items():
        yield title, text
    for name, member in schema.get("properties", {}).items():
        inner = _resolved(described, member).get("properties", {})
        for title, text in bodies.items():
            yield (
                f"{name}: {title}",
                json.dumps(_least(described, schema, but=name))[:-1] + f',"{name}":{text}}}',
            )
        for inside in inner:
            for title, text in bodies.items():
                yield f"{name}.{inside}: {title}", f'{{"{name}":{{"{inside}":{text}}}}}'


def _forms(
    name: str, verb: str, target: str, schema: Mapping[str, Any], bodies: Mapping[str, str]
) -> Iterator[Attack]:
    def form(means: str, parts: list[tuple[str, str | None, bytes]]) -> Attack:
        sent = b"".join(
            b'--x\r\nContent-Disposition: form-data; name="%b"%b\r\n\r\n%b\r\n'
            % (field.encode(), b'; filename="%b"' % file.encode() if file else b"", data)
            for field, file, data in parts
        )
        return Attack(
            name,
            means,
            verb,
            target,
            {"Content-Type": "multipart/form-data; boundary=x"},
            sent + b"--x--\r\n",
            any(file for _, file, _ in parts),
        )

    fields = list(schema.get("properties", {}))
    files = [field for field in fields if field in ("file", "mesh", "image", "yaml")]
    for field in fields:
        if field not in files:
            for title, text in bodies.items():
                yield form(f"{field}: {title}", [(field, None, text.encode())])
    yield form("many fields", [(f"f{n}", None, b"") for n in range(20_000)])
    yield form("many files", [(f"f{n}", "a", b"") for n in range(20_000)])
    yield form("short lines", [((files or fields)[0], "a.obj", b"\n" * 8_000_000)])
    for file in files:
        for title, text in bodies.items():
            repeated = text.encode()
            for suffix in ("geojson", "yaml", "ndjson", "gltf"):
                if title != "one_number" or suffix != "yaml":
                    yield form(f"{file}.{suffix}: {title}", [(file, f"a.{suffix}", repeated)])


def _filled(path: str, values: Mapping[str, str]) -> str:
    for part in path.split("/"):
        if part.startswith("{"):
            path = path.replace(part, values.get(part[1:-1], KNOWN.get(part[1:-1], "1")))
    return path


def _needed(parameters: list[Mapping[str, Any]]) -> str:
    needed = [
        f"{each['name']}={quote(KNOWN.get(each['name'], '1'))}"
        for each in parameters
        if each["in"] == "query" and each.get("required")
    ]
    return "?" + "&".join(needed) if needed else ""


def _resolved(described: Mapping[str, Any], schema: Mapping[str, Any]) -> Mapping[str, Any]:
    """A schema of an object, found through references and alternatives."""
    if "$ref" in schema:
        return _resolved(described, described["components"]["schemas"][schema["$ref"].rsplit("/", 1)[1]])
    for each in schema.get("anyOf", schema.get("oneOf", ())):
        found = _resolved(described, each)
        if "properties" in found:
            return found
    return schema


def _least(described: Mapping[str, Any], schema: Mapping[str, Any], but: str) -> dict[str, Any]:
    """The members that a document must have, but one; never empty."""
    least = {name: _value(described, schema["properties"][name]) for name in schema.get("required", ())}
    least.pop(but, None)
    return least or {"": 0}


def _value(described: Mapping[str, Any], schema: Mapping[str, Any]) -> Any:
    for named in ("examples",):
        if schema.get(named):
            return schema[named][0]
    found = _resolved(described, schema)
    if "properties" in found:
        return {name: _value(described, found["properties"][name]) for name in found.get("required", ())}
    return {"integer": 1, "number": 1.0, "boolean": True, "array": [], "object": {}}.get(
        found.get("type", ""), "office"
    )
