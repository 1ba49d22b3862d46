-- How each door with a leaf stands, as it was last seen, and which rooms it joins.
create or replace view semap.door_present with (security_invoker = true) as
  select i.map_id, m.name as map, i.instance_id, i.name as door, n.state, n.since,
         nullif(n.stamp, '-infinity') as stamp,
         degrees(n.angle_rad) as angle_deg, degrees(n.angle_std_rad) as angle_std_deg,
         l.width_m, degrees(l.max_rad) as max_deg,
         array(select r.name from semap.door_room j join semap.instance r on r.instance_id = j.room_id
               where j.door_id = i.instance_id order by r.name) as rooms
  from semap.door_now n
  join semap.door_leaf l using (instance_id)
  join semap.instance i using (instance_id)
  join semap.map m on m.map_id = i.map_id;
