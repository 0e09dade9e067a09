from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.inject.injection_plan import InjectionPlan
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Injection

TEXT = '[[inject]]\ntopic = "/a"\nfield = "v"\nvalue = 1\nseed = 3\n[[inject]]\ntopic = "/b"\nfault = "drop"\n'


def test_a_plan_keeps_its_text_and_gets_an_injector_with_the_seed_of_the_run() -> None:
    plan = InjectionPlan.parse(TEXT, "my plan", seed=7)
    assert (plan.name, plan.text, plan.injector.seed) == ("my plan", TEXT, 7)
    assert plan.injector.injections == (Injection("/a", "v", 1, seed=3), Injection("/b", fault="drop"))
    assert plan.injector.topics == ["/a", "/b"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "injects nothing"),
        ("inject = []", "injects nothing"),
        ("[[inject]]\nfield = 1", "Field required"),
        ("[", "TOML"),
    ],
)
def test_what_is_no_plan_is_refused_by_its_name(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        InjectionPlan.parse(text, "bad.toml")
    assert str(caught.value.where).startswith("bad.toml")


def test_a_file_is_named_by_its_path(tmp_path: Path) -> None:
    file = tmp_path / "plan.toml"
    with pytest.raises(ConfigError, match="cannot read the injection plan"):
        InjectionPlan.read(file)
    file.write_text(TEXT, encoding="utf-8")
    assert InjectionPlan.read(file).name == str(file)
    file.write_bytes(b"\xff")
    with pytest.raises(ConfigError, match="cannot read the injection plan"):
        InjectionPlan.read(file)
