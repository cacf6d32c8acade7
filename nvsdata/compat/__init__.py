"""Conversion of events from and to other libraries, and transforms of tonic in pipelines of nvsdata and vice versa.

Other conversions are methods: `Events.to_structured` (structured arrays of numpy), `Events.torch` (dicts of tensors),
`Graph.to_pyg` (PyTorch Geometric).
"""

from nvsdata.compat.arrays import (
    from_dict,
    from_event_store,
    from_metavision,
    to_dict,
    to_event_store,
    to_metavision,
)
from nvsdata.compat.tonic import ForTonic, FromTonic, from_tonic, to_tonic

__all__ = [
    "ForTonic",
    "FromTonic",
    "from_dict",
    "from_event_store",
    "from_metavision",
    "from_tonic",
    "to_dict",
    "to_event_store",
    "to_metavision",
    "to_tonic",
]
