"""Networks on causal graphs that follow events: each event's rows are computed once."""

from __future__ import annotations

from nvsdata.kernels.streaming.causal import CausalNetwork
from nvsdata.models.incremental.network import NetworkLayers


class IncrementalCausalNetwork(CausalNetwork):
    """Rows of a network on a causal graph, each computed once.

    ValueError for average pooling.
    """

    def __init__(self, network: NetworkLayers, window: int | None) -> None:
        pool = network.pools[-1]
        assert pool is not None, "the last block is pooled"
        if pool.mode != "max":
            raise ValueError(f"{pool} can't stream on a causal graph: maxima can")
        super().__init__(network.weights, window, network.shape, network.units)
