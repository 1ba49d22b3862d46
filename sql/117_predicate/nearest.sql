/*
holds = """\
  the object is one of the `count` nearest to the subject, seen from above; with `distance_m`, at most so \
  far away"""
follows_from = "rank"
reach = "any"
needs = ["count"]
takes = ["distance_m"]
*/
