"""The JSON Schema of rule.json: of its record, and of the rule in it."""

from __future__ import annotations

from typing import Any

from riot_bus.findings.records import RuleRecord
from riot_bus.generalize import rule_json
from riot_bus.generalize.features import FEATURE_KINDS
from riot_bus.generalize.literals import OPERATORS

__all__ = ["rule_schema"]


def rule_schema() -> dict[str, Any]:
    """Return the schema (draft 2020-12) of what `riot rules` writes and a guard reads."""
    schema = RuleRecord.model_json_schema(mode="serialization")
    name = {"type": "string", "maxLength": rule_json.LONGEST_NAME}
    octets = {"type": "string", "pattern": "^([0-9a-f]{2})*$", "maxLength": 2 * rule_json.LONGEST_NAME}
    value = {
        "description": "what the feature is compared with; null for flags, whose operators are is and not",
        "anyOf": [
            {"type": ["null", "boolean", "number"]},
            name,
            {"type": "object", "properties": {"bytes": octets}, "required": ["bytes"], "additionalProperties": False},
        ],
    }
    kinds = "; ".join(f"{kind}: {each[2].format('a', 'b', 'c')}" for kind, each in FEATURE_KINDS.items())
    literal = {
        "type": "object",
        "properties": {
            "feature": {"enum": list(FEATURE_KINDS), "description": kinds},
            "args": {"type": "array", "items": name, "description": "names of the variables: topic:path"},
            "operator": {"enum": list(OPERATORS)},
            "value": value,
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
