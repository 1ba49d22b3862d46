import java.io.BufferedReader;
import java.io.DataOutputStream;
import java.io.BufferedOutputStream;
import java.io.FileOutputStream;
import java.io.InputStreamReader;
import java.time.Duration;
import java.util.List;
import java.util.Map;

import org.apache.flink.api.common.eventtime.WatermarkStrategy;
import org.apache.flink.api.common.typeinfo.TypeInformation;
import org.apache.flink.api.common.typeinfo.Types;
import org.apache.flink.api.connector.source.lib.NumberSequenceSource;
import org.apache.flink.api.java.tuple.Tuple2;
import org.apache.flink.api.java.tuple.Tuple4;
import org.apache.flink.cep.CEP;
import org.apache.flink.cep.functions.PatternProcessFunction;
import org.apache.flink.cep.nfa.aftermatch.AfterMatchSkipStrategy;
import org.apache.flink.cep.pattern.Pattern;
import org.apache.flink.cep.pattern.conditions.SimpleCondition;
import org.apache.flink.configuration.Configuration;
import org.apache.flink.configuration.MemorySize;
import org.apache.flink.configuration.TaskManagerOptions;
import org.apache.flink.streaming.api.datastream.DataStream;
import org.apache.flink.streaming.api.environment.StreamExecutionEnvironment;
import org.apache.flink.streaming.api.functions.sink.legacy.RichSinkFunction;
import org.apache.flink.table.api.DataTypes;
import org.apache.flink.table.api.Schema;
import org.apache.flink.table.api.bridge.java.StreamTableEnvironment;
import org.apache.flink.types.Row;
import org.apache.flink.util.Collector;

/**
 * How fast Flink finds `A B within 2 s`, with parallelism 1.
 *
 * Arguments: rows, keys. Each line read, "cep FILE" or "sql FILE", runs one job over the same rows and is
 * answered by "SECONDS MATCHES"; FILE gets the matches as pairs of big-endian ints (number of A's row, of B's).
 *
 * The rows are in memory before the job starts. The clock runs from the first row that the source hands over
 * until the sink has the last match, so that starting the job and the JVM are left out.
 */
public final class FlinkRate {
    private static Tuple4<Integer, Boolean, Long, Integer>[] rows;
    private static volatile long startedNs;
    private static volatile long endedNs;
    private static int[] matches;
    private static int found;

    public static void main(String[] arguments) throws Exception {
        makeRows(Integer.parseInt(arguments[0]), Integer.parseInt(arguments[1]));
        BufferedReader asked = new BufferedReader(new InputStreamReader(System.in));
        for (String line = asked.readLine(); line != null; line = asked.readLine()) {
            String[] words = line.split(" ", 2);
            found = 0;
            startedNs = 0;
            StreamExecutionEnvironment environment = environment();
            DataStream<Tuple4<Integer, Boolean, Long, Integer>> source = source(environment);
            (words[0].equals("sql") ? bySql(environment, source) : byCep(source)).addSink(new Collected());
            environment.execute();
            write(words[1]);
            System.out.println((endedNs - startedNs) / 1e9 + " " + found);
        }
    }

    /** The same rows as bench/rules.py: SplitMix64 of the number of the row gives its key and its type. */
    @SuppressWarnings("unchecked")
    private static void makeRows(int count, int keys) {
        rows = new Tuple4[count];
        matches = new int[2 * count];
        for (int number = 0; number < count; number++) {
            long mixed = (number + 1) * 0x9E3779B97F4A7C15L;
            mixed = (mixed ^ (mixed >>> 30)) * 0xBF58476D1CE4E5B9L;
            mixed = (mixed ^ (mixed >>> 27)) * 0x94D049BB133111EBL;
            mixed = mixed ^ (mixed >>> 31);
            rows[number] = Tuple4.of((int) ((mixed >>> 32) % keys), (mixed & 1) == 0, (long) number, number);
        }
    }

    private static StreamExecutionEnvironment environment() {
        Configuration settings = new Configuration();
        settings.set(TaskManagerOptions.NETWORK_MEMORY_MIN, MemorySize.ofMebiBytes(64));
        settings.set(TaskManagerOptions.MANAGED_MEMORY_SIZE, MemorySize.ofMebiBytes(64));
        StreamExecutionEnvironment environment = StreamExecutionEnvironment.createLocalEnvironment(1, settings);
        environment.getConfig().enableObjectReuse();
        return environment;
    }

    private static DataStream<Tuple4<Integer, Boolean, Long, Integer>> source(StreamExecutionEnvironment environment) {
        TypeInformation<Tuple4<Integer, Boolean, Long, Integer>> type =
                Types.TUPLE(Types.INT, Types.BOOLEAN, Types.LONG, Types.INT);
        return environment
                .fromSource(
                        new NumberSequenceSource(0, rows.length - 1),
                        WatermarkStrategy.<Long>forMonotonousTimestamps().withTimestampAssigner((number, before) -> number),
                        "rows")
                .map(number -> {
                    if (number == 0) {
                        startedNs = System.nanoTime();
                    }
                    return rows[number.intValue()];
                })
                .returns(type);
    }

    private static DataStream<Tuple2<Integer, Integer>> byCep(DataStream<Tuple4<Integer, Boolean, Long, Integer>> source) {
        Pattern<Tuple4<Integer, Boolean, Long, Integer>, ?> pattern =
                Pattern.<Tuple4<Integer, Boolean, Long, Integer>>begin("A", AfterMatchSkipStrategy.skipPastLastEvent())
                        .where(SimpleCondition.of(row -> row.f1))
                        .next("B")
                        .where(SimpleCondition.of(row -> !row.f1))
                        .within(Duration.ofSeconds(2));
        return CEP.pattern(source.keyBy(row -> row.f0), pattern).process(new Pairs());
    }

    private static DataStream<Tuple2<Integer, Integer>> bySql(
            StreamExecutionEnvironment environment, DataStream<Tuple4<Integer, Boolean, Long, Integer>> source) {
        StreamTableEnvironment tables = StreamTableEnvironment.create(environment);
        tables.createTemporaryView(
                "moves",
                source,
                Schema.newBuilder()
                        .column("f0", DataTypes.INT())
                        .column("f1", DataTypes.BOOLEAN())
                        .column("f3", DataTypes.INT())
                        .columnByMetadata("stamp", DataTypes.TIMESTAMP_LTZ(3), "rowtime")
                        .watermark("stamp", "SOURCE_WATERMARK()")
                        .build());
        return tables
                .toDataStream(tables.sqlQuery(
                        "select a, b from moves match_recognize (partition by f0 order by stamp"
                                + " measures A.f3 as a, B.f3 as b one row per match after match skip past last row"
                                + " pattern (A B) within interval '2' second define A as f1, B as not f1)"))
                .map(row -> Tuple2.of((Integer) row.getField(0), (Integer) row.getField(1)))
                .returns(Types.TUPLE(Types.INT, Types.INT));
    }

    private static final class Pairs
            extends PatternProcessFunction<Tuple4<Integer, Boolean, Long, Integer>, Tuple2<Integer, Integer>> {
        @Override
        public void processMatch(
                Map<String, List<Tuple4<Integer, Boolean, Long, Integer>>> match,
                Context context,
                Collector<Tuple2<Integer, Integer>> out) {
            out.collect(Tuple2.of(match.get("A").get(0).f3, match.get("B").get(0).f3));
        }
    }

    private static final class Collected extends RichSinkFunction<Tuple2<Integer, Integer>> {
        @Override
        public void invoke(Tuple2<Integer, Integer> pair, Context context) {
            matches[2 * found] = pair.f0;
            matches[2 * found + 1] = pair.f1;
            found++;
        }

        @Override
        public void finish() {
            endedNs = System.nanoTime();
        }
    }

    private static void write(String path) throws Exception {
        try (DataOutputStream file = new DataOutputStream(new BufferedOutputStream(new FileOutputStream(path)))) {
            for (int place = 0; place < 2 * found; place++) {
                file.writeInt(matches[place]);
            }
        }
    }
}
