import java.time.Duration;

import org.apache.flink.cep.nfa.aftermatch.AfterMatchSkipStrategy;
import org.apache.flink.cep.pattern.Pattern;
import org.apache.flink.cep.pattern.WithinType;
import org.apache.flink.shaded.jackson2.com.fasterxml.jackson.databind.JsonNode;

/**
 * A FlinkCEP pattern made from JSON.
 *
 *   pattern  {"stages": [stage, ...], "within_ms": n, "step_ms": n, "skip": ["to first", "A"]}
 *   stage    {"name": "A" or "A#2", or "stages": [...] of a group,
 *             "joint": "next" | "relaxed" | "any", "absent": bool, "where": see FlinkCondition.java,
 *             "times": [least, most or null], "between": joint, "greedy": bool, "until": condition}
 *
 * A stage whose least is 0 is optional. What is after # tells stages of one variable apart, since Flink wants
 * each name once.
 */
final class FlinkPattern {
    private FlinkPattern() {}

    static String variable(String stage) {
        return stage.split("#")[0];
    }

    static Pattern<FlinkCases.Item, ?> build(JsonNode document) {
        Pattern<FlinkCases.Item, FlinkCases.Item> pattern =
                sequence(document.get("stages"), skip(document.get("skip")), document.path("step_ms").asLong());
        if (document.hasNonNull("within_ms")) {
            pattern = pattern.within(Duration.ofMillis(document.get("within_ms").asLong()));
        }
        return pattern;
    }

    private static AfterMatchSkipStrategy skip(JsonNode words) {
        return switch (words.get(0).asText()) {
            case "none" -> AfterMatchSkipStrategy.noSkip();
            case "to next" -> AfterMatchSkipStrategy.skipToNext();
            case "past last" -> AfterMatchSkipStrategy.skipPastLastEvent();
            case "to first" -> AfterMatchSkipStrategy.skipToFirst(words.get(1).asText());
            case "to last" -> AfterMatchSkipStrategy.skipToLast(words.get(1).asText());
            default -> throw new IllegalArgumentException("There is no way to skip " + words);
        };
    }

    private static Pattern<FlinkCases.Item, FlinkCases.Item> sequence(
            JsonNode stages, AfterMatchSkipStrategy skip, long stepMs) {
        Pattern<FlinkCases.Item, FlinkCases.Item> pattern = null;
        for (JsonNode stage : stages) {
            pattern = stage.has("stages") ? group(pattern, stage, skip, stepMs) : single(pattern, stage, skip);
            pattern = repeated(pattern, stage);
            if (stepMs > 0) {
                // it counts for the stage it is set at, from the event before
                pattern = pattern.within(Duration.ofMillis(stepMs), WithinType.PREVIOUS_AND_CURRENT);
            }
        }
        return pattern;
    }

    private static Pattern<FlinkCases.Item, FlinkCases.Item> group(
            Pattern<FlinkCases.Item, FlinkCases.Item> before, JsonNode stage, AfterMatchSkipStrategy skip, long stepMs) {
        Pattern<FlinkCases.Item, FlinkCases.Item> inner = sequence(stage.get("stages"), skip, stepMs);
        if (before == null) {
            return Pattern.begin(inner, skip);
        }
        return switch (stage.get("joint").asText()) {
            case "next" -> before.next(inner);
            case "relaxed" -> before.followedBy(inner);
            default -> before.followedByAny(inner);
        };
    }

    private static Pattern<FlinkCases.Item, FlinkCases.Item> single(
            Pattern<FlinkCases.Item, FlinkCases.Item> before, JsonNode stage, AfterMatchSkipStrategy skip) {
        String name = stage.get("name").asText();
        String joint = stage.get("joint").asText();
        Pattern<FlinkCases.Item, FlinkCases.Item> pattern;
        if (before == null) {
            pattern = Pattern.begin(name, skip);
        } else if (stage.path("absent").asBoolean()) {
            pattern = joint.equals("next") ? before.notNext(name) : before.notFollowedBy(name);
        } else {
            pattern = switch (joint) {
                case "next" -> before.next(name);
                case "relaxed" -> before.followedBy(name);
                default -> before.followedByAny(name);
            };
        }
        return pattern.where(new FlinkCondition(variable(name), stage.get("where").toString()));
    }

    private static Pattern<FlinkCases.Item, FlinkCases.Item> repeated(
            Pattern<FlinkCases.Item, FlinkCases.Item> pattern, JsonNode stage) {
        if (!stage.has("times")) {
            return pattern;
        }
        int least = stage.get("times").get(0).asInt();
        JsonNode most = stage.get("times").get(1);
        boolean once = !most.isNull() && most.asInt() == 1;
        if (most.isNull()) {
            pattern = least > 1 ? pattern.timesOrMore(least) : pattern.oneOrMore();
        } else if (!once) {
            pattern = pattern.times(Math.max(least, 1), most.asInt());
        }
        if (!once && stage.get("between").asText().equals("next")) {
            pattern = pattern.consecutive();
        } else if (!once && stage.get("between").asText().equals("any")) {
            pattern = pattern.allowCombinations();
        }
        if (stage.path("greedy").asBoolean() && !once) {
            pattern = pattern.greedy();
        }
        if (stage.hasNonNull("until")) {
            pattern = pattern.until(new FlinkCondition("", stage.get("until").toString()));
        }
        return least == 0 ? pattern.optional() : pattern;
    }
}
