from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import fields
from typing import get_args, get_origin

from riot_bus.control.router_flags import RouterOptions
from riot_bus.vocabulary.flags import flags_of

FLAGS = flags_of(RouterOptions)


def test_what_is_not_given_is_none_or_empty_but_the_bypass_watch_is_on() -> None:
    options = RouterOptions()
    assert {each.name for each in fields(options) if getattr(options, each.name)} == {"bypass_watch"}


def test_all_but_what_a_bridge_adds_can_be_given_on_the_command_line() -> None:
    assert {each.name for each in fields(RouterOptions)} - {field.name for field, _, _ in FLAGS} == {
        "adapters",
        "carried",
    }


def test_no_option_and_no_variable_is_used_twice() -> None:
    names = Counter(name for _, _, each in FLAGS for name in each)
    variables = Counter(flag.env for _, flag, _ in FLAGS if flag.env)
    assert max(names.values()) == max(variables.values()) == 1
    assert all(name.startswith("RIOT_") for name in variables)
    assert {"--system", "-s", "--bypass-watch/--no-bypass-watch", "--intercept-services", "--msg"} <= set(names)


def test_what_takes_a_value_says_what_it_is_and_what_is_repeatable_is_a_list() -> None:
    for field, flag, _ in FLAGS:
        kind = get_args(field.type)[0]
        assert flag.help.endswith((".", "]"))
        assert flag.metavar is not None or kind in (int, bool), field.name
        if "repeatable" in flag.help:
            assert get_origin(kind) is Sequence, field.name
            assert field.default == (), field.name
