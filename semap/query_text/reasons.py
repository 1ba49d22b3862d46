"""What a continuous query cannot say: the reason of each refusal, and what to write instead."""

from __future__ import annotations

from collections.abc import Mapping

LONGEST = 20_000
"""Characters of a text."""
DEEPEST = 50
"""Levels of an expression."""

REASONS: Mapping[str, tuple[str, str]] = {
    # the text as a whole
    "too long": (f"the text has more than {LONGEST:,} characters", "Ask for less, or make several queries."),
    "too deep": (f"expressions are nested deeper than {DEEPEST} levels", "Ask for less."),
    "bytes": ("the text holds {what}, which PostgreSQL does not take", "Leave it out."),
    "syntax": ("this is not SQL: {what}", "See the documentation of SELECT in PostgreSQL."),
    "quoted": (
        "this is not SQL: {what}",
        'The word is one of SQL\'s own: write the view as "{view}", in quotes.',
    ),
    "empty": ("there is no statement", "Write a SELECT over track and a view of the map."),
    "several": ("there is more than one statement", "Make a continuous query of each."),
    "no select": ("a continuous query is a SELECT, and this is {what}", "Write a SELECT."),
    "set": ("a union of queries is not one relation", "Make a continuous query of each SELECT."),
    "with": ("common table expressions (WITH) are not taken apart", "Name the views in FROM themselves."),
    "values": ("a list of values is neither a track nor an instance", "Name a view in FROM."),
    "into": ("a continuous query writes no table", "Leave INTO out: the result is a table of its own."),
    "group": (
        "groups are not kept incrementally",
        "Leave GROUP BY and HAVING out, and group what you read of the result.",
    ),
    "aggregate": (
        "{what} aggregates, which is not kept incrementally",
        "Select columns, and aggregate what you read of the result.",
    ),
    "window": (
        "window functions are not kept incrementally",
        "Select columns, and number what you read of the result.",
    ),
    "distinct": ("DISTINCT is not needed: a pair is in the result once", "Leave DISTINCT out."),
    "order": (
        "a result that is kept has no order",
        "Leave ORDER BY out, and order what you read of the result.",
    ),
    "limit": (
        "a limit of the whole result is not kept incrementally",
        "For the nearest ones: lateral (select * from room r order by r.footprint <-> t.position limit 3) n.",
    ),
    "offset": ("OFFSET leaves out the nearest, which is not kept incrementally", "Leave OFFSET out."),
    "ties": ("WITH TIES makes it unknown how many the nearest are", "Write: limit 3."),
    "locking": ("a continuous query locks no rows", "Leave FOR UPDATE or FOR SHARE out."),
    # FROM
    "no view": ("there is no view {what}", "{hint}"),
    "shared view": (
        "the concepts {what} have one name in SQL",
        "Write: from instance i, and: where semap.is_a(i.concept, '{first}').",
    ),
    "schema": ("there is no schema {what} here", "The views are in semap_query; leave the schema out."),
    "one view": ("a relation is between two sides, and FROM names {what}", "Name two: from track t, room r."),
    "outer join": (
        "an outer join also gives rows without a relation, which are not kept",
        "Write JOIN, or a comma.",
    ),
    "using": (
        "NATURAL and USING join by equal columns, which is no spatial relation",
        "Write JOIN ... ON ST_Contains(r.footprint, t.position).",
    ),
    "range": (
        "{what} in FROM is neither a track nor an instance",
        "Name a view: track, instance, or that of a concept.",
    ),
    "renamed": (
        "columns that are renamed in FROM are not followed",
        "Rename them in SELECT: r.name as room.",
    ),
    "alias twice": ("two tables are called {what}", "Give each a name of its own: track a, track b."),
    "subquery": (
        "a subquery is understood in FROM only",
        "Name the view in FROM, and its conditions in WHERE.",
    ),
    "inner subquery": (
        "a subquery in FROM is of one view",
        "Write: lateral (select * from room r where ...) n.",
    ),
    "not lateral": ("the subquery reads {what} without the word LATERAL", "Write: lateral (select ...)."),
    "after limit": (
        "a condition on what is nearest comes too late: others would not take its place",
        "Write it in the subquery, before ORDER BY.",
    ),
    "no limit": (
        "ORDER BY without LIMIT in a subquery changes nothing",
        "Write LIMIT with how many, or leave ORDER BY out.",
    ),
    "unordered limit": (
        "LIMIT without ORDER BY takes any",
        "Write: order by r.footprint <-> t.position limit 3.",
    ),
    "limit count": ("the number of the nearest is no whole number from 1 to 100", "Write: limit 3."),
    "farthest": ("the farthest are not kept", "Leave DESC out for the nearest."),
    "order by": (
        "the nearest are ordered by one distance between the two sides",
        "Write: order by r.footprint <-> t.position limit 3.",
    ),
    # SELECT
    "no columns": ("nothing is selected", "Name columns, or *."),
    "column": ("there is no column {what}", "{hint}"),
    "ambiguous": ("both sides have a column {what}", "Write whose it is: {first}.{what} or {second}.{what}."),
    "no table": ("FROM names no {what}", "There are {hint}."),
    "not selected": ("the subquery does not select {what}", "Write: select * in the subquery."),
    "computed": (
        "the payload has columns only; this is computed",
        "Select the columns that it needs, and compute from what you read of the result.",
    ),
    "whole row": ("a row as a whole is not a column", "Write {what}.*, or name columns."),
    "same name": ("two columns are called {what}", "Give one a name of its own: r.name as room."),
    # the relation
    "no relation": (
        "no spatial relation ties the two sides together",
        "Write one in WHERE, such as ST_Contains(r.footprint, t.position).",
    ),
    "two relations": (
        "there are two spatial relations; one query keeps one",
        "Make a continuous query of each, and join them in a rule.",
    ),
    "or relation": (
        "OR around a spatial relation is not kept incrementally",
        "Make a continuous query of each.",
    ),
    "not relation": (
        "that a relation does not hold is not kept: it would be nearly all pairs",
        "Keep the relation, and look for its ends.",
    ),
    "within expression": (
        "a spatial relation within another expression is not kept",
        "Write it by itself, tied to the rest by AND.",
    ),
    "beyond": (
        "that something is farther away than a distance is not kept: it would be nearly all pairs",
        "Write: ST_DWithin(a, b, 2), and look for its ends.",
    ),
    "distance": (
        "a distance is compared with a number",
        "Write: ST_DWithin(a, b, 2) or ST_Distance(a, b) <= 2.",
    ),
    "number": ("{what} is a number that is written out, and {range}", "Write it as a number, such as 2.5."),
    "arguments": ("{what} takes {count}", "Write: {usage}."),
    "unkept predicate": ("the relation {what} is not kept", "{hint}"),
    "fixed area": (
        "a relation to a shape that is written out is not kept",
        "Put it on the map as an instance, such as a zone, and name its view in FROM.",
    ),
    "one side": (
        "the relation is of one side with itself",
        "Relate the two sides: ST_Contains(r.footprint, t.position).",
    ),
    "not a shape": ("{what} is compared as a shape and is none", "Name a shape: {hint}."),
    "derived shape": (
        "a shape that is computed first is not kept",
        "Compare the columns themselves; for a margin use ST_DWithin.",
    ),
    "track inside": (
        "a track is no area that others can be in",
        "Swap the two: ST_Contains(r.footprint, t.position).",
    ),
    "point inside": ("a position is a point, in which nothing lies", "Compare an area: {what}.footprint."),
    "track shape": ("here a track is where its position is", "Write {what}.position."),
    "track point": (
        "a track as a point meets an area where it lies in it",
        "Write ST_Covers(r.footprint, t.position), or compare {what}.footprint.",
    ),
    "two abstractions": (
        "one query compares one abstraction, and these are {what}",
        "Compare the same column of both sides.",
    ),
    "flat": (
        "{what} has no heights, which {function} compares",
        "Write: is_near(t, r, 1), or compare position_3d.",
    ),
    "shell": (
        "to {function} {what} is a hollow shell",
        "Write: is_near(t, r, 1), to which it is a solid, or compare position_3d.",
    ),
    "solid": (
        "{what} has heights, which {function} does not compare",
        "Compare footprint, or write: is_near(t, r, 1).",
    ),
    "rows": ("{what} takes both sides as they are", "Write: {usage}."),
    "object track": ("{what}: its object is an instance, and this is a track", "Write: {usage}."),
    "subject instance": ("{what}: its subject is a track, and this is an instance", "Write: {usage}."),
    "itself": ("each would be related to itself", "Add: and {first}.id <> {second}.id."),
    "half pairs": ("of each pair both are the subject once", "Write: {first}.id <> {second}.id."),
    # conditions
    "no column": ("this is no condition on a track or an instance", "Leave it out."),
    "between sides": (
        "this ties the two sides by something that is not spatial",
        "Compare each side with values, or look at both in a rule.",
    ),
    "heights": (
        "this ties heights of the two sides together",
        "Write: is_in(t, r), which compares heights, too.",
    ),
    "moving": (
        "{what} changes with each state of a track, and so would the set of tracks",
        "Leave it out here, and use a rule for it.",
    ),
    "shape condition": ("{what} is a shape, and conditions are on names and attributes", "Leave it out."),
    "unkept column": ("conditions on {what} are not kept", "{hint}"),
    "time": (
        "{what} changes with the clock, and no event would trigger an update",
        "Leave it out: rules look at time.",
    ),
    "volatile": ("{what} gives another value each time", "Leave it out."),
    "function": ("there is no function {what} in a continuous query", "{hint}"),
    "expression": ("{what} is not understood here", "Compare a column with a value: r.name = 'Kitchen'."),
    "parameter": ("a parameter has no value here", "Write the value."),
    "type": ("a value as {what} is not understood here", "{hint}"),
    "operator": ("the operator {what} is not understood here", "{hint}"),
    "null": ("a comparison with null is never true", "Write: is null."),
    "not a text": ("{what} is compared with a text that is written out", "Write the text in single quotes."),
    "not a number": (
        "{what} is compared with a number that is written out",
        "Write the number without quotes.",
    ),
    "not a boolean": ("{what} is compared with true or false", "Write: {what} = true."),
    "uncast": (
        "an attribute is a text until it is made a number",
        "Write: (r.attributes->>'area')::float > 10.",
    ),
    "collation": (
        "which text comes first depends on the server's language",
        "Write: r.name collate \"C\" < 'M'.",
    ),
    "attribute order": (
        "attributes are ordered as numbers only",
        "Write: (r.attributes->>'area')::float > 10.",
    ),
    "json text": (
        "an attribute that is a list or an object is not compared as a text",
        "Compare what is in it: r.attributes->'size'->>'width'.",
    ),
    "attribute": ("an attribute is named by a text", "Write: r.attributes->>'floor'."),
    "attribute name": (
        "an attribute that is called {what} cannot be asked for",
        "Give it a name without dots that is no number.",
    ),
    "attribute value": (
        "what attributes are to contain is an object of texts, numbers and truth values",
        'Write: r.attributes @> \'{{"floor": "2"}}\'.',
    ),
    "pattern": ("a pattern is a text that is written out and does not end with \\", "Write: like 'Room%'."),
    "escape": ("ESCAPE is not understood", "Write \\ before what is meant as it is."),
    "uid": ("{what} is no uid", "Write one such as '2f1c0a3e-0000-4000-8000-000000000000'."),
    "uid alone": (
        "uids are a condition of their own",
        "Write uid = '...' or uid in (...), tied to the rest by AND.",
    ),
    "no uid": ("no uid is left that all conditions allow", "Leave one of them out."),
    "map": (
        "a continuous query is of the map that it is made for",
        "Leave it out; between the sides {first}.map = {second}.map may stand.",
    ),
    "id": ("ids are numbers of this database alone", "Use uid = '...'."),
    "large condition": ("the conditions are too much: {what}", "Ask for less."),
    "new number": ("this way to write a number is of PostgreSQL 16", "Write it with digits alone."),
}
