"""What a lock guards."""

import pytest


@pytest.fixture(params=["file", "folder"])
def output(tmp_path, request):
    path = tmp_path / "out"
    if request.param == "folder":
        path.mkdir()
    return path
