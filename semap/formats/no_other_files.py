"""A file that brings all with it; a module of its own, since only the readers of meshes import trimesh."""

from __future__ import annotations

from trimesh.resolvers import Resolver


class NoOtherFiles(Resolver):
    """Refuses every file that a mesh refers to."""

    def __init__(self) -> None:
        """There is nothing to remember."""

    def get(self, name: str) -> bytes:
        raise OSError(f"{name} lies outside the upload")

    def namespaced(self, namespace: str) -> NoOtherFiles:
        return self

    def keys(self) -> tuple[str, ...]:
        return ()

    def write(self, name: str, data: bytes) -> None:
        raise OSError(f"{name} lies outside the upload")
