"""Alembic's entry: migrate over the connection that semap.store.operate.schema hands in."""

from alembic import context

context.configure(
    connection=context.config.attributes["connection"],
    version_table="schema_version",
    version_table_schema="semap",
)
with context.begin_transaction():
    context.run_migrations()
