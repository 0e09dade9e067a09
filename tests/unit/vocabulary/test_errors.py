from __future__ import annotations

import pytest

from riot_bus.vocabulary.errors import (
    ConfigError,
    MissingExtraError,
    RiotError,
    did_you_mean,
    located,
    needs_extra,
    require_package,
)


def test_hints_name_near_words_or_else_a_few_known_ones() -> None:
    assert did_you_mean("segmets", ["segments", "types"]) == "did you mean 'segments'?"
    assert did_you_mean("zzz", ["a"]) == "known: a"
    assert did_you_mean("zzz", map(str, range(13))) == "known: 0, 1, 10, 11, 12, 2, 3, 4, 5, 6, 7, 8, ..."
    assert did_you_mean("zzz", ()) is None


def test_an_error_has_its_place_first_its_hint_last_and_no_secret() -> None:
    error = RiotError("no answer from tls/a:1#key=b", where="f:3", hint="see tcp/u:secret@b:1")
    assert str(error) == "f:3: no answer from tls/a:1#...\n  hint: see tcp/...@b:1"
    assert str(RiotError("x")) == "x"


def test_what_a_context_finds_wrong_gets_the_place_of_the_users_text() -> None:
    with pytest.raises(ConfigError) as caught, located("plan.toml: inject[0].field"):
        raise ConfigError("no", where="formula, column 3", hint="yes")
    assert (caught.value.message, caught.value.where, caught.value.hint) == ("no", "plan.toml: inject[0].field", "yes")
    with pytest.raises(KeyError), located("x"):
        raise KeyError


def test_a_package_that_is_not_there_is_an_extra_to_install() -> None:
    assert require_package("json", "analysis").name == "json"
    for module in ("no_such_package", "no_such_package.part"):
        with pytest.raises(MissingExtraError, match=r"'shown' is not installed.*\n.*analysis"):
            require_package(module, "analysis", package="shown")
    with pytest.raises(MissingExtraError), needs_extra("dask", "cluster"):
        raise ImportError
