import java.util.ArrayList;
import java.util.List;
import java.util.Objects;

import org.apache.flink.cep.pattern.conditions.IterativeCondition;
import org.apache.flink.shaded.jackson2.com.fasterxml.jackson.databind.JsonNode;
import org.apache.flink.shaded.jackson2.com.fasterxml.jackson.databind.ObjectMapper;

/**
 * A condition made from JSON, true, false or null (unknown) as in SQL.
 *
 *   ["value", 1]  ["property", "type"]  ["and", a, b]  ["or", a, b]  ["not", a]
 *   ["=", a, b] and so for <> < <= > >= + - *
 *   ["last", "A", "occupants"] and so for first count sum avg min max
 *
 * The row that is asked about counts as bound to its own variable, as in SQL.
 */
final class FlinkCondition extends IterativeCondition<FlinkCases.Item> {
    private static final int MOST_STAGES_OF_A_VARIABLE = 4;
    private static final ObjectMapper JSON = new ObjectMapper();

    private final String variable;
    private final String text;
    private transient JsonNode tree;

    FlinkCondition(String variable, String text) {
        this.variable = variable;
        this.text = text;
    }

    @Override
    public boolean filter(FlinkCases.Item row, Context<FlinkCases.Item> context) throws Exception {
        if (tree == null) {
            tree = JSON.readTree(text);
        }
        return Boolean.TRUE.equals(value(tree, row, context));
    }

    private Object value(JsonNode node, FlinkCases.Item row, Context<FlinkCases.Item> context) throws Exception {
        String word = node.get(0).asText();
        switch (word) {
            case "value":
                return literal(node.get(1));
            case "property":
                return property(row, node.get(1).asText());
            case "and":
            case "or":
                return junction(word.equals("or"), node, row, context);
            case "not":
                Boolean inner = (Boolean) value(node.get(1), row, context);
                return inner == null ? null : !inner;
            case "first":
            case "last":
            case "count":
            case "sum":
            case "avg":
            case "min":
            case "max":
                return navigated(word, bound(node.get(1).asText(), row, context), node.path(2).asText());
            default:
                return operated(word, value(node.get(1), row, context), value(node.get(2), row, context));
        }
    }

    private static Object literal(JsonNode node) {
        if (node.isNumber()) {
            return node.asDouble();
        }
        return node.isBoolean() ? (Object) node.asBoolean() : node.isNull() ? null : node.asText();
    }

    private static Object property(FlinkCases.Item row, String name) {
        return switch (name) {
            case "type" -> row.type;
            case "occupants" -> row.occupants;
            case "stamp" -> (double) row.millis;
            default -> throw new IllegalArgumentException("There is no property " + name);
        };
    }

    /** Kleene's and, or: the deciding value decides, else null spreads. */
    private Object junction(boolean deciding, JsonNode node, FlinkCases.Item row, Context<FlinkCases.Item> context)
            throws Exception {
        boolean unknown = false;
        for (int place = 1; place < node.size(); place++) {
            Boolean part = (Boolean) value(node.get(place), row, context);
            if (part == null) {
                unknown = true;
            } else if (part == deciding) {
                return deciding;
            }
        }
        return unknown ? null : !deciding;
    }

    private List<FlinkCases.Item> bound(String name, FlinkCases.Item row, Context<FlinkCases.Item> context)
            throws Exception {
        List<FlinkCases.Item> items = new ArrayList<>();
        context.getEventsForPattern(name).forEach(items::add);
        for (int place = 2; place <= MOST_STAGES_OF_A_VARIABLE; place++) {
            context.getEventsForPattern(name + "#" + place).forEach(items::add);
        }
        if (name.equals(variable)) {
            items.add(row);
        }
        items.sort((a, b) -> Integer.compare(a.number, b.number));
        return items;
    }

    private static Object navigated(String word, List<FlinkCases.Item> items, String name) {
        if (word.equals("count")) {
            return (double) items.size();
        }
        if (items.isEmpty()) {
            return null;
        }
        if (word.equals("first") || word.equals("last")) {
            return property(items.get(word.equals("first") ? 0 : items.size() - 1), name);
        }
        var numbers = items.stream().map(item -> property(item, name)).filter(Objects::nonNull).mapToDouble(n -> (Double) n);
        var summary = numbers.summaryStatistics();
        if (summary.getCount() == 0) {
            return null;
        }
        return switch (word) {
            case "sum" -> summary.getSum();
            case "avg" -> summary.getAverage();
            case "min" -> summary.getMin();
            default -> summary.getMax();
        };
    }

    private static Object operated(String word, Object left, Object right) {
        if (left == null || right == null) {
            return null;
        }
        if (left instanceof String) {
            int order = ((String) left).compareTo((String) right);
            return compared(word, order);
        }
        double a = (Double) left;
        double b = (Double) right;
        return switch (word) {
            case "+" -> a + b;
            case "-" -> a - b;
            case "*" -> a * b;
            default -> compared(word, Double.compare(a, b));
        };
    }

    private static Object compared(String word, int order) {
        return switch (word) {
            case "=" -> order == 0;
            case "<>" -> order != 0;
            case "<" -> order < 0;
            case "<=" -> order <= 0;
            case ">" -> order > 0;
            case ">=" -> order >= 0;
            default -> throw new IllegalArgumentException("There is no operator " + word);
        };
    }
}
