"""docs/rule.schema.json is what the code writes and reads: python tests/unit/chain/test_rule_schema.py writes it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from riot_bus.chain.rule_schema import rule_schema
from riot_bus.findings.records import RuleRecord
from riot_bus.generalize.rule import Rule
from riot_bus.vocabulary.errors import ConfigError
from tests.rule_rows import every_literal

PUBLISHED = Path(__file__).parents[3] / "docs/rule.schema.json"


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
