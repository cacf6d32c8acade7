"""Samples and batches are values: nothing in them is replaced, and which one it is can be asked."""

from dataclasses import FrozenInstanceError, fields

import numpy as np
import pytest
import torch
from graphs import scattered

from nvsdata import Events, GraphBatch
from nvsdata.data.boxes import Boxes
from nvsdata.data.ragged import EventBatch, Padded
from nvsdata.data.samples import Frame

VALUES = {
    "boxes": Boxes.of([[1, 2, 3, 4]], (5, 6)),
    "graph": scattered(),
    "batch": GraphBatch.of(scattered()),
    "padded": Padded.of([torch.ones(2), torch.ones(3)]),
    "columns": EventBatch.of([Events([1], [1], [1], [1])]),
    "frame": Frame(0, 1, 2, 3, 0, 0, np.zeros((2, 2), np.uint16)),
}


@pytest.mark.parametrize("name", VALUES)
def test_fields_are_not_replaced(name):
    value = VALUES[name]
    for field in fields(value):
        with pytest.raises(FrozenInstanceError):
            setattr(value, field.name, None)


@pytest.mark.parametrize("name", ["boxes", "graph", "batch"])
def test_they_are_found_in_sets_and_lists(name):
    """Equality of tensors is no yes or no."""
    value, other = VALUES[name], type(VALUES[name])(**vars(VALUES[name]))
    assert value in {value}
    assert value in [other, value]
    assert value != other
