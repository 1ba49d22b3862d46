"""Shapes of things: poses applied to points, prisms, outlines and the abstractions derived from meshes."""
