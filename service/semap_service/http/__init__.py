"""HTTP as every resource speaks it: problems, entity tags, limits, connections, and the files of the page."""
