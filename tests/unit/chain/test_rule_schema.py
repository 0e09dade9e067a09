"""docs/rule.schema.json is what the code writes and reads: python tests/unit/chain/test_rule_schema.py writes it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from riot_bus.findings.records import RuleRecord
from riot_bus.generalize import rule_json
from riot_bus.generalize.features import FEATURE_KINDS, Feature
from riot_bus.generalize.literals import LARGEST_SET, OPERATORS
from riot_bus.generalize.rule import Rule
from riot_bus.vocabulary.errors import ConfigError
from tests.rule_rows import every_literal

PUBLISHED = Path(__file__).parents[3] / "docs/rule.schema.json"
CONSTANTS = {"linear": (2, -3), "mod": 4, "bits": 8, "prefix": "x", "contains": "x"}


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
    kinds = "; ".join(f"{kind}: {example(kind)}" for kind in FEATURE_KINDS)
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


def example(kind: str) -> str:
    constant: Any = CONSTANTS.get(kind)
    count = FEATURE_KINDS[kind].arity or len(constant)
    return Feature(kind, ("a", "b", "c")[:count], constant).text()


def text() -> str:
    return json.dumps(rule_schema(), indent=1) + "\n"


def test_it_is_published() -> None:
    assert PUBLISHED.read_text(encoding="utf-8") == text(), f"run: python {Path(__file__)}"


def fits(value: Any, schema: dict[str, Any], root: dict[str, Any]) -> bool:
    """Return whether a value meets a schema, as far as this schema uses the language."""
    if "$ref" in schema:
        return fits(value, root["$defs"][schema["$ref"].rpartition("/")[2]], root)
    if "anyOf" in schema:
        return any(fits(value, each, root) for each in schema["anyOf"])
    if "const" in schema or "enum" in schema:
        return value in schema.get("enum", [schema.get("const")])
    kinds = {
        "null": value is None, "boolean": isinstance(value, bool), "string": isinstance(value, str),
        "number": isinstance(value, int | float) and not isinstance(value, bool), "array": isinstance(value, list),
        "integer": isinstance(value, int) and not isinstance(value, bool), "object": isinstance(value, dict),
    }  # fmt: skip
    wanted = schema.get("type", list(kinds))
    if not any(kinds[kind] for kind in ([wanted] if isinstance(wanted, str) else wanted)):
        return False
    if isinstance(value, list):
        return schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", 1e9) and all(
            fits(each, schema.get("items", {}), root) for each in value
        )
    if isinstance(value, dict):
        known, more = schema.get("properties", {}), schema.get("additionalProperties", {})
        rest = [each for key, each in value.items() if key not in known]
        return (
            all(key in value for key in schema.get("required", ()))
            and (more is not False or not rest)
            and all(fits(each, more if isinstance(more, dict) else {}, root) for each in rest)
            and all(fits(each, known[key], root) for key, each in value.items() if key in known)
        )
    return True


def record(rule: dict[str, Any]) -> dict[str, Any]:
    sure = {"value": 1.0, "low": 0.9, "high": 1.0, "count": 30, "total": 30}
    written = RuleRecord.model_validate(
        {"text": "", "rule": rule, "python": "", "precision": sure, "recall": sure, "balanced_accuracy": 1, "scale": {}}
    )
    found: dict[str, Any] = json.loads(written.model_dump_json())
    return found


def test_every_rule_fits() -> None:
    schema = rule_schema()
    for literal in every_literal():
        assert fits(record(Rule(((literal,),)).to_dict()), schema, schema), literal.text()


@pytest.mark.parametrize(
    ("key", "value"),
    [("feature", "cube"), ("operator", "~"), ("args", "x"), ("value", [1]), ("value", {"hex": "00"}), ("more", 1)],
)
def test_what_the_reader_refuses_does_not_fit(key: str, value: object) -> None:
    literal = {"feature": "raw", "args": ["x"], "operator": ">", "value": 3, key: value}
    rule = {"format": "riot-rule", "version": 1, "terms": [[literal]]}
    schema = rule_schema()
    assert not fits(record(rule), schema, schema)
    with pytest.raises(ConfigError):
        Rule.from_json(rule)


if __name__ == "__main__":
    PUBLISHED.write_text(text(), encoding="utf-8")
