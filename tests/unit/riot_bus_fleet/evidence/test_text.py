from __future__ import annotations

from riot_bus_fleet.evidence.text import lines
from tests.unit.riot_bus_fleet.evidence.backtracks import RECORD


def test_text_says_what_each_step_rests_on():
    follows = "12 % (10 to 15 %), after 55 ms, p = 0.005, 1,200 messages of 4 logs"
    silent = (
        "1 pair of fields, 1,200 messages of 4 logs; an effect of 0.8 % or more would have shown about half of the time"
    )
    assert list(lines(RECORD)) == [
        "/unit:v, /unit:w: 6,000 messages of 21,258 in 4 logs",
        "source of readers and writers of topics: riot.toml",
        "/unit:w cannot be tested: it never changes within a log",
        "",
        "/unit",
        "└─ /map by planner",
        f"      v follows x: {follows}",
        "   └─ /goal by mapper [external]",
        "         not tested: it never changes within a log (1 pair)",
        "   └─ /unit by mapper [loop]",
        "         not tested: no numeric field that could tell",
        "└─ /odom by planner [taken as external: nothing recorded leads to it]",
        f"      no evidence in these logs ({silent})",
        f"      of all other topics: no evidence in these logs ({silent})",
        '└─ /odd"\\\\x1b by unknown writer of /unit [inferred]',
        f"      how much v varies goes with x: {follows.replace('55 ms', '2.0 s')}",
        "└─ /lost by planner [not recorded]",
        "      not tested: not recorded",
        "",
        "external fields, the most promising first (3 pairs of fields):",
        f"  1. /goal:y -> /unit:v: {follows}",
        f"  no evidence: /odom:x ({silent})",
        "  not tested: it never changes within a log (1 pair)",
        "  no way leads from: /joy",
        "",
        "loop: /map, /unit",
        "no component is known to write /odom",
        "not recorded: /lost",
        "not looked at, as there were too many: /map:z",
        "28% of the time was looked at",
        "68 pairs of fields tested; for each field, the chance that any other is named by accident is at most 1.0 %",
        "shares are of what a field's own past does not explain; 95 % intervals are over logs or stretches of them",
        "nothing was perturbed, so a common cause of two fields that is not in these logs may be the reason; "
        "`riot permeability` tests that",
    ]


def test_nothing_found_is_not_none():
    text = "\n".join(lines(RECORD.model_copy(update={"ranking": RECORD.ranking[1:]})))
    assert "none of them shows in these logs, which does not mean that none has an effect" in text
    text = "\n".join(lines(RECORD.model_copy(update={"externals": {}, "ranking": ()})))
    assert "no external topic is known: name some with --external, or in riot.toml" in text


def test_without_a_bound_few_messages_are_told():
    silent = RECORD.ranking[1].model_copy(update={"detectable": None})
    text = "\n".join(lines(RECORD.model_copy(update={"ranking": (silent,)})))
    assert "too few messages to show any effect" in text


def test_pairs_without_a_bound_are_counted_apart() -> None:
    silent = RECORD.ranking[1]
    some = (silent, silent.model_copy(update={"detectable": None}))
    text = "\n".join(lines(RECORD.model_copy(update={"ranking": some})))
    told = "an effect of 0.8 % or more would have shown about half of the time"
    told += ", but 1 of them had too few messages to show any effect"
    assert f"2 pairs of fields, 1,200 messages of 4 logs; {told}" in text
