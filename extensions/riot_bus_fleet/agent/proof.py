"""Proofs that two sides share the secret of an operation: HMAC-SHA256 (RFC 2104) over what one of them sends."""

from __future__ import annotations

import hashlib
import hmac
import json
import secrets
from collections.abc import Mapping
from typing import Any

_PROOF = "proof"


def new_secret() -> str:
    """Return 128 random bits as hexadecimal digits."""
    return secrets.token_hex(16)


def prove(secret: str, role: str, text: str) -> str:
    """Return the proof that the sender of a text knows a secret.

    Args:
        role: Role of the sender, so that its proof cannot be sent back to it as one of the other side.
    """
    return hmac.new(secret.encode(), f"{role}\n{text}".encode(), hashlib.sha256).hexdigest()


def proved(document: Mapping[str, Any], secret: str | None, nonce: str) -> dict[str, Any]:
    """Return an agent's document with a proof that it comes from the agent and is new.

    Args:
        secret: Secret of the operation; None for a document without a proof.
        nonce: Nonce of the controller's query, or an increasing number.
    """
    if secret is None:
        return dict(document)
    return {**document, _PROOF: {"nonce": nonce, "code": prove(secret, "agent", nonce + _text(document))}}


def is_proved(document: Mapping[str, Any], secret: str, nonce: str) -> bool:
    """Return whether a document is what `proved` made with this secret and nonce."""
    proof = document.get(_PROOF)
    code = proof.get("code") if isinstance(proof, dict) else None
    rest = {name: value for name, value in document.items() if name != _PROOF}
    return isinstance(code, str) and hmac.compare_digest(
        code.encode(), prove(secret, "agent", nonce + _text(rest)).encode()
    )


def _text(document: Mapping[str, Any]) -> str:
    return json.dumps(document, sort_keys=True)
