"""The JSON Schema of rule.json: of its record, and of the rule in it."""

from __future__ import annotations

from typing import Any

from riot_bus.findings.records import RuleRecord
from riot_bus.generalize import rule_json
from riot_bus.generalize.features import FEATURE_KINDS, Feature
from riot_bus.generalize.literals import LARGEST_SET, OPERATORS

__all__ = ["rule_schema"]

_CONSTANTS = {"linear": (2, -3), "mod": 4, "bits": 8, "prefix": "x", "contains": "x"}


def rule_schema() -> dict[str, Any]:
    """Return the schema (draft 2020-12) of what `riot rules` writes and a guard reads."""
    schema = RuleRecord.model_json_schema(mode="serialization")
    name = {"type": "string", "maxLength": rule_json.LONGEST_NAME}
    text = {"type": "string", "maxLength": rule_json.LONGEST_TEXT}
    octets = {"type": "string", "pattern": "^([0-9a-f]{2})*$", "maxLength": 2 * rule_json.LONGEST_TEXT}
    raw = {"type": "object", "properties": {"bytes": octets}, "required": ["bytes"], "additionalProperties": False}
    scalars = [{"type": ["null", "boolean", "number"]}, text, raw]
    members = {"type": "array", "items": {"anyOf": scalars}, "minItems": 2, "maxItems": LARGEST_SET}
    value = {
        "description": "what the feature is compared with; null for flags (is, not), a list for sets (in, not in)",
        "anyOf": [*scalars, members],
    }
    constant = {
        "description": "coefficients of linear, divisor of mod, mask of bits, text of prefix and contains",
        "anyOf": [{"type": "integer"}, text, raw, {"type": "array", "items": {"type": "number"}}],
    }
    kinds = "; ".join(f"{kind}: {_example(kind)}" for kind in FEATURE_KINDS)
    literal = {
        "type": "object",
        "properties": {
            "feature": {"enum": list(FEATURE_KINDS), "description": kinds},
            "args": {"type": "array", "items": name, "description": "names of the variables: topic:path"},
            "operator": {"enum": list(OPERATORS)},
            "value": value,
            "constant": constant,
        },
        "required": ["feature", "args", "operator", "value"],
        "additionalProperties": False,
    }
    term = {"type": "array", "items": literal, "maxItems": rule_json.MOST_TERMS, "description": "all of them hold"}
    schema["properties"]["rule"] = {
        "type": "object",
        "properties": {
            "format": {"const": "riot-rule"},
            "version": {"const": rule_json.VERSION},
            "terms": {
                "type": "array",
                "items": term,
                "maxItems": rule_json.MOST_TERMS,
                "description": "the unit fails where one of them holds",
            },
        },
        "required": ["format", "version", "terms"],
    }
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": "rule.json of riot_bus"}


def _example(kind: str) -> str:
    constant: Any = _CONSTANTS.get(kind)
    count = FEATURE_KINDS[kind].arity or len(constant)
    return Feature(kind, ("a", "b", "c")[:count], constant).text()
