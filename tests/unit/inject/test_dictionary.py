import math

import pytest

from riot_bus.inject.dictionary import Dictionary, SuggestedValue, eligible, load_dictionary
from riot_bus.vocabulary.errors import ConfigError


def added(text, **more):
    dictionary = Dictionary()
    dictionary.add(text, where="mine.toml", **more)
    return dictionary


def test_values_by_type_and_long_text():
    dictionary = added(
        """
        type = "string"
        [[entry]]
        value = { repeat = "ab", times = 3 }
        reason = "long"
        [[entry]]
        type = "bytes"
        value = { repeat = { hex = "00ff" }, times = 2 }
        reason = "bytes"
        """
    )
    assert dictionary.values_for("string") == (SuggestedValue("ababab", "long"),)
    assert dictionary.values_for("bytes") == (SuggestedValue(b"\x00\xff\x00\xff", "bytes"),)
    assert dictionary.values_for("int8") == ()


def test_entries_without_type_serve_every_type_that_can_hold_them():
    dictionary = added('[[entry]]\nvalue = 300\nreason = "r"')
    assert [bool(dictionary.values_for(kind)) for kind in ("uint8", "int16", "float32", "string", "bool")] == [
        False,
        True,
        True,
        False,
        False,
    ]


def test_bindings_come_first_and_may_stand_alone():
    text = """
    [[entry]]
    type = "float64"
    value = 1.0
    reason = "general"
    [[field]]
    path = "*.linear.x"
    type = "float64"
    entries = [{ value = 7.0, reason = "special" }, { value = 1.0, reason = "again" }]
    [[field]]
    path = "ranges[*]"
    only = true
    entries = [{ value = 0.5, reason = "near" }]
    """
    dictionary = added(text)
    assert [e.reason for e in dictionary.values_for("float64", "twist.linear.x")] == ["special", "again"]
    assert [e.reason for e in dictionary.values_for("float64", "/odom:twist.linear.x")] == ["special", "again"]
    assert [e.reason for e in dictionary.values_for("float32", "ranges[17]")] == ["near"]
    assert [e.reason for e in dictionary.values_for("float64", "other")] == ["general"]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('type = "flaot64"', "did you mean 'float64'"),
        ('type = "int8"\n[[entry]]\nvalue = 128\nreason = "r"', "cannot hold 128"),
        ('type = "bool"\n[[entry]]\nvalue = 1\nreason = "r"', "cannot hold 1"),
        ("[[entry]]\nvalue = 1", "entry[0].reason"),
        ('[[entry]]\nvalue = 1\nreson = "r"', "'reason'"),
        ('[[field]]\npath = "x"\nentries = []', "no entries"),
        ('[[field]]\npath = "x"\ntype = "uint8"\nentries = [{ value = -1, reason = "r" }]', "cannot hold -1"),
        ('[[field]]\npath = "x"\nentrys = []', "entrys"),
        ('[[field]]\npath = "/scan:len(ranges)"\nentries = [{ value = 1, reason = "r" }]', "is a length"),
        ("x = [", "not a TOML file"),
    ],
)
def test_errors_at_load(text, problem):
    with pytest.raises(ConfigError) as caught:
        added(text)
    assert "mine.toml" in str(caught.value)
    assert problem in str(caught.value)


def test_binding_of_the_users_own_without_an_eligible_value_is_an_error():
    text = '[[field]]\npath = ["speed", "*.v"]\nentries = [{ value = "fast", reason = "r" }]'
    dictionary = added(text, own=True)
    for path in ("speed", "odom.v"):
        with pytest.raises(ConfigError, match="none of the values"):
            dictionary.values_for("float64", path)
        assert [entry.value for entry in dictionary.values_for("string", path)] == ["fast"]
    assert added(text).values_for("float64", "speed") == ()  # a package does not know the fields of others


def test_fields_of_the_users_own_that_are_not_there_are_said():
    bound = '[[field]]\npath = "{}"\nentries = [{{ value = 1.0, reason = "r" }}]\n'
    text = "".join(map(bound.format, ("speed", "ranges[17]", "/odom:*.x", "/scan:speed", "sped")))
    paths = ["/odom:speed", "/odom:pose.x", "/scan:ranges[0]", "/scan:ranges[1]"]
    dictionary = added(text, own=True)
    said = "mine.toml: field[{}]: no field of the log is called {!r}\n  hint: did you mean {}?"
    assert [str(each) for each in dictionary.own().unmatched(paths)] == [
        said.format(3, "/scan:speed", "'/odom:speed' or 'speed'"),
        said.format(4, "sped", "'speed'"),
    ]
    assert not list(added(text).own().unmatched(paths))  # of a package for many systems


def test_float32_holds_no_double():
    assert eligible("float32", math.inf)
    assert not eligible("float32", 1e300)
    assert eligible("float64", 1e300)
    assert not eligible("float64", True)


def test_user_files_and_broken_packages(tmp_path, installed):
    mine = tmp_path / "mine.toml"
    mine.write_text('type = "bool"\n[[field]]\npath = "on"\nonly = true\nentries = [{ value = true, reason = "r" }]')
    assert load_dictionary([mine]).values_for("bool", "on") == (SuggestedValue(True, "r"),)
    with pytest.raises(ConfigError, match="cannot read"):
        load_dictionary([tmp_path / "none.toml"])
    installed("riot_bus.dictionaries", broken="no_such_module_here")
    with pytest.raises(ConfigError, match=r"no_such_module_here: dictionary 'broken' cannot be loaded"):
        load_dictionary()


def test_what_a_definition_tells_comes_after_bindings_and_before_types():
    dictionary = Dictionary()
    dictionary.add('[[entry]]\nvalue = 7\nreason = "general"\ntype = "uint8"', where="a")
    told = [SuggestedValue(3, "undefined"), SuggestedValue(300, "too large"), SuggestedValue(7, "told")]
    assert dictionary.values_for("uint8", "t:mode", told=told) == (
        SuggestedValue(3, "undefined"),
        SuggestedValue(7, "told"),
    )
    dictionary.add('[[field]]\npath = "mode"\nentries = [{ value = 9, reason = "mine" }]', where="b")
    assert [entry.value for entry in dictionary.values_for("uint8", "t:mode", told=told)] == [9, 3, 7]
    dictionary.add('[[field]]\npath = "mode"\nonly = true\nentries = [{ value = 1, reason = "mine" }]', where="c")
    assert [entry.value for entry in dictionary.values_for("uint8", "t:mode", told=told)] == [1, 9]
