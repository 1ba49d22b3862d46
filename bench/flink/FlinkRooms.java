import java.io.BufferedOutputStream;
import java.io.BufferedReader;
import java.io.DataOutputStream;
import java.io.FileInputStream;
import java.io.FileOutputStream;
import java.io.InputStreamReader;
import java.nio.ByteBuffer;
import java.nio.channels.FileChannel;
import java.util.ArrayList;
import java.util.HashMap;
import java.util.List;
import java.util.Map;
import java.util.concurrent.BlockingQueue;
import java.util.concurrent.CompletableFuture;
import java.util.concurrent.ConcurrentHashMap;
import java.util.concurrent.LinkedBlockingQueue;

import org.apache.flink.api.common.eventtime.Watermark;
import org.apache.flink.api.common.eventtime.WatermarkGenerator;
import org.apache.flink.api.common.eventtime.WatermarkOutput;
import org.apache.flink.api.common.eventtime.WatermarkStrategy;
import org.apache.flink.api.common.functions.MapFunction;
import org.apache.flink.api.common.typeinfo.Types;
import org.apache.flink.api.connector.source.lib.NumberSequenceSource;
import org.apache.flink.api.java.tuple.Tuple4;
import org.apache.flink.configuration.Configuration;
import org.apache.flink.configuration.MemorySize;
import org.apache.flink.configuration.TaskManagerOptions;
import org.apache.flink.core.execution.JobClient;
import org.apache.flink.streaming.api.datastream.DataStream;
import org.apache.flink.streaming.api.environment.StreamExecutionEnvironment;
import org.apache.flink.streaming.api.functions.sink.legacy.RichSinkFunction;
import org.apache.flink.table.api.DataTypes;
import org.apache.flink.table.api.Schema;
import org.apache.flink.table.api.bridge.java.StreamTableEnvironment;
import org.apache.flink.types.Row;

/**
 * Finds in which rooms tracks begin and end to be, by SQL with a Python function that says in which rooms a place is.
 *
 * Arguments: a file of states, a file of rooms, the Python to run, the file of the function (room_function.py), and
 * how many frames a bundle has: Python is given that many before it must have answered. The file of states, big
 * endian: int tracks, int frames; long id of each track; long stamp [us] of each frame; double x, y [m] of each track
 * of each frame.
 *
 * Each line read, "FUNCTION MODE COUNT FILE", lets the next COUNT frames through the job of that function and
 * python.execution-mode, which is started when it is first named. COUNT is a multiple of the bundle, since the source
 * stands still between two rounds, and with it what would finish a bundle after a while. It is answered by
 * "answer SECONDS CHANGES", or by "failed REASON". FILE gets the changes as longs: track, room, 1 for began or 0 for
 * ended, stamp [us].
 *
 * The states are in memory before. The clock runs from the first state that the source hands over, when all that it
 * feeds is up, until the watermark of the last frame is at the sink, behind the last change.
 */
public final class FlinkRooms {
    // How many states Python gets as one table.
    private static final int COLUMNS = 5_000;
    // The last states of a round wait that long for more to be sent with them.
    private static final long BUFFER_MS = 5;

    private static String[] given;
    private static long[] trackIds;
    private static long[] stampsUs;
    private static double[] places;
    // What the functions of a job, which Flink copies, have in common with who asks.
    private static final Map<String, Job> JOBS = new ConcurrentHashMap<>();

    public static void main(String[] arguments) throws Exception {
        given = arguments;
        read(arguments[0]);
        BufferedReader asked = new BufferedReader(new InputStreamReader(System.in));
        for (String line = asked.readLine(); line != null; line = asked.readLine()) {
            String[] words = line.split(" ", 4);
            try {
                Job job = JOBS.computeIfAbsent(words[0] + " " + words[1], Job::new);
                job.start(words[0], words[1]);
                job.feed(Integer.parseInt(words[2]));
                write(job.found, words[3]);
                System.out.println("answer " + (job.endedNs - job.startedNs) / 1e9 + " " + job.found.size());
            } catch (Exception failed) {
                Throwable cause = failed;
                while (cause.getCause() != null) {
                    cause = cause.getCause();
                }
                System.out.println("failed " + String.valueOf(cause.getMessage()).strip().replaceAll("\\s+", " "));
            }
        }
        for (Job job : JOBS.values()) {
            job.stop();
        }
        System.exit(0);
    }

    private static final class Job {
        private final String name;
        private final BlockingQueue<Long> rounds = new LinkedBlockingQueue<>();
        private final List<long[]> found = new ArrayList<>();
        private JobClient client;
        private CompletableFuture<?> ended;
        private int frames;
        private volatile long lastMs;
        private volatile long startedNs;
        private volatile long endedNs;
        private volatile CompletableFuture<Void> done;

        private Job(String name) {
            this.name = name;
        }

        private void start(String function, String mode) throws Exception {
            if (client == null) {
                client = submit(name, function, mode);
                ended = client.getJobExecutionResult();
            }
        }

        private void feed(int count) throws Exception {
            found.clear();
            done = new CompletableFuture<>();
            frames += count;
            lastMs = stampsUs[frames - 1] / 1000;
            rounds.add((long) frames * trackIds.length);
            CompletableFuture.anyOf(done, ended).get();
        }

        private void stop() {
            try {
                if (client != null) {
                    client.cancel().get();
                }
            } catch (Exception over) {
                // it has come to its end before, or failed, and said so
            }
        }
    }

    private static JobClient submit(String name, String function, String mode) throws Exception {
        StreamExecutionEnvironment environment = environment(mode);
        StreamTableEnvironment tables = StreamTableEnvironment.create(environment);
        // What plans the query asks these of the tables' settings, what runs it of the environment's.
        tables.getConfig().set("python.client.executable", given[2]);
        tables.getConfig().set("python.files", given[3]);
        tables.executeSql("create temporary system function rooms_at as '" + function + "' language python");
        states(name, environment, tables);
        tables.createTemporaryView(
                "located",
                tables.sqlQuery("select track_id, stamp, stamp_us, rooms_at(x_m, y_m) as rooms from states"));
        tables.createTemporaryView(
                "moved",
                tables.sqlQuery("select track_id, stamp_us, rooms, before from ("
                        + " select track_id, stamp_us, rooms,"
                        + "  lag(rooms) over (partition by track_id order by stamp) as before from located)"
                        + " where before is null or rooms <> before"));
        tables.toDataStream(tables.sqlQuery(
                        "select track_id, room, cast(1 as bigint) as began, stamp_us from moved cross join"
                                + " unnest(case when before is null then rooms else array_except(rooms, before) end)"
                                + " as entered (room)"
                                + " union all"
                                + " select track_id, room, cast(0 as bigint) as began, stamp_us from moved cross join"
                                + " unnest(array_except(before, rooms)) as gone (room)"))
                .addSink(new Collected(name));
        return environment.executeAsync();
    }

    private static StreamExecutionEnvironment environment(String mode) {
        Configuration settings = new Configuration();
        settings.set(TaskManagerOptions.NETWORK_MEMORY_MIN, MemorySize.ofMebiBytes(64));
        settings.set(TaskManagerOptions.MANAGED_MEMORY_SIZE, MemorySize.ofMebiBytes(256));
        Map<String, String> python = new HashMap<>();
        python.put("python.execution-mode", mode);
        python.put("python.executable", given[2]);
        python.put("python.files", given[3]);
        python.put("python.fn-execution.bundle.size", String.valueOf(Integer.parseInt(given[4]) * trackIds.length));
        // A bundle that time finished would shift all that follow.
        python.put("python.fn-execution.bundle.time", "86400000");
        python.put("python.fn-execution.arrow.batch.size", String.valueOf(COLUMNS));
        python.put("pipeline.global-job-parameters", "rooms:" + given[1]);
        python.forEach(settings::setString);
        StreamExecutionEnvironment environment = StreamExecutionEnvironment.createLocalEnvironment(1, settings);
        environment.getConfig().enableObjectReuse();
        environment.setBufferTimeout(BUFFER_MS);
        return environment;
    }

    private static void states(
            String name, StreamExecutionEnvironment environment, StreamTableEnvironment tables) {
        long last = (long) trackIds.length * stampsUs.length - 1;
        DataStream<Tuple4<Long, Long, Double, Double>> source = environment
                .fromSource(
                        new NumberSequenceSource(0, last),
                        WatermarkStrategy.<Long>forGenerator(context -> new EachFrame())
                                .withTimestampAssigner((row, before) -> stampUs(row) / 1000),
                        "states")
                .map(new Handed(name))
                .returns(Types.TUPLE(Types.LONG, Types.LONG, Types.DOUBLE, Types.DOUBLE));
        tables.createTemporaryView(
                "states",
                source,
                Schema.newBuilder()
                        .column("f0", DataTypes.BIGINT())
                        .column("f1", DataTypes.BIGINT())
                        .column("f2", DataTypes.DOUBLE())
                        .column("f3", DataTypes.DOUBLE())
                        .columnByExpression("track_id", "f0")
                        .columnByExpression("stamp_us", "f1")
                        .columnByExpression("x_m", "f2")
                        .columnByExpression("y_m", "f3")
                        .columnByMetadata("stamp", DataTypes.TIMESTAMP_LTZ(3), "rowtime")
                        .watermark("stamp", "SOURCE_WATERMARK()")
                        .build());
    }

    private static long stampUs(long row) {
        return stampsUs[(int) (row / trackIds.length)];
    }

    /** A watermark after the last state of each frame. */
    private static final class EachFrame implements WatermarkGenerator<Long> {
        @Override
        public void onEvent(Long row, long stampMs, WatermarkOutput output) {
            if ((row + 1) % trackIds.length == 0) {
                output.emitWatermark(new Watermark(stampMs));
            }
        }

        @Override
        public void onPeriodicEmit(WatermarkOutput output) {}
    }

    /** Waits before the first state of a round until that is asked for. */
    private static final class Handed implements MapFunction<Long, Tuple4<Long, Long, Double, Double>> {
        private final String name;
        private long until;

        private Handed(String name) {
            this.name = name;
        }

        @Override
        public Tuple4<Long, Long, Double, Double> map(Long row) throws InterruptedException {
            if (row == until) {
                Job job = JOBS.get(name);
                until = job.rounds.take();
                job.startedNs = System.nanoTime();
            }
            int place = 2 * row.intValue();
            long trackId = trackIds[(int) (row % trackIds.length)];
            return Tuple4.of(trackId, stampUs(row), places[place], places[place + 1]);
        }
    }

    private static final class Collected extends RichSinkFunction<Row> {
        private final String name;

        private Collected(String name) {
            this.name = name;
        }

        @Override
        public void invoke(Row change, Context context) {
            long room = (Integer) change.getField(1);
            JOBS.get(name).found.add(new long[] {
                (Long) change.getField(0), room, (Long) change.getField(2), (Long) change.getField(3)
            });
        }

        @Override
        public void writeWatermark(Watermark watermark) {
            Job job = JOBS.get(name);
            if (watermark.getTimestamp() >= job.lastMs) {
                job.endedNs = System.nanoTime();
                job.done.complete(null);
            }
        }
    }

    private static void read(String path) throws Exception {
        try (FileChannel file = new FileInputStream(path).getChannel()) {
            ByteBuffer bytes = file.map(FileChannel.MapMode.READ_ONLY, 0, file.size());
            trackIds = new long[bytes.getInt()];
            stampsUs = new long[bytes.getInt()];
            places = new double[2 * trackIds.length * stampsUs.length];
            bytes.asLongBuffer().get(trackIds).get(stampsUs);
            bytes.position(bytes.position() + 8 * (trackIds.length + stampsUs.length));
            bytes.asDoubleBuffer().get(places);
        }
    }

    private static void write(List<long[]> changes, String path) throws Exception {
        try (DataOutputStream file = new DataOutputStream(new BufferedOutputStream(new FileOutputStream(path)))) {
            for (long[] change : changes) {
                for (long value : change) {
                    file.writeLong(value);
                }
            }
        }
    }
}
