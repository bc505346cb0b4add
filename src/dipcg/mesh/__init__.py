"""Meshes: triangles with parts, their simplification, normals, copies, and the pieces that files hold."""

from dipcg.mesh.mesh import Mesh, MeshError, Solid, chosen, join, make_mesh, numbered, pairs, triangulate

__all__ = ["Mesh", "MeshError", "Solid", "chosen", "join", "make_mesh", "numbered", "pairs", "triangulate"]
