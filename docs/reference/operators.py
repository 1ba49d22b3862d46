"""docs/operators.md, made from the table of operators.

`python docs/reference/operators.py > docs/operators.md` writes it again.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

from semap.store.operator_table import GROUPS, OPERATORS, Operator, Parameter

RUN = "POST /maps/{name}/operators/{operator}"


@dataclass(frozen=True)
class Service:
    """A ROS service of SEMAP, and what does the same here.

    sql   what to call or to write in SQL
    rest  the endpoints, as they are published
    """

    name: str
    sql: str
    rest: tuple[str, ...]
    note: str = ""


DESCRIPTION = "GET /descriptions/{id}"
DESCRIPTIONS = "GET /maps/{name}/descriptions"
CHANGE_DESCRIPTION = "PATCH /descriptions/{id}"
PUT_GEOMETRY = "PUT /descriptions/{id}/geometries/{geometry}"
GET_GEOMETRY = "GET /descriptions/{id}/geometries/{geometry}"
INSTANCE = "GET /instances/{id}"
INSTANCES = "GET /instances"
CHANGE_INSTANCE = "PATCH /instances/{id}"
KEPT = "nothing to call: the database keeps what is derived true"


def _of_operators() -> list[Service]:
    found: dict[str, list[Operator]] = {}
    for each in OPERATORS.values():
        for service in each.semap:
            found.setdefault(service, []).append(each)
    return [
        Service(name, ", ".join(f"`{each.sql}`" for each in operators), (RUN,))
        for name, operators in found.items()
    ]


def _geometry(name: str, type_: str) -> Service:
    return Service(name, "`semap.geometry`", (PUT_GEOMETRY,), f"type {type_}")


OTHERS = (
    Service("add_object_descriptions", "`semap.description`", ("POST /maps/{name}/descriptions",)),
    Service("copy_object_descriptions", "", (DESCRIPTION, "POST /maps/{name}/descriptions")),
    Service("get_object_descriptions", "`semap.description`, `semap.geometry`", (DESCRIPTION,)),
    Service("get_object_descriptions_ids", "`semap.description`", (DESCRIPTIONS,)),
    Service("get_object_descriptions_list", "`semap.description`", (DESCRIPTIONS,)),
    Service("get_all_object_descriptions", "`semap.description`", (DESCRIPTIONS,)),
    Service("rename_object_description", "`semap.description`", (CHANGE_DESCRIPTION,)),
    Service("update_object_descriptions", KEPT, ()),
    Service("update_all_object_descriptions", KEPT, ()),
    Service("make_relative3d", KEPT, (), "geometries are relative to their description"),
    Service("set_geometry_model_pose", "`semap.geometry`", (PUT_GEOMETRY,)),
    Service("update_geometry_model_pose", "`semap.geometry`", (PUT_GEOMETRY,)),
    Service("update_and_transform_geometry_model_pose", "`semap.geometry`", (PUT_GEOMETRY,)),
    Service("rename_geometry_model", "`semap.geometry`", (GET_GEOMETRY, PUT_GEOMETRY)),
    Service(
        "remove_geometry_model", "`semap.geometry`", ("DELETE /descriptions/{id}/geometries/{geometry}",)
    ),
    Service("get_geometry_model_types", "`semap.geometry`, `semap.abstraction`", (DESCRIPTION,)),
    _geometry("add_point_2d_model", "POINT2D"),
    _geometry("add_pose_2d_model", "POSE2D"),
    _geometry("add_polygon_2d_model", "POLYGON2D"),
    _geometry("add_point_3d_model", "POINT3D"),
    _geometry("add_pose_3d_model", "POSE3D"),
    _geometry("add_polygon_3d_model", "POLYGON3D"),
    _geometry("add_triangle_mesh_3d_model", "TRIANGLEMESH3D, also as a mesh file"),
    _geometry("add_polygon_mesh_3d_model", "POLYGONMESH3D"),
    Service("add_object_instances", "`semap.instance`", ("POST /maps/{name}/instances",)),
    Service("get_object_instances", "`semap.instances`", (INSTANCE,)),
    Service("get_object_instances_ids", "`semap.instances`", (INSTANCES,)),
    Service("get_object_instances_list", "`semap.instances`", (INSTANCES,)),
    Service("get_all_object_instances", "`semap.instances`", (INSTANCES,)),
    Service("rename_object_instance", "`semap.instance`", (CHANGE_INSTANCE,)),
    Service("switch_object_descriptions", "`semap.instance`", (CHANGE_INSTANCE,)),
    Service("update_absolute_descriptions", KEPT, ()),
    Service("add_root_frame", "`semap.frame`", ("POST /maps/{name}/frames",)),
    Service("get_frame_names", "`semap.frame`", ("GET /maps/{name}/frames",)),
    Service("get_children", "`semap.frames_below`", ("GET /maps/{name}/frames",)),
    Service("get_env_children", "`semap.frames_below`", ("GET /maps/{name}/frames",)),
    Service("get_absolute_body_meshes", "`semap.body_of`", ("GET /maps/{name}/export",), "as glTF"),
    Service("db_create_tables", "", (), "`semap db migrate`"),
    Service("db_drop_tables", "", (), "`drop schema semap cascade`"),
    Service("db_truncate_tables", "", ("DELETE /maps/{name}",)),
    Service("db_write_graph", "", (), "`ARCHITECTURE.md` and the migrations"),
)

SERVICES = tuple(sorted((*_of_operators(), *OTHERS), key=lambda each: each.name))

HEAD = """# Operators

Made from the code by `python docs/reference/operators.py`; a test fails when it is out of date.

Each operator is one SQL function, to be called in any query, and is served by REST, many references to many
targets at once: `POST /maps/{name}/operators/{operator}` with

```json
{
  "references": {"concept": "Room"},
  "targets": {"filter": "isA('Chair') AND attributes.seats > 0"},
  "parameters": {"at_least": 6},
  "limit": 100
}
```

References and targets are chosen by `ids`, `names` (or aliases), `concept` (a name or an IRI, with what is
below it), `attributes` (that contain these) and `filter` (CQL2, OGC 21-065r2, text or JSON) over
`name`, `alias`, `concept`, `uid`, `id`, `storey`, `created_at`, `updated_at`, `footprint`, `position` and
`attributes.<key>`; all that is given must hold, and nothing given is everything on the map. In SQL,
`semap.instances('office', 'Room')` gives ids to hand to any of them; null targets are all on the map.
An instance is never paired with itself. What is missing in a filter is unknown, as null is in SQL.
"""


def operator_docs() -> str:
    """The document in Markdown."""
    lines = [HEAD]
    for title, operators in GROUPS.items():
        lines += [
            f"## {title}",
            "",
            "| operator | what it answers | parameters | columns |",
            "|---|---|---|---|",
        ]
        lines += [_operator_row(each) for each in operators]
        lines.append("")
    lines += [
        "## What stands for which service of SEMAP",
        "",
        "The ROS services that `semap_ros` offered, but for those that only tested or timed it.",
        "",
        "| SEMAP | SQL | REST |",
        "|---|---|---|",
        *(_service_row(each) for each in SERVICES),
        "",
    ]
    return "\n".join(lines)


def _operator_row(operator: Operator) -> str:
    takes = [
        role
        for role, name in (("references", operator.references), ("targets", operator.targets))
        if name is not None
    ]
    parameters = [f"*{each}*" for each in takes] + [_parameter(each) for each in operator.parameters]
    columns = ", ".join(f"`{each.name}`" for each in operator.columns)
    return f"| `{operator.sql}` | {operator.answers} | {'; '.join(parameters)} | {columns} |"


def _parameter(parameter: Parameter) -> str:
    known = " or ".join(parameter.choices) if len(parameter.choices) <= 4 else ""
    said = f"`{parameter.name}` {parameter.answers}" + (f" ({known})" if known else "")
    if parameter.required:
        return f"{said}, required"
    if parameter.default is None:
        return said
    default = parameter.default
    return f"{said}, default {str(default).lower() if isinstance(default, bool) else default}"


def _service_row(service: Service) -> str:
    rest = [f"`{each}`" for each in service.rest]
    if service.rest == (RUN,):
        names = [each.name for each in OPERATORS.values() if service.name in each.semap]
        rest = [f"`POST /maps/{{name}}/operators/{name}`" for name in names]
    said = "; ".join(part for part in (", ".join(rest), service.note) if part)
    return f"| `{service.name}` | {service.sql} | {said} |"


if __name__ == "__main__":
    sys.stdout.write(operator_docs())
