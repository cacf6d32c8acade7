"""Events as other libraries have them, and back; and tonic's transforms in our pipelines, ours in theirs.

numpy's structured arrays are `Events.to_structured`, dicts of tensors `Events.torch`, PyTorch Geometric `Graph.to_pyg`.
"""

from nvsdata.compat.arrays import from_dict, from_metavision, to_dict, to_metavision
from nvsdata.compat.dv import from_event_store, to_event_store
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
