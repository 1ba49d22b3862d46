"""Selections, and filters in CQL2: what SQL selects is what a small evaluator in Python selects."""

from __future__ import annotations

import json
import math
import re
import unicodedata
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from uuid import UUID, uuid4

import cql2
import pytest
import shapely
from furnishing import House, box, room, thing
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely import Point, Polygon
from shapely.geometry import mapping
from sqlalchemy import text

from semap.cql2 import Array, Call, Expression, Instant, Interval, Literal, Property, Shape, parse
from semap.cql2.check import TEMPORAL
from semap.errors import InvalidInput
from semap.model.building import Item, Storey
from semap.model.pose import Pose
from semap.model.selection import Selection
from semap.store.database.connection import one_transaction
from semap.store.map.concept import Concept, change_concept, create_concept
from semap.store.map.selection import selected, selected_ids

START = datetime(2026, 1, 31, 12, tzinfo=UTC)
IRI = "https://brickschema.org/schema/Brick#Room"
ELL = Polygon([(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (0, 3)])
ATTRIBUTES: list[dict[str, object]] = [
    {"seats": 4, "floor": "oak", "open": True, "tags": ["a", "b"], "checked": "2026-01-31T12:00:00Z"},
    {"seats": 4.5, "floor": "Öak", "open": False, "tags": ["a"], "checked": "2026-02-30"},
    {"seats": "4", "floor": None, "open": "yes", "tags": "a", "deep": {"er": 2}},
    {"seats": 0, "floor": "tile_1", "tags": [], "deep": {"er": "x"}, "checked": "2026-02-01"},
    {"seats": -2, "floor": "tile%", "open": True, "tags": [1, "b", True]},
    {},
]
COLUMNS = "id, uid, name, alias, concept, storey, attributes, created_at, updated_at, footprint, position"
CONCEPTS = ("Room", "Kitchen", "Chair", "Thing", "Room", "Storey")


@pytest.fixture(scope="module")
def furnished(cluster, template) -> Iterator[House]:
    """A house that is only looked at."""
    from server import fresh_database  # noqa: PLC0415

    with fresh_database(cluster, template) as dsn, one_transaction(dsn, "semap_api") as connection:
        create_concept(connection, Concept(0, "Kitchen", ("Room",)))
        house = House(connection)
        shapes = (ELL, shapely.box(4, 0, 8, 3), None, shapely.box(1, 1, 3, 3), shapely.box(20, 20, 21, 21))
        for n, attributes in enumerate(ATTRIBUTES):
            area = shapes[n] if n < len(shapes) else None
            house.put(
                Item(
                    uuid4(),
                    f"thing {n}",
                    CONCEPTS[n] if n < 5 else "Thing",
                    alias=[None, "Büro", "buero", "A_b", "100%"][n % 5],
                    footprint=area,
                    attributes=attributes,
                    storey="first" if n == 3 else None,
                ),
                storeys=(Storey(uuid4(), "first", 3),) if n == 0 else (),
            )
            connection.execute(
                text("update semap.instance set created_at = :stamp where name = :name"),
                {"stamp": START + timedelta(days=n), "name": f"thing {n}"},
            )
        yield house


def things(house: House) -> list[dict[str, object]]:
    """The instances as the evaluator sees them."""
    rows = house.rows(
        "select i.instance_id, i.uid, i.name, i.alias, c.name, s.name, i.attributes, i.created_at, i.updated_at,"
        " public.st_asbinary(f.geometry), public.st_asbinary(p.geometry)"
        " from semap.instance i join semap.concept c using (concept_id)"
        " left join semap.instance s on s.instance_id = i.storey_id"
        " left join semap.abstraction f on f.instance_id = i.instance_id and f.type = 'Footprint'"
        " left join semap.abstraction p on p.instance_id = i.instance_id and p.type = 'Position2D'"
        " order by i.instance_id"
    )
    names = [column.strip() for column in COLUMNS.split(",")]
    found = [dict(zip(names, row, strict=True)) for row in rows]
    for each in found:
        each["uid"] = str(each["uid"])
        for shape in ("footprint", "position"):
            each[shape] = None if each[shape] is None else shapely.from_wkb(bytes(each[shape]))
    return found


class Evaluator:
    """CQL2 over one instance; None is unknown."""

    def __init__(self, thing: dict[str, object]) -> None:
        self.thing = thing

    def holds(self, part: Expression) -> bool | None:
        value = self.value(part)
        return value if isinstance(value, bool) else None

    def property(self, name: str) -> object:
        if name in self.thing:
            return self.thing[name]
        value: object = self.thing
        for key in name.split("."):
            value = value.get(key) if isinstance(value, dict) else None
        return value

    def value(self, part: Expression) -> object:
        match part:
            case Property(name=name):
                return self.property(name)
            case Literal(value=value):
                return value
            case Instant(stamp=stamp):
                return stamp
            case Shape(geometry=geometry):
                return geometry
            case Array(items=items):
                return [self.value(each) for each in items]
            case Interval(start=start, end=end):
                ends = (datetime.min.replace(tzinfo=UTC), datetime.max.replace(tzinfo=UTC))
                return tuple(
                    open_end if each is None else self.instant(each)
                    for each, open_end in zip((start, end), ends, strict=True)
                )
            case Call(op="and", args=args):
                found = [self.holds(each) for each in args]
                return False if False in found else None if None in found else True
            case Call(op="or", args=args):
                found = [self.holds(each) for each in args]
                return True if True in found else None if None in found else False
            case Call(op="not", args=(inner,)):
                found = self.holds(inner)
                return None if found is None else not found
            case Call(op="isNull", args=(inner,)):
                return self.value(inner) is None
            case Call(op="isA", args=(Literal(value=concept),)):
                above = {"Kitchen": {"Kitchen", "Room", "Space", "Thing"}, "Room": {"Room", "Space", "Thing"}}
                return concept in above.get(
                    self.thing["concept"],
                    {
                        self.thing["concept"],
                        "Thing",
                        *({"Space"} if self.thing["concept"] == "Storey" else ()),
                    },
                )
            case Call(op="between", args=(inner, low, high)):
                return self.value(Call("and", (Call(">=", (inner, low)), Call("<=", (inner, high)))))
            case Call(op="in", args=(inner, Array(items=items))):
                found = [self.compared("=", inner, each) for each in items]
                return True if True in found else None if None in found else False
            case Call(op=op, args=args):
                return self.call(op, args)

    def call(self, op: str, args: tuple[Expression, ...]) -> object:
        if op in ("casei", "accenti"):
            value = self.value(args[0])
            if not isinstance(value, str):
                return None
            if op == "casei":
                return value.lower()
            return "".join(c for c in unicodedata.normalize("NFD", value) if not "\u0300" <= c <= "\u036f")
        if op == "like":
            value, pattern = self.value(args[0]), self.value(args[1])
            return (
                re.fullmatch(_as_regex(pattern), value, re.DOTALL) is not None
                if isinstance(value, str)
                else None
            )
        if op in ("=", "<>", "<", "<=", ">", ">="):
            return self.compared(op, *args)
        if op in ("+", "-", "*", "/", "div", "%", "^"):
            a, b = (self.value(each) for each in args)
            return _arithmetic(op, a, b) if _is_number(a) and _is_number(b) else None
        if op.startswith("s_"):
            a, b = (self.value(each) for each in args)
            return None if a is None or b is None else bool(getattr(shapely, op.removeprefix("s_"))(a, b))
        if op.startswith("t_"):
            a, b = (self.span(each) for each in args)
            return None if None in (*a, *b) else _temporal(op, a, b)
        a, b = (self.value(each) for each in args)
        if not isinstance(a, list) or not isinstance(b, list):
            return None
        left, right = ({(type(x) is bool, x) for x in each} for each in (a, b))
        return {
            "a_contains": left >= right,
            "a_containedBy": left <= right,
            "a_equals": left == right,
            "a_overlaps": bool(left & right),
        }[op]

    def instant(self, part: Expression) -> datetime | None:
        value = self.value(part)
        if isinstance(value, str):
            try:
                value = datetime.fromisoformat(value)
            except ValueError:
                return None
            return value if value.tzinfo else value.replace(tzinfo=UTC)
        return value if isinstance(value, datetime) else None

    def span(self, part: Expression) -> tuple[datetime | None, datetime | None]:
        return self.value(part) if isinstance(part, Interval) else (self.instant(part),) * 2

    def compared(self, op: str, a: Expression, b: Expression) -> bool | None:
        left, right = self.value(a), self.value(b)
        if isinstance(left, datetime) or isinstance(right, datetime):
            left, right = self.instant(a), self.instant(b)
        alike = (
            left is not None
            and right is not None
            and (type(left) is type(right) or (_is_number(left) and _is_number(right)))
        )
        if not alike or (op not in ("=", "<>") and isinstance(left, bool | list | dict)):
            return None
        return {
            "=": lambda: left == right,
            "<>": lambda: left != right,
            "<": lambda: left < right,
            "<=": lambda: left <= right,
            ">": lambda: left > right,
            ">=": lambda: left >= right,
        }[op]()


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _as_regex(pattern: str) -> str:
    found, escaped = "", False
    for character in pattern:
        if escaped or character not in "%_\\":
            found, escaped = found + re.escape(character), False
        elif character == "\\":
            escaped = True
        else:
            found += ".*" if character == "%" else "."
    return found


def _arithmetic(op: str, a: float, b: float) -> float | None:
    if op in ("/", "div", "%") and b == 0:
        return None
    if op == "^" and ((a == 0 and b < 0) or (a < 0 and b != math.trunc(b))):
        return None
    return {
        "+": lambda: a + b,
        "-": lambda: a - b,
        "*": lambda: a * b,
        "/": lambda: a / b,
        "div": lambda: float(math.trunc(a / b)),
        "%": lambda: a - b * math.trunc(a / b),
        "^": lambda: float(a) ** b,
    }[op]()


def _temporal(op: str, a: tuple, b: tuple) -> bool:
    return {
        "t_after": a[0] > b[1],
        "t_before": a[1] < b[0],
        "t_contains": a[0] < b[0] and b[1] < a[1],
        "t_disjoint": a[1] < b[0] or b[1] < a[0],
        "t_during": b[0] < a[0] and a[1] < b[1],
        "t_equals": a == b,
        "t_finishedBy": a[0] < b[0] and a[1] == b[1],
        "t_finishes": b[0] < a[0] and a[1] == b[1],
        "t_intersects": not (a[1] < b[0] or b[1] < a[0]),
        "t_meets": a[1] == b[0],
        "t_metBy": a[0] == b[1],
        "t_overlappedBy": b[0] < a[0] < b[1] < a[1],
        "t_overlaps": a[0] < b[0] < a[1] < b[1],
        "t_startedBy": a[0] == b[0] and b[1] < a[1],
        "t_starts": a[0] == b[0] and a[1] < b[1],
    }[op]


def call(op: str, *args: st.SearchStrategy) -> st.SearchStrategy:
    return st.tuples(*args).map(lambda parts: {"op": op, "args": list(parts)})


def property_of(*names: str) -> st.SearchStrategy:
    return st.sampled_from(names).map(lambda name: {"property": name})


ANY = property_of(
    "attributes.seats", "attributes.floor", "attributes.open", "attributes.deep.er", "attributes.tags"
)
NUMBERS = st.recursive(
    st.one_of(
        st.sampled_from([-2, 0, 1, 2, 4, 4.5]), property_of("id", "attributes.seats", "attributes.deep.er")
    ),
    lambda inner: st.sampled_from(["+", "-", "*", "/", "div", "%", "^"]).flatmap(
        lambda op: call(op, inner, inner)
    ),
    max_leaves=3,
)
PLAIN_TEXTS = st.sampled_from(["oak", "Öak", "thing 1", "Room", "Büro", "buero", "A_b", "x", "it's", ""])
TEXTS = st.recursive(
    st.one_of(PLAIN_TEXTS, property_of("name", "alias", "concept", "uid", "storey", "attributes.floor")),
    lambda inner: st.sampled_from(["casei", "accenti"]).flatmap(lambda op: call(op, inner)),
    max_leaves=2,
)
PATTERNS = st.sampled_from(["%", "thing _", "%a%", "tile\\%", "tile\\_1", "", "A\\_b", "_ak", "b%o"])
STAMPS = st.integers(-1, 6).map(lambda n: START + timedelta(days=n))
INSTANTS = st.one_of(
    STAMPS.map(lambda stamp: {"timestamp": stamp.isoformat()}),
    STAMPS.map(lambda stamp: {"date": stamp.date().isoformat()}),
    property_of("created_at", "attributes.checked"),
)
SPANS = st.one_of(
    INSTANTS,
    st.tuples(st.integers(-1, 3), st.integers(0, 3)).map(
        lambda n: {"interval": [(START + timedelta(days=d)).isoformat() for d in (n[0], n[0] + n[1])]}
    ),
    STAMPS.map(lambda stamp: {"interval": ["..", stamp.isoformat()]}),
    STAMPS.map(lambda stamp: {"interval": [{"property": "created_at"}, ".."]}),
)
SHAPES = st.one_of(
    property_of("footprint", "position"),
    st.sampled_from(
        [mapping(ELL), mapping(Point(4, 1)), mapping(shapely.box(1, 1, 3, 3)), {"bbox": [0, 0, 8, 3]}]
    ),
)
ARRAYS = st.one_of(property_of("attributes.tags"), st.lists(st.sampled_from(["a", "b", 1, True]), max_size=3))
FILTERS = st.recursive(
    st.one_of(
        st.sampled_from(["=", "<>", "<", "<=", ">", ">="]).flatmap(
            lambda op: st.one_of(*(call(op, each, each) for each in (NUMBERS, TEXTS, INSTANTS, ANY)))
        ),
        st.sampled_from(["=", "<>"]).flatmap(lambda op: call(op, property_of("attributes.open"), st.booleans())),
        call("like", TEXTS, st.one_of(PATTERNS, call("casei", PATTERNS))),
        *(call("between", each, each, each) for each in (NUMBERS, TEXTS, INSTANTS)),
        call("in", TEXTS, st.lists(PLAIN_TEXTS, max_size=3)),
        call("in", ANY, st.lists(st.sampled_from(["oak", 4, True, "4"]), max_size=3)),
        call("isNull", st.one_of(ANY, property_of("alias", "storey", "footprint", "created_at"))),
        st.sampled_from(["s_intersects", "s_equals", "s_disjoint", "s_touches", "s_within", "s_overlaps", "s_contains"])
        .flatmap(lambda op: call(op, SHAPES, SHAPES)),
        st.sampled_from(TEMPORAL).flatmap(lambda op: call(op, SPANS, SPANS)),
        st.sampled_from(["a_contains", "a_containedBy", "a_equals", "a_overlaps"])
        .flatmap(lambda op: call(op, ARRAYS, ARRAYS)),
        call("isA", st.sampled_from(["Room", "Kitchen", "Space", "Chair", "Thing"])),
        property_of("attributes.open"),
    ),
    lambda inner: st.one_of(call("and", inner, inner), call("or", inner, inner), call("not", inner)),
    max_leaves=4,
)  # fmt: skip


@settings(max_examples=400, deadline=None, suppress_health_check=list(HealthCheck))
@given(document=FILTERS)
def test_sql_selects_what_the_evaluator_selects(furnished: House, document: dict) -> None:
    expression = parse(document)
    with furnished.undone():
        found = selected_ids(furnished.connection, furnished.map_id, Selection(filter=document))
    expected = [each["id"] for each in things(furnished) if Evaluator(each).holds(expression) is True]
    assert list(found) == expected, json.dumps(document)


@settings(max_examples=400, deadline=None, suppress_health_check=list(HealthCheck))
@given(document=FILTERS)
def test_text_means_what_the_library_reads(document: dict) -> None:
    """The library `cql2` is the oracle: it writes each filter as text, and the same is read from that here."""
    written = cql2.parse_json(json.dumps(document))
    try:
        text_form = written.to_text()
        known = cql2.parse_text(text_form).to_json()
    except Exception:  # it neither writes nor reads an empty list
        assert "[]" in json.dumps(document)
        return
    assert parse(text_form) == parse(known)


def names(house: House, **given: object) -> set[str]:
    with house.undone():
        return house.named(selected_ids(house.connection, house.map_id, Selection(**given)))


def test_all_that_is_given_counts(furnished: House) -> None:
    everything = {*(f"thing {n}" for n in range(6)), "first"}
    assert names(furnished) == everything
    assert names(furnished, concept="Room") == {"thing 0", "thing 1", "thing 4"}
    assert names(furnished, concept="https://w3id.org/bot#Zone") == names(furnished, concept="Space")
    assert names(furnished, names=("thing 1", "Büro", "no such")) == {"thing 1"}
    assert names(furnished, names=()) == set()
    assert names(furnished, attributes={"open": True}) == {"thing 0", "thing 4"}
    assert names(furnished, attributes={"tags": ["b"], "open": True}, concept="Room") == {
        "thing 0",
        "thing 4",
    }
    two = tuple(furnished.of("thing 0", "thing 3"))
    assert names(furnished, ids=two, filter="s_within(position, BBOX(0, 0, 1.9, 9))") == {"thing 0"}
    assert names(furnished, filter="isA('Room') AND attributes.seats > 0 AND NOT name LIKE '%1'") == {
        "thing 0"
    }
    assert names(furnished, filter="CASEI(ACCENTI(alias)) = 'buro'") == {"thing 1"}


def test_what_sql_selects_is_what_python_selects(furnished: House) -> None:
    for selection, arguments in (
        ({"concept": "Room"}, "'Room'"),
        ({"concept": "https://w3id.org/bot#Zone"}, "'https://w3id.org/bot#Zone'"),
        ({"names": ("Büro", "thing 5")}, "p_names => array['Büro', 'thing 5']"),
        ({"attributes": {"open": True}}, "p_attributes => '{\"open\": true}'"),
        ({}, "null"),
    ):
        ids = furnished.one(f"select semap.instances('house', {arguments})")
        assert furnished.named(ids) == names(furnished, **selection)
        assert ids == sorted(ids)


@pytest.mark.parametrize(
    ("given", "where", "match"),
    [
        ({"concept": "Rooom"}, "references.concept", "no concept Rooom"),
        ({"filter": "isA('Rooom')"}, "references.filter.args[0]", "no concept Rooom"),
        ({"filter": "nam = 'x'"}, "references.filter.args[0]", "no property nam"),
        ({"filter": "name = 3"}, "references.filter", "number and a text"),
        ({"filter": "name = "}, "references.filter, line 1, character 8", "no CQL2 text"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(furnished: House, given: dict, where: str, match: str) -> None:
    with pytest.raises(InvalidInput, match=match) as told:
        selected_ids(furnished.connection, furnished.map_id, Selection(**given), "references")
    assert told.value.where == where
    assert told.value.remedy


def test_values_are_never_part_of_a_statement(furnished: House) -> None:
    evil = "'; drop table semap.map; --"
    document = {"op": "=", "args": [{"property": f"attributes.{evil}"}, evil]}
    statement = selected(furnished.map_id, Selection(filter=document, names=(evil,), concept=evil))
    assert "drop" not in str(statement.compile(furnished.connection))


def test_a_filter_by_shape_is_served_by_an_index(furnished: House) -> None:
    connection = furnished.connection
    with furnished.undone():
        house = House(connection, "many")
        house.put(*(room(f"r{n}", shapely.box(n, 0, n + 1, 1)) for n in range(100)))
        connection.execute(text("set local enable_seqscan = off"))
        statement = selected(house.map_id, Selection(filter="s_intersects(footprint, BBOX(3.2, 0, 4.8, 1))"))
        assert house.named(connection.scalars(statement)) == {"r3", "r4"}
        compiled = statement.compile(connection, compile_kwargs={"render_postcompile": True})
        plan = "\n".join(connection.exec_driver_sql(f"explain {compiled}", dict(compiled.params)).scalars())
    assert "abstraction_footprint" in plan
    assert "position" not in plan


def test_a_changed_taxonomy_changes_what_is_selected(furnished: House) -> None:
    with furnished.undone():
        change_concept(furnished.connection, "Kitchen", parents=["Thing"])
        assert names(furnished, filter="isA('Room')") == {"thing 0", "thing 4"}


def test_ids_of_another_map_are_not_selected(furnished: House) -> None:
    with furnished.undone():
        other = House(furnished.connection, "other")
        other.put(thing("alien", box(1, 1, 1), Pose()))
        assert names(furnished, ids=tuple(other.of("alien"))) == set()
        assert isinstance(things(furnished)[0]["uid"], str)
        assert UUID(things(furnished)[0]["uid"])
