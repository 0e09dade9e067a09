"""What holds for plug-ins of every kind that is given messages, vectors or findings: the base of their test classes."""

from __future__ import annotations

from typing import Any

ODD_PAYLOADS = (b"", b"\x00" * 64, b"{", b'{"x": "text"}', b"[1, 2]", b'{"x": 1e999}', b"\xff\xfe\xfd")
"""Payloads that anybody may send: no plug-in may raise anything but PayloadError for them."""


class PluginConformance:
    """Tests of a plug-in of any kind: it does the same each time, and survives any input.

    A subclass says what a new plug-in does with usual and with strange inputs.
    """

    def usual(self) -> Any:
        """Return what a new plug-in makes of usual inputs, as a value that can be compared."""
        raise NotImplementedError

    def strange(self) -> list[str]:
        """Give strange inputs to a new plug-in, and return the errors that are its fault."""
        raise NotImplementedError

    def test_it_repeats_itself(self) -> None:
        """Equal inputs give equal results: it keeps no state of others, and random choices come from a seed."""
        assert self.usual() == self.usual()

    def test_strange_inputs_are_survived(self) -> None:
        """No input makes it raise anything that its kind does not allow."""
        assert self.strange() == []
