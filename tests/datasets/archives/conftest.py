"""A server of archives, and pauses between attempts that nobody waits for."""

import pytest
from hosts import hosting

from nvsdata.datasets.archives import transfer


@pytest.fixture
def pauses(monkeypatch):
    """The pauses that were made, none of which is waited for."""
    made = []
    monkeypatch.setattr(transfer.time, "sleep", made.append)
    return made


@pytest.fixture
def host(monkeypatch, pauses):
    monkeypatch.delenv("NVSDATA_MIRROR", raising=False)
    with hosting() as host:
        yield host
