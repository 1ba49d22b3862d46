"""Texts of continuous queries: what is understood, and what is refused for which reason at which place."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any
from uuid import UUID

from semap.model.continuous_query import Declaration, Side

CONCEPTS = ("Thing", "Room", "Door", "Table", "Cup", "Zone", "DiningTable", "ChairLeg", "Chair_Leg")
KITCHEN = "11111111-0000-4000-8000-000000000001"
ANNA = "22222222-0000-4000-8000-000000000001"

TRACKS = Side("track")
ROOMS = Side("instance", "Room")
CUPS = Side("instance", "Cup")
TABLES = Side("instance", "Table")


def rooms(*where: Any) -> Side:
    return Side("instance", "Room", where=all_of(*where))


def all_of(*parts: Any) -> Any:
    return parts[0] if len(parts) == 1 else op("and", *parts)


def op(name: str, *args: Any) -> dict[str, Any]:
    return {"op": name, "args": list(args)}


def prop(name: str) -> dict[str, str]:
    return {"property": name}


@dataclass(frozen=True)
class Accepted:
    """A text and what it declares; NAMES is the payload where none is given."""

    sql: str
    predicate: Any
    subject: Side = TRACKS
    object: Side = ROOMS
    more: dict[str, Any] = field(default_factory=dict)
    payload: dict[str, str] = field(
        default_factory=lambda: {"track_name": "subject.name", "room_name": "object.name"}
    )

    @property
    def declaration(self) -> Declaration:
        given = {"dimensions": 2, **self.more}
        return Declaration("q", self.predicate, self.subject, self.object, payload=self.payload, **given)


def near(distance_m: float, **more: Any) -> dict[str, Any]:
    return {"distance_m": distance_m, **more}


HEAD = "select t.name, r.name from track t, room r where "
IN = "ST_Contains(r.footprint, t.position)"
PAIR = {"a_name": "subject.name", "b_name": "object.name"}
CUP_TABLE = {"cup": "subject.name", "top": "object.name"}
OF_THINGS = 'select i.name as i_name, d.name as top from instance i, "table" d where '
OF_CUPS = 'select c.name as cup, d.name as top from cup c, "table" d where '


def where(condition: str, *json: Any) -> Accepted:
    """A condition on the room of an otherwise plain query."""
    return Accepted(f"{HEAD}{IN} and {condition}", "contains", object=rooms(*json))


ACCEPTED = [
    Accepted(
        "select r.name, t.name, t.position from track t, room r where ST_Contains(r.footprint, t.position)",
        "contains",
        payload={"room_name": "object.name", "track_name": "subject.name", "position": "subject.position"},
    ),
    Accepted(
        "select track.name as who, room.name as place, room.attributes from semap_query.track, semap_query.room"
        " where public.st_within(track.position, room.footprint);",
        "contains",
        payload={"who": "subject.name", "place": "object.name", "attributes": "object.attributes"},
    ),
    Accepted("select * from room, track where st_covers(footprint_hull, track.position)", "covers",
             more={"abstraction": "FootprintHull"}, payload={}),
    Accepted(HEAD + "ST_CoveredBy(t.position, r.footprint)", "covers"),
    Accepted(HEAD + "ST_Intersects(t.position, r.footprint)", "covers"),
    Accepted(HEAD + "ST_Intersects(r.footprint, t.footprint)", "intersects"),
    Accepted(HEAD + "ST_DWithin(r.footprint, t.position, 1.5)", "within_distance", more=near(1.5)),
    Accepted(HEAD + "ST_Distance(t.position, r.footprint) <= 2", "within_distance", more=near(2.0)),
    Accepted(HEAD + "2 > ST_Distance(t.position, r.position)", "within_distance",
             more=near(math.nextafter(2.0, 0), abstraction="Position2D")),
    Accepted(HEAD + "t.position <-> r.footprint <= 0.5::float", "within_distance", more=near(0.5)),
    Accepted(HEAD + "is_near(t, r, 1.5)", "within_distance",
             more=near(1.5, abstraction="BoundingHull", dimensions=3)),
    Accepted(OF_CUPS + "ST_3DDWithin(c.position_3d, d.position_3d, 1)", "within_distance", CUPS, TABLES,
             near(1.0, abstraction="Position3D", dimensions=3), CUP_TABLE),
    Accepted(OF_CUPS + "is_near(c, d, 0.05)", "within_distance", CUPS, TABLES,
             near(0.05, abstraction="BoundingHull", dimensions=3), CUP_TABLE),
    Accepted(HEAD + "ST_3DDistance(r.position_3d, t.position) <= 3", "within_distance",
             more=near(3.0, abstraction="Position3D", dimensions=3)),
    Accepted("select t.name, r.name from track t join room r on " + IN, "contains"),
    Accepted("select t.name, r.name from track t cross join room r where " + IN, "contains"),
    Accepted(HEAD + f"({IN} and (true and t.map = r.map)) and t.map_id = r.map_id", "contains"),
    Accepted(HEAD + "is_in(t, r)", "contains", more={"dimensions": 3}),
    Accepted(HEAD + "semap_query.in_front_of(t, r)", "in_front_of", more=near(10.0, dimensions=3)),
    Accepted(HEAD + "behind(t, r)", "behind", more=near(10.0, dimensions=3)),
    Accepted(HEAD + "left_of(t, r)", "left_of", more=near(10.0, dimensions=3)),
    Accepted(HEAD + "right_of(t, r)", "right_of", more=near(10.0, dimensions=3)),
    Accepted(HEAD + "faces(t, r, radians(30))", "facing", more={"dimensions": 3, "angle_rad": math.radians(30)}),
    Accepted(HEAD + "approaches(t, r, 0.5, 5)", "approaching", more=near(5.0, dimensions=3, speed_mps=0.5)),
    Accepted(HEAD + "crosses(t, r)", "crosses", more={"dimensions": 3}),
    Accepted(HEAD + "is_on(t, r)", "on", more={"dimensions": 3}),
    Accepted(OF_CUPS + "is_on(c, d)", "on", CUPS, TABLES, {"dimensions": 3}, CUP_TABLE),
    Accepted(OF_CUPS + "is_in(c, d)", "contains", CUPS, TABLES, {"dimensions": 3}, CUP_TABLE),
    Accepted(OF_CUPS + "left_of(c, d)", "left_of", CUPS, TABLES, near(10.0, dimensions=3), CUP_TABLE),
    Accepted(OF_CUPS + "ST_Contains(d.footprint, c.footprint)", "contains", CUPS, TABLES, {}, CUP_TABLE),
    Accepted(OF_CUPS + "ST_Intersects(c.footprint_hull, d.footprint_hull)", "intersects", CUPS, TABLES,
             {"abstraction": "FootprintHull"}, CUP_TABLE),
    Accepted(OF_CUPS + "ST_DWithin(d.position, c.position, 1)", "within_distance", TABLES, CUPS,
             near(1.0, abstraction="Position2D"), {"cup": "object.name", "top": "subject.name"}),
    Accepted("select a.name, b.name from track a, track b where ST_DWithin(a.position, b.position, 2)"
             " and a.id <> b.id", "within_distance", TRACKS, TRACKS, near(2.0), PAIR),
    Accepted("select a.name, b.name from track a join track b on a.uid <> b.uid"
             " and ST_Intersects(a.footprint, b.footprint)", "intersects", TRACKS, TRACKS, {}, PAIR),
    Accepted("select a.name, b.name from track a, track b where approaches(a, b, 0.2, 6.5) and b.id <> a.id",
             "approaching", TRACKS, TRACKS, near(6.5, dimensions=3, speed_mps=0.2), PAIR),
    Accepted("select a.name, b.name from track a, track b where is_near(a, b, 1.5) and b.id <> a.id",
             "within_distance", TRACKS, TRACKS, near(1.5, dimensions=3), PAIR),
    Accepted("select i.name, r.name as room from instance i, room r where ST_Within(i.footprint, r.footprint)"
             " and i.id <> r.id", "contains", Side("instance"), ROOMS, {},
             {"name": "subject.name", "room": "object.name"}),
    Accepted(
        "select t.name, n.name from track t, lateral (select * from room r"
        " order by r.footprint <-> t.position limit 3) n",
        "nearest", more={"count": 3},
    ),
    Accepted(
        "select t.name, place from track t cross join lateral (select r.name as place from room r"
        " where r.attributes->>'floor' = 'ground' and r.map_id = t.map_id"
        " order by ST_Distance(t.position, r.position) asc limit 1) n where t.source = 'tracker'",
        "nearest", Side("track", where=op("=", prop("source"), "tracker")),
        rooms(op("=", prop("attributes.floor"), "ground")), {"count": 1, "abstraction": "Position2D"},
        {"name": "subject.name", "place": "object.name"},
    ),
    Accepted(
        "select a.name, n.name from track a, lateral (select * from track b where b.id <> a.id"
        " order by b.position <-> a.position limit 1) n",
        "nearest", TRACKS, TRACKS, {"count": 1}, {"a_name": "subject.name", "n_name": "object.name"},
    ),
    Accepted("select t.name, n.name from track t, lateral (select * from room r where " + IN + ") n", "contains"),
    Accepted("select t.name, r.name from track t join lateral (select q.* from room q"
             " where ST_Contains(q.footprint, t.position)) r on true", "contains"),
    Accepted("select t.name, r.name from track t, (select name, footprint from room where name <> 'Hall') r where "
             + IN, "contains", object=rooms(op("<>", prop("name"), "Hall"))),
    Accepted("select t.*, r.name as room from track t, room r where " + IN, "contains",
             payload={each: f"subject.{each}" for each in (
                 "kind", "id", "uid", "name", "source", "map", "map_id", "stamp", "position", "footprint", "x_m", "y_m",
                 "z_m", "std_m", "heading_rad", "speed_mps", "length_m", "width_m", "concept", "concept_id",
                 "attributes", "std_across_m", "std_yaw_rad")} | {"room": "object.name"}),
    Accepted(f"{HEAD}{IN} and r.uid = '{KITCHEN}'::uuid and t.uid in ('{ANNA}', '{KITCHEN}')", "contains",
             Side("track", uids=(UUID(ANNA), UUID(KITCHEN))), Side("instance", "Room", (UUID(KITCHEN),))),
    where("r.name = 'Kitchen'", op("=", prop("name"), "Kitchen")),
    where("'Kitchen' <> r.name", op("<>", prop("name"), "Kitchen")),
    where("r.name in ('Kitchen', 'Hall')", op("in", prop("name"), ["Kitchen", "Hall"])),
    where("r.name not in ('Kitchen')", op("not", op("in", prop("name"), ["Kitchen"]))),
    where("r.name like 'L%' and r.alias is null", op("like", prop("name"), "L%"), op("isNull", prop("alias"))),
    where("r.name not ilike 'k%'", op("not", op("like", op("casei", prop("name")), op("casei", "k%")))),
    where("r.name collate \"C\" between 'I' and 'L'",
          op("and", op(">=", prop("name"), "I"), op("<=", prop("name"), "L"))),
    where("r.name = r.alias", op("=", prop("name"), prop("alias"))),
    where("(r.storey = 'Ground' or not r.concept = 'Room')",
          op("or", op("=", prop("storey"), "Ground"), op("<>", prop("concept"), "Room"))),
    Accepted(f"{HEAD}{IN} and semap.is_a(r.concept, 'Room')", "contains"),
    Accepted(OF_THINGS + "is_on(i, d) and semap.is_a(i.concept, 'Cup') and i.id <> d.id", "on", CUPS, TABLES, {"dimensions": 3},
             {"i_name": "subject.name", "top": "object.name"}),
    where("semap.is_a(r.concept, 'Space')", op("isA", "Space")),
    Accepted(f"{HEAD}{IN} and semap.is_a(t.concept, 'Robot')", "contains", Side("track", "Robot")),
    Accepted(f"{HEAD}{IN} and t.attributes->>'shift' = 'night'", "contains",
             Side("track", where=op("=", prop("attributes.shift"), "night"))),
    where("r.attributes->>'floor' = '2'",
          op("or", op("=", prop("attributes.floor"), "2"), op("=", prop("attributes.floor"), 2))),
    where("(r.attributes->>'area')::float > 10", op(">", prop("attributes.area"), 10)),
    where("(r.attributes->'area')::numeric not between 5 and 10.5",
          op("or", op("<", prop("attributes.area"), 5), op(">", prop("attributes.area"), 10.5))),
    where("not (r.attributes->>'open')::boolean", op("=", prop("attributes.open"), False)),
    where("r.attributes->'size'->>'unit' is not null", op("not", op("isNull", prop("attributes.size.unit")))),
    where("r.attributes @> '{\"floor\": 2, \"size\": {\"unit\": \"m\"}}'",
          op("and", op("=", prop("attributes.floor"), 2), op("=", prop("attributes.size.unit"), "m"))),
]  # fmt: skip


REFUSED = [
    # the text as a whole: reason, text, what stands where it is refused
    ("too long", "select 1 -- " + "x" * 1_000_000, None),
    ("too deep", HEAD + "(" * 15_000, None),
    ("too deep", HEAD + "not " * 2000 + "true", "not not"),
    ("too deep", HEAD + "r.attributes @> '" + '{"a":' * 51 + "1" + "}" * 51 + "'", "'{"),
    ("too deep", HEAD + "r.attributes @> '" + '{"a":' * 3000 + "1" + "}" * 3000 + "'", "'{"),
    ("too deep", "select 1" + "+1" * 9_000, "+1"),
    ("too deep", "select 1 from " + "(" * 600 + "track" + " join room on true)" * 600, "true) join room"),
    ("too deep", HEAD + "not " * 60 + "true", "not not"),
    ("bytes", "select '\0'", "\0"),
    ("bytes", "select '\ud800'", "\ud800"),
    ("syntax", "select E'\\xff'", None),
    ("syntax", "select from where", "where"),
    ("syntax", "sélect 1", "sélect"),
    ("quoted", "select * from track t, table d where is_on(t, d)", "table"),
    ("empty", "", ""),
    ("empty", " -- nothing\n/* at all */ ;", ""),
    ("several", HEAD + IN + "; select 1", "select 1"),
    ("no select", "delete from track", ""),
    ("no select", "insert into track values (1)", ""),
    ("no select", "drop table semap.track", ""),
    ("set", HEAD + IN + " union " + HEAD + IN, None),
    ("with", "with t as (select * from track) " + HEAD + IN, None),
    ("values", "values (1, 2)", None),
    ("into", "select t.name into kept from track t, room r where " + IN, None),
    ("group", HEAD + IN + " group by t.name", None),
    ("group", "select 1 from track t, room r having true", None),
    ("aggregate", "select count(*) from track t, room r where " + IN, "count"),
    ("aggregate", "select r.name from track t, room r where ST_Contains(ST_Union(r.footprint), t.position)", "ST_Union"),
    ("window", "select row_number() over () from track t, room r", "row_number"),
    ("window", HEAD + IN + " window w as ()", None),
    ("distinct", "select distinct t.name from track t, room r where " + IN, None),
    ("order", HEAD + IN + " order by t.name", "t.name"),
    ("limit", HEAD + IN + " limit 3", "3"),
    ("offset", HEAD + IN + " offset 3", None),
    ("ties", HEAD + IN + " order by 1 fetch first 3 rows with ties", None),
    ("locking", HEAD + IN + " for update", None),
    # FROM
    ("no view", "select * from tracks t, room r", "tracks"),
    ("shared view", "select * from track t, chair_leg c", "chair_leg"),
    ("schema", "select * from semap.track t, room r", "semap"),
    ("one view", "select name from track", "select name from track"),
    ("one view", "select 1", "select 1"),
    ("one view", "select * from track t, room r, door d", "door"),
    ("outer join", "select * from track t left join room r on " + IN, "room"),
    ("using", "select * from track t join room r using (name)", "room"),
    ("using", "select * from track natural join room", "room"),
    ("range", "select * from track t, generate_series(1, 2) g", "generate_series"),
    ("range", "select * from track t, room tablesample system (1)", None),
    ("renamed", "select * from track t, room r (a, b)", "room"),
    ("renamed", "select * from (track t join room r on true) j", "room"),
    ("alias twice", "select * from track t, room t", "room"),
    ("subquery", HEAD + IN + " and exists (select 1)", "exists"),
    ("inner subquery", "select * from track t, (select * from room a, room b) r", None),
    ("inner subquery", "select * from track t, (select * from (select * from room) a) r", None),
    ("values", "select * from track t, (values (1)) v", None),
    ("not lateral", "select * from track t, (select * from room r where " + IN + ") n", "t.position"),
    ("after limit", "select * from track t, lateral (select * from room r order by r.footprint <-> t.position"
                    " limit 3) n where n.name = 'Hall'", "="),
    ("after limit", "select * from track a, lateral (select * from track b order by b.position <-> a.position"
                    " limit 3) n where n.id <> a.id", "<> a.id"),
    ("no limit", "select * from track t, lateral (select * from room r order by r.footprint <-> t.position) n", None),
    ("unordered limit", "select * from track t, lateral (select * from room r limit 3) n", "3"),
    ("limit count", "select * from track t, lateral (select * from room r order by r.footprint <-> t.position"
                    " limit 0) n", "0"),
    ("limit count", "select * from track t, lateral (select * from room r order by r.footprint <-> t.position"
                    " limit 101) n", "101"),
    ("limit count", "select * from track t, lateral (select * from room r order by r.footprint <-> t.position"
                    " limit 1 + 1) n", "+ 1"),
    ("farthest", "select * from track t, lateral (select * from room r order by r.footprint <-> t.position desc"
                 " limit 1) n", "<->"),
    ("order by", "select * from track t, lateral (select * from room r order by r.name limit 1) n", "r.name"),
    ("order by", "select * from track t, lateral (select * from room r order by r.footprint <-> t.position, r.name"
                 " limit 1) n", None),
    # SELECT
    ("no columns", "select from track t, room r where " + IN, ""),
    ("column", "select t.nane from track t, room r where " + IN, "t.nane"),
    ("column", "select nane from track t, room r where " + IN, "nane"),
    ("ambiguous", "select name from track t, room r where " + IN, "name"),
    ("no table", "select x.name from track t, room r where " + IN, "x.name"),
    ("not selected", "select n.name from track t, (select footprint from room) n where"
                     " ST_Contains(n.footprint, t.position)", "n.name"),
    ("computed", "select upper(t.name) from track t, room r where " + IN, "upper"),
    ("computed", "select 1 from track t, room r where " + IN, "1"),
    ("whole row", "select t from track t, room r where " + IN, "t from"),
    ("same name", "select t.name, t.name from track t, room r where " + IN, "t.name from"),
    ("same name", "select t.name as a, r.name as a from track t, room r where " + IN, "r.name as a"),
    # the relation
    ("no relation", "select t.name from track t, room r where r.name = 'Hall'", "room"),
    ("two relations", HEAD + IN + " and is_in(t, r)", "is_in"),
    ("or relation", HEAD + f"({IN} or is_in(t, r))", "ST_Contains"),
    ("or relation", HEAD + f"{IN} or r.name = 'Hall'", "ST_Contains"),
    ("not relation", HEAD + f"not {IN}", "ST_Contains"),
    ("within expression", HEAD + f"{IN} = true", "ST_Contains"),
    ("within expression", HEAD + f"({IN}) is not null", "ST_Contains"),
    ("within expression", HEAD + "ST_Distance(t.position, r.footprint) between 1 and 2", "ST_Distance"),
    ("beyond", HEAD + "ST_Distance(t.position, r.footprint) > 2", "ST_Distance"),
    ("beyond", HEAD + "2 <= t.position <-> r.footprint", "<->"),
    ("distance", HEAD + "ST_Distance(t.position, r.footprint) = 2", "ST_Distance"),
    ("distance", HEAD + "ST_Distance(t.position, r.footprint) < t.speed_mps", "< t.speed"),
    ("distance", HEAD + "ST_Distance(t.position, r.footprint)", "ST_Distance"),
    ("number", HEAD + "ST_DWithin(t.position, r.footprint, -1)", "-1"),
    ("number", HEAD + "ST_DWithin(t.position, r.footprint, 0)", "0)"),
    ("number", HEAD + "ST_DWithin(t.position, r.footprint, 10001)", "10001"),
    ("number", HEAD + "ST_DWithin(t.position, r.footprint, t.std_m)", "t.std_m"),
    ("number", HEAD + "ST_Distance(t.position, r.footprint) < 0", "0"),
    ("number", HEAD + "faces(t, r, 4)", "4"),
    ("number", HEAD + "faces(t, r, 0)", "0"),
    ("number", HEAD + "approaches(t, r, 0, 5)", "0, 5"),
    ("number", HEAD + "approaches(t, r, 1e5, 5)", "1e5"),
    ("number", HEAD + "ST_DWithin(t.position, r.footprint, 1e999)", "1e999"),
    ("arguments", HEAD + "ST_Contains(r.footprint)", "ST_Contains"),
    ("arguments", HEAD + "faces(t, r)", "faces"),
    ("arguments", HEAD + "approaches(t, r, 0.5)", "approaches"),
    ("unkept predicate", HEAD + "ST_Touches(r.footprint, t.position)", "ST_Touches"),
    ("unkept predicate", HEAD + "r.footprint && t.position", "&&"),
    ("unkept predicate", HEAD + "ST_MaxDistance(r.footprint, t.position) < 3", "ST_MaxDistance"),
    ("fixed area", HEAD + "ST_Contains(ST_MakeEnvelope(0, 0, 1, 1), t.position)", "ST_MakeEnvelope"),
    ("one side", HEAD + "ST_DWithin(t.position, t.position, 1)", "t.position, t"),
    ("one side", HEAD + "faces(t, t, 1)", "faces"),
    ("not a shape", HEAD + "ST_Contains(r.name, t.position)", "r.name, t.pos"),
    ("not a shape", HEAD + "ST_Contains(r, t)", "r, t)"),
    ("derived shape", HEAD + "ST_Contains(ST_Buffer(r.footprint, 1), t.position)", "ST_Buffer"),
    ("track inside", HEAD + "ST_Contains(t.footprint, r.footprint)", "t.footprint"),
    ("point inside", HEAD + "ST_Contains(r.position, t.position)", "r.position"),
    ("track shape", HEAD + "ST_Contains(r.footprint, t.footprint)", "t.footprint"),
    ("track point", "select * from track a, track b where ST_Intersects(a.position, b.footprint) and a.id <> b.id",
     "a.position"),
    ("two abstractions", OF_CUPS + "ST_Contains(d.footprint, c.position)", "c.position"),
    ("flat", HEAD + "ST_3DDWithin(r.footprint, t.position, 1)", "r.footprint"),
    ("shell", HEAD + "ST_3DDWithin(r.bounding_hull, t.position, 1)", "r.bounding_hull"),
    ("solid", HEAD + "ST_DWithin(r.bounding_hull, t.position, 1)", "r.bounding_hull"),
    ("solid", HEAD + "ST_Contains(r.bounding_box, t.position)", "r.bounding_box"),
    ("rows", HEAD + "is_in(t.id, r.id)", "t.id"),
    ("object track", "select * from track a, track b where is_in(a, b) and a.id <> b.id", "b) and"),
    ("subject instance", OF_CUPS + "faces(c, d, 1)", "c, d, 1"),
    ("itself", "select * from track a, track b where ST_DWithin(a.position, b.position, 2)", "ST_DWithin"),
    ("itself", "select * from instance i, room r where ST_Within(i.footprint, r.footprint)", "ST_Within"),
    ("half pairs", "select * from track a, track b where ST_DWithin(a.position, b.position, 2) and a.id < b.id", "<"),
    # conditions
    ("no column", HEAD + IN + " and false", "false"),
    ("no column", HEAD + IN + " and 1 = 1", "1 = 1"),
    ("between sides", HEAD + IN + " and t.name = r.name", "= r.name"),
    ("between sides", HEAD + IN + " and (t.name = 'a' or r.name = 'b')", "or r.name"),
    ("heights", HEAD + IN + " and t.z_m >= r.z_min_m", ">="),
    ("moving", HEAD + IN + " and t.speed_mps > 1", "t.speed_mps"),
    ("shape condition", HEAD + IN + " and r.footprint is not null", "r.footprint is"),
    ("unkept column", HEAD + IN + " and r.z_min_m > 1", "r.z_min_m"),
    ("unkept column", HEAD + IN + " and t.concept = 'Robot'", "t.concept"),
    ("time", HEAD + IN + " and t.stamp > now()", "now"),
    ("time", HEAD + IN + " and t.stamp > current_timestamp", "current_timestamp"),
    ("volatile", HEAD + IN + " and random() < 0.5", "random"),
    ("function", HEAD + IN + " and upper(r.name) = 'HALL'", "upper"),
    ("function", HEAD + IN + " and semap.above(1) = 'HALL'", "semap.above"),
    ("expression", HEAD + IN + " and case when true then true end", "case"),
    ("expression", HEAD + IN + " and r.name = any ('{Hall}')", "= any"),
    ("expression", HEAD + IN + " and r.name is distinct from 'Hall'", "is distinct"),
    ("expression", HEAD + IN + " and (r.name = 'Hall') is true", "is true"),
    ("expression", HEAD + IN + " and r.name = coalesce(r.alias, 'x')", "coalesce"),
    ("parameter", HEAD + IN + " and r.name = $1", "$1"),
    ("type", HEAD + IN + " and (r.attributes->>'made')::date = '2026-01-01'", "->>"),
    ("type", HEAD + IN + " and (r.attributes->>'area')::real > 1", "->>"),
    ("type", HEAD + IN + " and (r.attributes->'area')::integer > 1", "->"),
    ("operator", HEAD + IN + " and r.name ~ 'H.*'", "~"),
    ("operator", HEAD + IN + " and r.attributes ? 'floor'", "?"),
    ("operator", HEAD + IN + " and r.name || 'x' = 'y'", "||"),
    ("null", HEAD + IN + " and r.name = null", "null"),
    ("not a text", HEAD + IN + " and r.name = 3", "3"),
    ("not a number", HEAD + IN + " and (r.attributes->>'area')::float > '3'", "'3'"),
    ("not a boolean", HEAD + IN + " and (r.attributes->>'open')::boolean = 'yes'", "'yes'"),
    ("uncast", HEAD + IN + " and r.attributes->>'area' > 3", "3"),
    ("collation", HEAD + IN + " and r.name < 'M'", "'M'"),
    ("collation", HEAD + IN + " and r.name collate \"de_DE\" < 'M'", "collate"),
    ("attribute order", HEAD + IN + " and r.attributes->>'floor' < '3'", "'3'"),
    ("json text", HEAD + IN + " and r.attributes->>'tags' = '[1]'", "'[1]'"),
    ("attribute", HEAD + IN + " and r.attributes->0 is null", "0"),
    ("attribute", HEAD + IN + " and r.attributes->'floor' is null", "->"),
    ("attribute", HEAD + IN + " and r.attributes->'floor' = '2'", "'2'"),
    ("attribute", HEAD + IN + " and r.attributes = '{}'", "r.attributes"),
    ("attribute name", HEAD + IN + " and r.attributes->>'a.b' = 'x'", "'a.b'"),
    ("attribute name", HEAD + IN + " and r.attributes->>'2' = 'x'", "'2'"),
    ("attribute value", HEAD + IN + " and r.attributes @> '{\"tags\": [1]}'", "'{"),
    ("attribute value", HEAD + IN + " and r.attributes @> 'x'", "'x'"),
    ("pattern", HEAD + IN + " and r.name like 'x\\'", "'x"),
    ("pattern", HEAD + IN + " and r.name like r.alias", "r.alias"),
    ("escape", HEAD + IN + " and r.name like 'x' escape '!'", "like"),
    ("uid", HEAD + IN + " and r.uid = 'kitchen'", "'kitchen'"),
    ("uid alone", HEAD + IN + f" and (r.uid = '{KITCHEN}' or r.name = 'Hall')", "r.uid"),
    ("no uid", HEAD + IN + f" and r.uid = '{KITCHEN}' and r.uid = '{ANNA}'", "= '" + ANNA),
    ("map", HEAD + IN + " and r.map = 'office'", "r.map"),
    ("id", HEAD + IN + " and r.id = 3", "r.id"),
    ("large condition", HEAD + IN + " and r.name in (" + ", ".join(["'x'"] * 2100) + ")", "in ("),
    ("new number", HEAD + "ST_DWithin(t.position, r.footprint, 1_000)", "1_000"),
    ("new number", HEAD + "ST_DWithin(t.position, r.footprint, 0x10)", "0x10"),
]  # fmt: skip
