"""A small office and three people walking in it, to try semap without data of one's own.

Both are ours. `office.geojson` was drawn by hand; `walk.csv` was simulated by `record_walk.py`.
"""
