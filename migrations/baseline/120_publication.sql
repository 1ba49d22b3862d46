-- What leaves through the log: the map for mirrors; changes, rules and watermarks for the rule worker.
create publication semap_map
for table semap.map, semap.concept, semap.concept_parent, semap.instance, semap.abstraction, semap.door_room;
create publication semap_change
for table semap.relation_change, semap.object_state with (publish = 'insert');
create publication semap_rule for table semap.rule, semap.source, semap.map;
create publication semap_amendment for table semap.track_amendment with (publish = 'insert');
