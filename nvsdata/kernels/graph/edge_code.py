"""Edges of a graph as bytes, about one per edge (docs/dev/store.md)."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

LONGEST = 5  # bytes of a number
MOST = 1 << 31  # nodes


def pack_edges(edges: np.ndarray, nodes: int) -> np.ndarray | None:
    """Return edges int64 [2, E], grouped by target, as bytes uint8; None for others. O(E + N)."""
    if nodes > MOST:
        return None
    out = np.empty(LONGEST * (nodes + edges.shape[1]), np.uint8)
    size: int = _native.pack_edges(edges, nodes, out)
    return out[:size] if size or not edges.shape[1] else None


def unpack_edges(code: np.ndarray, nodes: int, count: int) -> np.ndarray:
    """Return `count` edges between N nodes, int64 [2, count], that `pack_edges` converted to bytes. O(E + N).

    Raises:
        ValueError: The bytes aren't those of such edges.
    """
    # a node and an edge take at least a byte each
    if not 0 <= nodes + count <= code.size:
        raise ValueError(f"{code.size} bytes are too few for {nodes} nodes and {count} edges")
    edges = np.empty((2, count), np.int64)
    if not _native.unpack_edges(code, nodes, edges):
        raise ValueError(f"not the bytes of {count} edges between {nodes} nodes")
    return edges
