import java.io.BufferedReader;
import java.io.InputStreamReader;
import java.util.ArrayList;
import java.util.List;
import java.util.Map;
import java.util.Queue;
import java.util.TreeMap;
import java.util.concurrent.ConcurrentLinkedQueue;

import org.apache.flink.api.common.eventtime.WatermarkStrategy;
import org.apache.flink.cep.CEP;
import org.apache.flink.cep.functions.PatternProcessFunction;
import org.apache.flink.cep.functions.TimedOutPartialMatchHandler;
import org.apache.flink.configuration.Configuration;
import org.apache.flink.configuration.MemorySize;
import org.apache.flink.configuration.TaskManagerOptions;
import org.apache.flink.shaded.jackson2.com.fasterxml.jackson.databind.JsonNode;
import org.apache.flink.shaded.jackson2.com.fasterxml.jackson.databind.ObjectMapper;
import org.apache.flink.streaming.api.datastream.DataStream;
import org.apache.flink.streaming.api.environment.StreamExecutionEnvironment;
import org.apache.flink.streaming.api.functions.sink.legacy.SinkFunction;
import org.apache.flink.table.api.DataTypes;
import org.apache.flink.table.api.Schema;
import org.apache.flink.table.api.bridge.java.StreamTableEnvironment;
import org.apache.flink.types.Row;
import org.apache.flink.util.Collector;

/**
 * Answers cases of row patterns with what Flink itself finds.
 *
 * Reads one case a line, JSON, and writes one answer a line:
 *
 *   {"id": "1", "streams": [[[stamp in ms, type, occupants], ...], ...], "pattern": see FlinkPattern.java}
 *   {"id": "2", "streams": [...], "sql": "select ... from %s match_recognize (...)", "variables": ["A", ...]}
 *   -> {"id": "1", "streams": [{"matches": [{"A": [1, 2]}, ...], "timeouts": [...]}, ...]},
 *      or {"id": "1", "error": "..."}
 *
 * Each stream is a key of its own; its rows are counted from 1. A query gives the column `stream` and one text
 * column for each variable: the numbers of its rows, by commas.
 * Many cases share one job, since starting a job costs more than a case; one that may fail ("may_fail": true) has
 * its own. Where a job fails, its cases are run again in halves, so that one cannot spoil another's answer.
 */
public final class FlinkCases {
    private static final int CASES_A_JOB = 100;
    private static final ObjectMapper JSON = new ObjectMapper();
    private static final Queue<Found> FOUND = new ConcurrentLinkedQueue<>();
    private static int views;

    private record Found(String id, int stream, String kind, Map<String, List<Integer>> rows) {}

    /** What a case's rows are to Flink: a bean of public fields. */
    public static final class Item {
        public int stream;
        public int number;
        public long millis;
        public String type;
        public Double occupants;
    }

    public static void main(String[] arguments) throws Exception {
        List<JsonNode> cases = new ArrayList<>();
        BufferedReader asked = new BufferedReader(new InputStreamReader(System.in));
        for (String line = asked.readLine(); line != null; line = asked.readLine()) {
            JsonNode one = JSON.readTree(line);
            if (one.path("may_fail").asBoolean()) {
                answer(List.of(one));
            } else {
                cases.add(one);
            }
        }
        for (int from = 0; from < cases.size(); from += CASES_A_JOB) {
            answer(cases.subList(from, Math.min(from + CASES_A_JOB, cases.size())));
        }
    }

    private static void answer(List<JsonNode> cases) throws Exception {
        FOUND.clear();
        StreamExecutionEnvironment environment = environment();
        StreamTableEnvironment tables = StreamTableEnvironment.create(environment);
        List<JsonNode> running = new ArrayList<>();
        for (JsonNode one : cases) {
            try {
                if (one.has("sql")) {
                    query(one, environment, tables);
                } else {
                    match(one, environment);
                }
                running.add(one);
            } catch (Exception refused) {
                fail(one, refused);
            }
        }
        if (running.isEmpty()) {
            return;
        }
        try {
            environment.execute();
        } catch (Exception failed) {
            if (running.size() == 1) {
                fail(running.get(0), failed);
            } else {
                answer(running.subList(0, running.size() / 2));
                answer(running.subList(running.size() / 2, running.size()));
            }
            return;
        }
        for (JsonNode one : running) {
            succeed(one);
        }
    }

    private static StreamExecutionEnvironment environment() {
        Configuration settings = new Configuration();
        settings.set(TaskManagerOptions.NETWORK_MEMORY_MIN, MemorySize.ofMebiBytes(128));
        settings.set(TaskManagerOptions.MANAGED_MEMORY_SIZE, MemorySize.ofMebiBytes(64));
        return StreamExecutionEnvironment.createLocalEnvironment(1, settings);
    }

    private static DataStream<Item> rows(JsonNode one, StreamExecutionEnvironment environment) {
        List<Item> items = new ArrayList<>();
        for (int stream = 0; stream < one.get("streams").size(); stream++) {
            int number = 0;
            for (JsonNode row : one.get("streams").get(stream)) {
                Item item = new Item();
                item.stream = stream;
                item.number = ++number;
                item.millis = row.get(0).asLong();
                item.type = row.get(1).asText();
                item.occupants = row.get(2).isNull() ? null : row.get(2).asDouble();
                items.add(item);
            }
        }
        return environment
                .fromData(Item.class, items.toArray(new Item[0]))
                .assignTimestampsAndWatermarks(
                        WatermarkStrategy.<Item>noWatermarks().withTimestampAssigner((item, before) -> item.millis));
    }

    private static void match(JsonNode one, StreamExecutionEnvironment environment) {
        DataStream<Item> keyed = rows(one, environment).keyBy(item -> item.stream);
        // Rows of one stamp come in the order in which they are written.
        CEP.pattern(keyed, FlinkPattern.build(one.get("pattern")), (a, b) -> Integer.compare(a.number, b.number))
                .process(new Finder(one.get("id").asText()))
                .addSink(new Nowhere<>());
    }

    private static void query(JsonNode one, StreamExecutionEnvironment environment, StreamTableEnvironment tables) {
        String view = "rows_" + views++;
        tables.createTemporaryView(
                view,
                rows(one, environment),
                Schema.newBuilder()
                        .column("stream", DataTypes.INT())
                        .column("number", DataTypes.INT())
                        .column("type", DataTypes.STRING())
                        .column("occupants", DataTypes.DOUBLE())
                        .columnByMetadata("stamp", DataTypes.TIMESTAMP_LTZ(3), "rowtime")
                        .watermark("stamp", "SOURCE_WATERMARK()")
                        .build());
        List<String> variables = new ArrayList<>();
        one.get("variables").forEach(name -> variables.add(name.asText()));
        String id = one.get("id").asText();
        tables.toDataStream(tables.sqlQuery(String.format(one.get("sql").asText(), view)))
                .addSink(new QuerySink(id, variables));
    }

    private static final class Finder extends PatternProcessFunction<Item, String>
            implements TimedOutPartialMatchHandler<Item> {
        private final String id;

        Finder(String id) {
            this.id = id;
        }

        @Override
        public void processMatch(Map<String, List<Item>> match, Context context, Collector<String> out) {
            note("matches", match);
        }

        @Override
        public void processTimedOutMatch(Map<String, List<Item>> match, Context context) {
            note("timeouts", match);
        }

        private void note(String kind, Map<String, List<Item>> match) {
            Map<String, List<Integer>> rows = new TreeMap<>();
            match.forEach((stage, items) -> {
                List<Integer> numbers = rows.computeIfAbsent(FlinkPattern.variable(stage), name -> new ArrayList<>());
                items.forEach(item -> numbers.add(item.number));
                numbers.sort(null);
            });
            int stream = match.values().iterator().next().get(0).stream;
            FOUND.add(new Found(id, stream, kind, rows));
        }
    }

    private static final class QuerySink implements SinkFunction<Row> {
        private final String id;
        private final List<String> variables;

        QuerySink(String id, List<String> variables) {
            this.id = id;
            this.variables = variables;
        }

        @Override
        public void invoke(Row row, Context context) {
            Map<String, List<Integer>> rows = new TreeMap<>();
            for (int place = 0; place < variables.size(); place++) {
                Object numbers = row.getField(place + 1);
                if (numbers == null || numbers.toString().isEmpty()) {
                    continue;
                }
                List<Integer> bound = rows.computeIfAbsent(variables.get(place), name -> new ArrayList<>());
                for (String number : numbers.toString().split(",")) {
                    bound.add(Integer.parseInt(number));
                }
            }
            FOUND.add(new Found(id, (Integer) row.getField(0), "matches", rows));
        }
    }

    private static final class Nowhere<T> implements SinkFunction<T> {
        @Override
        public void invoke(T value, Context context) {}
    }

    private static void succeed(JsonNode one) throws Exception {
        String id = one.get("id").asText();
        List<Map<String, Object>> streams = new ArrayList<>();
        for (int place = 0; place < one.get("streams").size(); place++) {
            int stream = place;
            Map<String, Object> said = new TreeMap<>();
            for (String kind : List.of("matches", "timeouts")) {
                said.put(kind, FOUND.stream()
                        .filter(found -> found.id.equals(id) && found.stream == stream && found.kind.equals(kind))
                        .map(Found::rows)
                        .toList());
            }
            streams.add(said);
        }
        System.out.println(JSON.writeValueAsString(new TreeMap<>(Map.of("id", id, "streams", streams))));
    }

    private static void fail(JsonNode one, Throwable thrown) throws Exception {
        Throwable cause = thrown;
        while (cause.getCause() != null) {
            cause = cause.getCause();
        }
        System.out.println(JSON.writeValueAsString(new TreeMap<>(Map.of("id", one.get("id").asText(), "error", cause.toString()))));
    }
}
