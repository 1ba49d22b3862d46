"""The rules of the simulated office, as texts and in force."""

import psycopg
from semap_ingest.simulation.floor import office_floor
from semap_ingest.simulation.map_folder import write_map
from semap_service.evaluation.office import PARTS
from semap_service.evaluation.play import office_rules, set_the_stage

from semap.rules.language.reading import read_declaration

WANTED = {kind for kinds in PARTS.values() for kind in kinds}


def test_every_text_is_read():
    declarations = [read_declaration(text) for text in office_rules()]
    names = [each.name for each in declarations]
    assert len(names) == len(set(names)) == 7
    assert set(names) <= {*WANTED, "door_moves"}


def test_they_are_in_force_with_the_doors_of_the_map(database, tmp_path):
    path = write_map(tmp_path / "map")
    for _ in ("made", "made anew in its place"):
        set_the_stage(database, path, "office")
    with psycopg.connect(database) as session:
        [(maps, rules, leaves, types)] = session.execute(
            "select (select array_agg(name) from semap.map),"
            " (select array_agg(name) from semap.rule where enabled),"
            " (select count(*) from semap.door_leaf),"
            " (select array_agg(distinct e #>> '{}') from semap.rule r,"
            "    jsonb_path_query(r.declaration, '$.emit.*') e where r.name = 'door_moves')"
        ).fetchall()
    with_leaf = [door for door in office_floor().doors.values() if door.hinge is not None]
    assert maps == ["office"]
    assert set(rules) == {"room_visits", *(read_declaration(text).name for text in office_rules())}
    assert leaves == len(with_leaf)
    assert set(types) == set(PARTS["doors"])
