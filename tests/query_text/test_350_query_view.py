"""The schema semap_query: a view of each concept, in step with the concepts, and nobody sees more by it."""

from __future__ import annotations

from collections.abc import Iterator

import psycopg
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from world import World

from semap.query_text import view_name
from semap.query_text.views import INSTANCE, TRACK
from semap.store.database.connection import connect
from semap.store.operate.schema import migrate

MINE = "relnamespace = 'semap_query'::regnamespace and relkind = 'v'"


@pytest.fixture
def owner(database: str) -> Iterator[psycopg.Connection]:
    with connect(database) as connection:
        yield connection


def views(connection: psycopg.Connection) -> set[str]:
    rows = connection.execute(f"select relname::text from pg_class where {MINE}".encode()).fetchall()
    return {name for (name,) in rows} - {"track", "instance"}


def concepts(connection: psycopg.Connection) -> list[str]:
    return [name for (name,) in connection.execute("select name from semap.concept order by concept_id")]


def columns(connection: psycopg.Connection, view: str) -> list[str]:
    statement = (
        "select column_name::text from information_schema.columns"
        " where table_schema = 'semap_query' and table_name = %s order by ordinal_position"
    )
    return [name for (name,) in connection.execute(statement, [view])]


def test_views_have_the_columns_that_texts_may_name(owner: psycopg.Connection) -> None:
    assert columns(owner, "track") == list(TRACK)
    assert columns(owner, "instance") == list(INSTANCE)
    for view in views(owner):
        assert columns(owner, view) == list(INSTANCE)


def test_each_function_and_view_says_what_it_is(owner: psycopg.Connection) -> None:
    silent = owner.execute(
        "select proname::text from pg_proc where pronamespace = 'semap_query'::regnamespace and obj_description(oid) is"
        f" null union select relname::text from pg_class where {MINE} and obj_description(oid, 'pg_class') is null".encode()
    ).fetchall()
    assert silent == []


def test_concepts_come_go_and_change_their_names_with_their_views(owner: psycopg.Connection) -> None:
    assert views(owner) == {view_name(each) for each in concepts(owner)}
    owner.execute(
        "insert into semap.concept (name) values ('DiningTable'), ('IFCWall'), ('Küche'), ('a \"b\"; c')"
    )
    assert {"dining_table", "ifc_wall", "küche", "a_b_c"} <= views(owner)
    owner.execute("update semap.concept set name = 'Wall' where name = 'IFCWall'")
    owner.execute("delete from semap.concept where name = 'Küche'")
    assert views(owner) == {view_name(each) for each in concepts(owner)}
    assert "wall" in views(owner)


def test_names_that_are_taken_have_no_view(owner: psycopg.Connection) -> None:
    before = views(owner)
    owner.execute("insert into semap.concept (name) values ('Track'), ('INSTANCE'), ('PgClass'), ('?!')")
    assert views(owner) == before
    owner.execute("insert into semap.concept (name) values ('ChairLeg')")
    owner.execute("insert into semap.concept (name) values ('Chair_Leg')")
    assert views(owner) == before | {"chair_leg"}
    (oldest,) = owner.execute("select obj_description('semap_query.chair_leg'::regclass)").fetchone() or ("",)
    assert "ChairLeg" in oldest


def test_a_concept_with_a_view_that_others_stand_on_may_go(owner: psycopg.Connection) -> None:
    owner.execute("insert into semap.concept (name) values ('Gone')")
    owner.execute("create view public.mine as select name from semap_query.gone")
    owner.execute("delete from semap.concept where name = 'Gone'")
    assert owner.execute("select * from public.mine").fetchall() == []
    owner.execute("drop view public.mine")
    owner.execute("select semap.make_concept_views()")
    assert "gone" not in views(owner)


def test_who_may_add_a_concept_adds_its_view(database: str, owner: psycopg.Connection) -> None:
    with connect(database, "semap_api") as writer:
        writer.execute("insert into semap.concept (name) values ('Lamp')")
        assert writer.execute("select count(*) from semap_query.lamp").fetchone() == (0,)
        with pytest.raises(psycopg.errors.InsufficientPrivilege):
            writer.execute("select semap.make_concept_views()")
        with pytest.raises(psycopg.errors.InsufficientPrivilege):
            writer.execute("create view semap_query.mine as select 1 as one")


def test_instances_below_a_concept_are_in_its_view(world: World, owner: psycopg.Connection) -> None:
    world.add_room("Kitchen", shapely.box(0, 0, 1, 1))
    for view in ("room", "space", "thing", "instance"):
        assert owner.execute(f"select name, concept from semap_query.{view}".encode()).fetchall() == [
            ("Kitchen", "Room")
        ]
    assert owner.execute("select name from semap_query.furniture").fetchall() == []


@pytest.mark.parametrize("role", ["semap_read_map", "semap_ingest_map", "semap_api_map"])
def test_a_role_for_some_maps_sees_these_only(database: str, world: World, role: str) -> None:
    other = World(database, "other")
    for each in (world, other):
        each.add_room("Kitchen", shapely.box(0, 0, 1, 1))
        each.add_states([(each.add_track("anna"), 1, 0.5, 0.5, None)])
    with connect(database, role) as reader:
        for view in ("track", "instance", "room", "space"):
            assert reader.execute(f"select map from semap_query.{view}".encode()).fetchall() == []
        reader.execute("select set_config('semap.maps', %s, false)", [f"{{{world.map_id}}}"])
        for view in ("track", "instance", "room", "space"):
            assert reader.execute(f"select map from semap_query.{view}".encode()).fetchall() == [("world",)]
    with connect(database, "semap_read") as reader:
        assert len(reader.execute("select map from semap_query.room").fetchall()) == 2
        reader.execute("select set_config('semap.maps', %s, false)", [f"{{{world.map_id}}}"])
        assert reader.execute("select map from semap_query.room").fetchall() == [("world",)]
    other.close()


def test_every_view_acts_for_its_reader(owner: psycopg.Connection) -> None:
    statement = f"select relname from pg_class where {MINE} and reloptions is distinct from '{{security_invoker=true}}'"
    assert owner.execute(statement.encode()).fetchall() == []


def test_behaviour_that_is_applied_again_leaves_the_views_as_they_are(
    database: str, owner: psycopg.Connection
) -> None:
    owner.execute("insert into semap.concept (name) values ('Lamp')")
    owner.execute("create view public.mine as select name from semap_query.lamp")
    before = views(owner)
    owner.execute("update semap.behaviour set checksum = 'older'")
    assert migrate(database).behaviour_changed
    assert views(owner) == before
    assert owner.execute("select * from public.mine").fetchall() == []


NAMES = st.text(st.sampled_from("aZ09_ -.ÄöBCd'\"漢🏠\t"), min_size=1, max_size=12) | st.text(
    st.characters(exclude_characters="\0", exclude_categories=["Cs"]), min_size=1, max_size=80
)


def test_names_of_views_are_the_same_in_python_and_in_sql(owner: psycopg.Connection) -> None:
    @settings(max_examples=300)
    @given(NAMES)
    def same(name: str) -> None:
        assert owner.execute("select semap.view_name(%s)", [name]).fetchone() == (view_name(name),)

    same()


def test_snake_case() -> None:
    pairs = {
        "DiningTable": "dining_table",
        "IFCWall": "ifc_wall",
        "Room": "room",
        "room2Go": "room2_go",
        "A b-C": "a_b_c",
    }
    assert {name: view_name(name) for name in pairs} == pairs


def test_the_index_on_footprints_serves_a_plain_query(owner: psycopg.Connection) -> None:
    owner.execute("set enable_seqscan = off")
    owner.execute("set enable_bitmapscan = off")
    plan = owner.execute(
        "explain (format json, costs off) select r.name from semap_query.room r"
        " where public.st_contains(r.footprint, public.st_makepoint(1, 2))"
    ).fetchone()
    assert "abstraction_footprint" in str(plan)
    assert "position_3d" not in str(plan)
