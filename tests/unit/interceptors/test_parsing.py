import math

import pytest

from riot_bus.interceptors.losses import Drop
from riot_bus.interceptors.parsing import from_tables, from_text, parse
from riot_bus.interceptors.timing import Delay
from riot_bus.pipeline.conditions import Selective, When
from riot_bus.vocabulary.errors import ConfigError


@pytest.mark.parametrize(
    ("text", "use", "options"),
    [
        ("drop", "drop", {}),
        (
            'drop probability=0.1 select="/odom where pose.x > 3" from=system',
            "drop",
            {"probability": 0.1, "select": "/odom where pose.x > 3", "from": "system"},
        ),
        ("nan.py:Nan every=5", "nan.py:Nan", {"every": 5}),
        ("x a=true b=1_000 c=0x10 d=1e3 e=-2", "x", {"a": True, "b": 1000, "c": 16, "d": 1000.0, "e": -2}),
        ("x a= b=text c=/odom d=run.mcap", "x", {"a": "", "b": "text", "c": "/odom", "d": "run.mcap"}),
        ("""x a='"5"' b="5 # no comment" c='"#"'""", "x", {"a": "5", "b": "5 # no comment", "c": "#"}),
        ("x a=2026-11-21 b=07:30:00", "x", {"a": "2026-11-21", "b": "07:30:00"}),
        ("x where='mode == \"a=b\"'", "x", {"where": 'mode == "a=b"'}),
        ("x select=/odom select=/scan select=/imu", "x", {"select": ["/odom", "/scan", "/imu"]}),
        ("""x select='["/odom", "/scan"]'""", "x", {"select": ["/odom", "/scan"]}),
        ("x a='1\nb = 2'", "x", {"a": "1\nb = 2"}),
        ("x a='" + "[" * 5000 + "'", "x", {"a": "[" * 5000}),
    ],
)
def test_parse(text, use, options):
    assert parse(text) == (use, options)


def test_numbers_that_are_none():
    assert math.isnan(parse("set value=nan")[1]["value"])
    assert parse("set value=-inf")[1]["value"] == -math.inf


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "no interceptor is named"),
        ("drop every", "'every' in 'drop every' is not an option"),
        ("drop =5", "'=5'"),
        ("drop 1x=5", "'1x=5'"),
        ('drop select="/odom', "No closing quotation"),
    ],
)
def test_wrong_spelling(text, problem):
    with pytest.raises(ConfigError) as caught:
        parse(text)
    assert problem in str(caught.value)
    assert "--interceptor" in str(caught.value)
    assert "hint" in str(caught.value)


def test_from_text():
    assert from_text("drop every=5 select=/odom") == Selective(Drop(every=5), When("/odom"))
    with pytest.raises(ConfigError, match="--interceptor: drop: unknown option 'evry'"):
        from_text("drop evry=5")


def test_from_tables():
    tables = [{"use": "drop", "every": 5, "from": "system"}, {"use": "delay", "seconds": 1}]
    assert from_tables(tables) == [Selective(Drop(every=5), When(source="system")), Delay(1.0)]


@pytest.mark.parametrize(
    ("table", "problem"),
    [
        ({"every": 5}, "which interceptor"),
        ({"use": 5}, "which interceptor"),
        ({"use": "dorp"}, "did you mean 'drop'"),
        ({"use": "drop", "evry": 1}, "unknown option 'evry'"),
    ],
)
def test_wrong_tables_are_named_by_number(table, problem):
    with pytest.raises(ConfigError) as caught:
        from_tables([{"use": "drop"}, table], where="my.toml")
    assert problem in str(caught.value)
    assert "my.toml: router.interceptors[1]" in str(caught.value)
