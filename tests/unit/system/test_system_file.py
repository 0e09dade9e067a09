from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.system.system_file import ResourceLimits, load_system
from riot_bus.trial.context import open_system
from riot_bus.vocabulary.errors import ConfigError

ROOT = Path(__file__).resolve().parents[3]
GOOD = """
[system]
segments = ["a", "b"]

[components.one]
command = ["true"]
segment = "a"

[unit.one]
"""


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "riot.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("path", ["examples/rover/riot.toml", "tests/systems/press/riot.toml"])
def test_shipped_systems_load(path: str) -> None:
    context = open_system(ROOT / path)
    assert len(context.file.unit) == 1
    assert context.fingerprint() == open_system(ROOT / path).fingerprint()


def test_fingerprint_follows_the_sources(tmp_path: Path) -> None:
    path = write(tmp_path, GOOD.replace('segments = ["a", "b"]', 'segments = ["a", "b"]\nsources = ["*.py"]'))
    source = tmp_path / "one.py"
    source.write_text("x = 1")
    before = open_system(path).fingerprint()
    source.write_text("x = 2")
    assert open_system(path).fingerprint() != before


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("segments", "segmets", 3, ("unknown key 'segmets'", "'segments'")),
        ('segment = "a"', 'segment = "c"', 7, ("'c' is not described", "known: a, b")),
        ("[unit.one]", "[unit.two]", 9, ("'two' is not described", "one")),
        ('command = ["true"]', "", 5, ("no command", "container = {")),
        (
            'command = ["true"]',
            'attach = "tcp/127.0.0.1:7447"\ncommand = ["x"]',
            5,
            ("exclude each other",),
        ),
        ('command = ["true"]', 'attach = "7447"', 6, ("'7447'",)),
        ('command = ["true"]', 'container = { image = "x", sevice = "y" }', 5, ("unknown key 'sevice'", "'service'")),
        ('command = ["true"]', 'container = { image = "x", service = "y" }', 6, ("both the compose file and",)),
        ('command = ["true"]', 'container = { image = "--privileged" }', 5, ("'--privileged'",)),
        ('segment = "a"', 'ssh = { host = "-oProxyCommand=x" }', 5, ("-oProxyCommand",)),
        ('segment = "a"', 'ssh = { host = "robot" }', 9, ("a unit runs on this machine",)),
        ('segment = "a"', 'ssh = { host = "r" }\ncontainer = { image = "x" }', 5, ("exclude each other",)),
        ('segments = ["a", "b"]', 'reset = { payload = "x" }\nsegments = ["a", "b"]', 3, ("either topic = TOPIC or",)),
        (
            'segments = ["a", "b"]',
            'reset = { topic = "x" }\nclock = {}\nsegments = ["a", "b"]',
            3,
            ("have a reset of their own",),
        ),
        ('segment = "a"', 'ssh = { host = "robot" }\ndds = true', 5, ("`dds` is for nodes of this machine",)),
        (
            'command = ["true"]',
            'attach = "tcp/127.0.0.1:7447"\n[components.two]\nattach = "tcp/127.0.0.1:7447"',
            8,
            ("is the address of 'one', too",),
        ),
        ('segment = "a"', 'only = "a("', 7, ("is not a regular expression",)),
        ('segment = "a"', 'setup = ["reset", "{param:speed}"]', 7, ("{param:speed}",)),
        ('command = ["true"]', 'command = "true"', 6, ("tuple", "'true'")),
        ("[unit.one]", '[components.one.limits]\nmemory = "2 GB per day"', 10, ("is not a size", "1GiB")),
        ("[unit.one]", "[components.one.limits]\nfile = 3", 10, ("unknown key 'file'", "'files'")),
        ('segment = "a"', "resources = { sin = 1 }\n[resources]\nsim = 2", 7, ("'sin' is not described", "'sim'")),
        ('segment = "a"', "resources = { sim = 3 }\n[resources]\nsim = 2", 7, ("3 are more than there are", "has 2")),
        ("[unit.one]", '[resources]\n"a/b" = 1', 9, ("a/b",)),
        ('segment = "a"', 'ready = { topic = "x where state is 3" }', 5, ("state is 3",)),
        ('segment = "a"', 'ready = { topic = "x:state" }', 5, ("selects a field", "x where state")),
        (
            'segment = "a"',
            'ready = { service = "map/*" }',
            5,
            ("'map/*' is not the name of a service", "without wildcards"),
        ),
        ('segment = "a"', 'stop = "maybe"', 7, ("'maybe' is not a way to end a component", '"kill", "term" or a')),
        ('segment = "a"', "stop = []", 7, ("[] is not a way to end a component",)),
        ('segment = "a"', 'stop = ["x", "{enpoint}"]', 7, ("'{enpoint}' is not a placeholder",)),
        ('segment = "a"', 'stop = ["x", "{param:gain}"]', 7, ("'{param:gain}' is not described",)),
        ('command = ["true"]', 'attach = "tcp/127.0.0.1:7447"\nstop = ["x"]', 5, ("runs already is not ended",)),
        ("[unit.one]", "[unit.one]\nrate = -1", 10, ("greater than or equal to 0", "-1")),
        ("[unit.one]", '[unit.one]\nreset = { topic = "x" }', 10, ("no longer share a process", "leave out `reset`")),
        ("[unit.one]", '[unit.one]\nisolation = "persistent"', 10, ("no longer share a process", 'write "auto"')),
        ("[unit.one]", "[unit.one]\ncommand = []", 10, ("at least 1",)),
        ("[unit.one]", '[unit.one]\ncomand = ["x"]', 10, ("unknown key 'comand'", "'command'")),
        ("[unit.one]", '[unit.one]\ncwd = "{param:gain}"', 10, ("'{param:gain}' is not described",)),
        ("[unit.one]", '[unit.one]\nenv = { A = "{param:gain}" }', 10, ("'{param:gain}' is not described",)),
        ("[unit.one]", '[[monitors]]\nkind = "rang"\nfield = "x:y"', 10, ("rang", "did you mean 'range'")),
        ("[unit.one]", '[[monitors]]\nkind = "range"\nfeild = "x:y"', 11, ("feild", "did you mean 'field'")),
        ("[unit.one]", '[[monitors]]\nkind = "range"\nmin = 1', 9, ("'field' is missing",)),
        ("[unit.one]", '[[monitors]]\nkind = "rate"\ntopic = "x"\ngap = -1', 12, ("gap", "greater than 0", "-1")),
        ("[unit.one]", '[[monitors]]\nkind = "finite"\nfield = "x"', 9, ("does not name a field",)),
        ('command = ["true"]', 'command = ["true", "{param:gain}"]', 6, ("'{param:gain}' is not described",)),
        (
            'command = ["true"]',
            'command = ["true", "-e{enpoint}"]',
            6,
            ("'{enpoint}' is no", "{endpoint}?", "{{enpoint}}"),
        ),
        ('segment = "a"', 'setup = ["x", "{trialdir}/a"]', 7, ("'{trialdir}' is no", "{trial_dir}?")),
        ("[unit.one]", '[unit.one]\nenv = { A = "{durration}" }', 10, ("'{durration}' is no", "{duration}?")),
        ('segment = "a"', 'cwd = "{free_port:a-b}"', 7, ("'{free_port:a-b}' is no", "letters, digits and _")),
        ("[unit.one]", "[external.parameters]\ngain = { nominal = 1.0 }", 10, ("range = [LEAST, MOST]",)),
        ("[unit.one]", "[external.parameters]\ngain = { nominal = 1, range = [3, 2] }", 10, ("not a range of 1",)),
        ("[unit.one]", '[external.parameters]\ngain = { nominal = "a", values = ["b"] }', 10, ("one of the values",)),
        ("[unit.one]", '[external.parameters]\ng = { nominal = true, name = "h" }', 10, ("add node", "`name` is what")),
        (
            "[unit.one]",
            '[external.parameters]\ng = { nominal = true, nod = "/h" }',
            9,
            ("'nod'", "did you mean 'node'"),
        ),
        (
            "[unit.one]",
            '[external.parameters]\ng = { nominal = true, node = "n" }\nh = { nominal = true, node = "n", name = "g" }',
            11,
            ("'g' and 'h' are the same one of 'n'",),
        ),
        (
            "[unit.one]",
            '[unit.one]\ncwd = "{param:g}"\n[external.parameters]\ng = { nominal = true, node = "/n" }',
            10,
            ("'{param:g}' is set in '/n' while it runs", "without `node`"),
        ),
        ("[unit.one]", '[external.values]\n"a:b" = []', 10, ("at least 1",)),
        ('segment = "a"', "external = true\n[system.clock]\nstep = 0.1", 8, ("have a time of their own",)),
        ("[unit.one]", "[system.clock]\n[system.trial_run]\nduration = 5\nspeed = 2", 12, ("as fast as they can",)),
        ("[unit.one]", "[system.clock]\nstep = 0", 10, ("greater than or equal to 0.001",)),
    ],
)
def test_mistakes_are_named_with_their_place(
    tmp_path: Path, old: str, new: str, line: int, words: tuple[str, ...]
) -> None:
    path = write(tmp_path, GOOD.replace(old, new))
    with pytest.raises(ConfigError) as caught:
        load_system(path)
    text = str(caught.value)
    assert f"riot.toml:{line}" in text
    for word in words:
        assert word in text


def test_not_toml_and_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="not a TOML file"):
        load_system(write(tmp_path, "[system"))
    with pytest.raises(ConfigError, match="cannot read"):
        load_system(tmp_path / "no.toml")


def test_choosing_a_unit(tmp_path: Path) -> None:
    file = load_system(write(tmp_path, GOOD + '[components.two]\ncommand = ["true"]\n[unit.two]\n'))
    assert file.choose_unit("two") == "two"
    with pytest.raises(ConfigError, match="one, two"):
        file.choose_unit(None)
    with pytest.raises(ConfigError, match="did you mean 'two'"):
        file.choose_unit("tow")
    file = load_system(write(tmp_path, GOOD + '[components.two]\ncommand = ["true"]\n'))
    assert file.choose_unit(None) == "one"
    with pytest.raises(ConfigError, match=r"add a table \[unit.two\]"):
        file.choose_unit("two")


def test_what_comes_from_outside_must_not_reach_the_system_within_a_segment(tmp_path: Path) -> None:
    outside = '[components.{}]\ncommand = ["true"]\nsegment = "{}"\nexternal = true\n'
    for further, shared in (("", None), (outside.format("two", "b"), None), (outside.format("three", "a"), "'a'")):
        file = load_system(write(tmp_path, GOOD + further))
        if shared is None:
            file.check_outside_apart()
        else:
            with pytest.raises(ConfigError, match=f"share segment {shared}"):
                file.check_outside_apart()


def test_a_unit_alone_is_judged_by_monitors_of_what_it_publishes_and_of_what_nobody_does(tmp_path: Path) -> None:
    text = '[components.a]\ncommand = ["a"]\noutputs = ["one"]\n[components.b]\ncommand = ["b"]\noutputs = ["two"]\n'
    topics = ("one", "two", "tow", "*")
    text += "".join(f'[[monitors]]\nkind = "finite"\nfield = "{topic}:x"\n' for topic in topics)
    context = open_system(write(tmp_path, text))

    def judged(name: str) -> list[str]:
        return [topic for monitor in context.monitors_of(name) for topic in getattr(monitor, "topics", ())]

    assert judged("a") == ["one", "tow", "*"]
    assert judged("b") == ["two", "tow", "*"]
    assert len(context.monitors_of("a")) == len(context.monitors) - 1
    text = text.replace('outputs = ["two"]', 'outputs = ["t*", "two/*"]').replace('"two:x"', '"two/1:x"')
    grouped = open_system(write(tmp_path, text))
    assert grouped.others_publish("two/1", "a")
    assert not grouped.others_publish("three/1", "a")


def test_a_unit_alone_may_have_a_command_of_its_own(tmp_path: Path) -> None:
    text = (
        '[components.a]\ncommand = ["a", "{endpoint}"]\nenv = { X = "1" }\ncwd = "w"\n[components.b]\ncommand = ["b"]\n'
    )
    text += '[unit.a]\n[unit.debug]\ncomponent = "a"\ncommand = ["a-debug"]\nenv = {}\n[unit.b]\ncwd = "v"\n'
    context = open_system(write(tmp_path, text))
    assert context.alone("a") is context
    debug = context.alone("debug").file.components
    assert (debug["a"].command, debug["a"].env, debug["a"].cwd) == (("a-debug",), {}, "w")
    assert debug["b"] == context.file.components["b"]
    other = context.alone("b").file
    assert (other.components["b"].command, other.components["b"].cwd) == (("b",), "v")
    assert other.root == context.file.root
    assert context.file.components["a"].command == ("a", "{endpoint}")


def test_files_with_placeholders_are_there_and_describe_their_parameters(tmp_path: Path) -> None:
    text = '[components.a]\ncommand = ["a", "--conf={file:c/a.json5}"]\nenv = { B = "{file:b}" }\n[unit.a]\n'
    path = write(tmp_path, text)
    with pytest.raises(ConfigError, match="cannot read 'b'") as caught:
        open_system(path)
    assert f"{path}: {{file:...}}" in str(caught.value)
    (tmp_path / "c").mkdir()
    (tmp_path / "c/a.json5").write_text("{ x: {endpoint} }")
    (tmp_path / "b").write_text("{param:gain}")
    with pytest.raises(ConfigError, match="is not described") as caught:
        open_system(path)
    assert "'{param:gain}'" in str(caught.value)
    assert "b, c/a.json5" in str(caught.value)
    (tmp_path / "b").write_text("")
    before = open_system(path).parts()
    assert set(before) == {"riot.toml", "b", "c/a.json5"}
    (tmp_path / "b").write_text("other")
    assert {name for name, digest in open_system(path).parts().items() if digest != before[name]} == {"b"}


@pytest.mark.parametrize(("node", "known"), [("/planner", True), ("/robot1/planner", True), ("planner", False)])
def test_running_components_are_known_to_an_adapter(tmp_path: Path, node: str, known: bool) -> None:
    text = GOOD + f'[external.parameters]\ngain = {{ nominal = true, node = "{node}" }}\n'
    path = write(tmp_path, text)
    if known:
        assert open_system(path).file.external.parameters["gain"].node == node
    else:
        with pytest.raises(ConfigError, match="no adapter knows parameters of 'planner'") as caught:
            open_system(path)
        assert "external.parameters.gain" in str(caught.value)
        assert "/planner" in str(caught.value.hint)


def test_braces_of_programs_are_left_alone(tmp_path: Path) -> None:
    texts = (
        '{"seed": 1, "speed": {}}',
        "{{enpoint}}",
        "{port}",
        "{feed}",
        "{name:>5}",
        "a{,b}",
        "{endpoint}",
        "{Seed}",
        "{}",
    )
    words = ", ".join(f"'{text}'" for text in texts)
    path = write(tmp_path, GOOD.replace('command = ["true"]', f"command = ['true', {words}]"))
    assert open_system(path).file.components["one"].command[1:] == texts


def test_limits_are_amounts_with_units_or_off(tmp_path: Path) -> None:
    given = [
        *(
            "",
            'limits = "off"',
            'limits = { memory = "1.5 GiB", cpu = "2min" }',
            "limits = { memory = 1000, files = 0 }",
        ),
    ]
    found = []
    for text in given:
        file = load_system(write(tmp_path, GOOD.replace('segment = "a"', f'segment = "a"\n{text}')))
        found.append(file.components["one"].limits)
    assert found[0] == ResourceLimits(memory=2 << 30, files=1000, processes=256, cpu=3600.0)
    assert found[1:] == ["off", ResourceLimits(memory=3 << 29, cpu=120.0), ResourceLimits(memory=1000, files=0)]
