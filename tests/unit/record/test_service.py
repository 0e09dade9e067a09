from __future__ import annotations

import json

from riot_bus.record.options import CaptureOptions
from riot_bus.record.running import _ready
from riot_bus.record.service import CaptureService


def test_what_is_behind_the_hash_of_the_endpoint_is_not_told_and_not_recorded() -> None:
    config = {"transport/auth/usrpwd/password": "s3kR1t"}
    service = CaptureService(CaptureOptions(endpoint="tls/host:1#key=s3kR1t", config=config))
    assert service.status()["endpoint"] == "tls/host:1#..."
    assert json.loads(service._metadata()["options"])["endpoint"] == "tls/host:1#..."
    told = [json.dumps(service._metadata()), json.dumps(service.status()), _ready(service)]
    assert "s3kR1t" not in "".join(told)
