"""What sensors say and what is made of it, as values: they pass from role to role of the pipeline.

Stamps are event time [us since 1970]; frames are names without a leading slash; lengths are metres and angles
radians in right-handed frames (REP 103), optical frames have z forward.
"""
