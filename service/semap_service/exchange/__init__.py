"""Files that come in and go out: maps, many instances, meshes."""
