"""What leaves through the log: the map for mirrors; changes, rules and watermarks for the rule worker."""

from alembic import op

revision = "0005"
down_revision = "0004"

STATEMENTS = (
    """
    create publication semap_map
    for table semap.map, semap.concept, semap.concept_parent, semap.instance, semap.abstraction
    """,
    "create publication semap_change for table semap.relation_change with (publish = 'insert')",
    "create publication semap_rule for table semap.rule, semap.source, semap.map",
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
