"""A plain Zenoh session in a process of its own, with any configuration, driven by lines."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from typing import Any, Self


class ZenohProcess:
    """The test's end.

    Args:
        mode: `client`, `peer` or `router`.
        connect: Endpoints.
        config: Further Zenoh configuration.
    """

    def __init__(self, mode: str, *connect: str, **config: Any) -> None:
        settings = {
            "mode": mode,
            "connect/endpoints": list(connect),
            "scouting/delay": 0,
            "scouting/multicast/enabled": False,
            **({"listen/endpoints": ["tcp/127.0.0.1:0"]} if mode != "client" else {}),
            **{key.replace("__", "/"): value for key, value in config.items()},
        }
        self.process = subprocess.Popen(
            [sys.executable, __file__, json.dumps(settings)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.zid, self.locators = self._answer()

    def do(self, do: str, *arguments: str) -> Any:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps([do, *arguments]) + "\n")
        self.process.stdin.flush()
        return self._answer()

    def _answer(self) -> Any:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, f"ended with {self.process.wait(60)}"
        return json.loads(line)

    def close(self) -> None:
        self.process.kill()
        self.process.wait(60)
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _main(settings: str) -> None:
    import zenoh
    from zenoh import ext

    config = zenoh.Config()
    config.insert_json5("adminspace/enabled", "true")
    for key, value in json.loads(settings).items():
        config.insert_json5(key, json.dumps(value))
    session = zenoh.open(config)
    zid, mode = str(session.info.zid()), json.loads(settings)["mode"]
    locators = [json.loads(r.ok.payload.to_bytes())["locators"] for r in session.get(f"@/{zid}/{mode}") if r.ok]
    keep: list[Any] = []

    def run(do: str, key: str, text: str = "") -> Any:
        match do:
            case "put":
                session.put(key, text, congestion_control=zenoh.CongestionControl.BLOCK)
            case "subscribe":
                keep.append(session.declare_subscriber(key, lambda sample: None))
            case "publish":
                keep.append(session.declare_publisher(key))
            case "token":
                keep.append(session.liveliness().declare_token(key))
            case "advanced":
                keep.append(ext.declare_advanced_publisher(session, key, publisher_detection=True))
            case "transports":
                return sorted(str(each.zid) for each in session.info.transports())
            case "undeclare":
                while keep:
                    keep.pop().undeclare()
        return None

    print(json.dumps([zid, locators[0] if locators else []]), flush=True)
    for line in sys.stdin:
        print(json.dumps(run(*json.loads(line))), flush=True)


if __name__ == "__main__":
    _main(*sys.argv[1:])
