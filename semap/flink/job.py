"""The rules of all maps as a job of Flink: steps from a topic in, events to a topic out.

It runs in an interpreter that has PyFlink (`semap flink submit`). The rules of a map are a function keyed by
its uid. Their state is the entries of `MapRules` in Flink's own state, so that a checkpoint holds them, and
another number of tasks shares them out anew. Flink gives records and events at least once; `MapRules` passes
over records that it had, and events are known by their ids.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from pyflink.common import Configuration, Types, WatermarkStrategy
from pyflink.common.serialization import SimpleStringSchema
from pyflink.common.types import Row
from pyflink.datastream import KeyedProcessFunction, RuntimeContext, StreamExecutionEnvironment
from pyflink.datastream.connectors.kafka import KafkaOffsetsInitializer, KafkaSource
from pyflink.datastream.state import MapState, MapStateDescriptor
from pyflink.table import StreamTableEnvironment

from semap.rules.engine.map_rules import MapRules

NAME = "semap rules"
SINK = """
    create table events (map_uid string, said string) with (
      'connector' = 'kafka', 'topic' = '{topic}', 'properties.bootstrap.servers' = '{servers}',
      'key.format' = 'raw', 'key.fields' = 'map_uid', 'value.format' = 'raw',
      'value.fields-include' = 'EXCEPT_KEY', 'sink.delivery-guarantee' = 'at-least-once')
"""


class Rules(KeyedProcessFunction):  # type: ignore[misc]
    """Mutable: the rules of the maps whose keys this task has, as they were needed."""

    _entries: MapState

    def open(self, runtime_context: RuntimeContext) -> None:
        described = MapStateDescriptor("entries", Types.STRING(), Types.STRING())
        self._entries = runtime_context.get_map_state(described)
        self._maps: dict[str, MapRules] = {}

    def process_element(self, value: str, ctx: KeyedProcessFunction.Context) -> Iterator[Row]:
        map_uid = ctx.get_current_key()
        rules = self._maps.get(map_uid)
        if rules is None:
            rules = self._maps[map_uid] = MapRules(dict(self._entries.items()))
        for said in rules.take(value):
            yield Row(map_uid, said)
        for name, text in rules.changes().items():
            if text is None:
                self._entries.remove(name)
            else:
                self._entries.put(name, text)


def map_uid_of(text: str) -> str:
    """The map of a record, with which its head begins."""
    return text[: text.index(" ")]


def main() -> None:
    """Put the job together and run it until it is cancelled."""
    asked = _arguments()
    settings = Configuration()
    for setting in asked.set:
        name, _, value = setting.partition("=")
        settings.set_string(name, value)
    environment = StreamExecutionEnvironment.get_execution_environment(settings)
    tables = StreamTableEnvironment.create(environment)
    tables.get_config().set("pipeline.name", NAME)
    source = (
        KafkaSource.builder()
        .set_bootstrap_servers(asked.servers)
        .set_topics(f"{asked.prefix}.due")
        .set_starting_offsets(KafkaOffsetsInitializer.earliest())
        .set_value_only_deserializer(SimpleStringSchema())
        .build()
    )
    made = (
        environment.from_source(source, WatermarkStrategy.no_watermarks(), "steps")
        .uid("steps")
        .key_by(map_uid_of, key_type=Types.STRING())
        .process(Rules(), Types.ROW_NAMED(["map_uid", "said"], [Types.STRING(), Types.STRING()]))
        .uid("rules")
        .name("rules")
    )
    tables.execute_sql(SINK.format(topic=f"{asked.prefix}.events", servers=asked.servers))
    tables.create_temporary_view("made", tables.from_data_stream(made))
    tables.execute_sql("insert into events select map_uid, said from made").wait()


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="semap.flink.job")
    parser.add_argument("--servers", required=True)
    parser.add_argument("--prefix", required=True)
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    return parser.parse_args()


if __name__ == "__main__":
    main()
