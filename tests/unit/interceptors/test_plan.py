import pytest

from riot_bus.interceptors.catalogue import build
from riot_bus.interceptors.plan import Inject
from riot_bus.pipeline.conditions import Selective
from riot_bus.vocabulary.errors import ConfigError

PLAN = """
[[inject]]
topic = "odom"
field = "x"
value = 9.5
probability = 0.5
"""


@pytest.fixture
def plan(tmp_path):
    file = tmp_path / "plan.toml"
    file.write_text(PLAN)
    return str(file)


def test_a_plan_is_carried_out_on_its_topics(bench, plan):
    interceptor = Inject(plan)
    run = bench(interceptor)
    for n in range(50):
        run.feed(0.1 * n, {"x": 1.5, "n": n}, key="odom")
        run.feed(0.1 * n, {"x": 1.5, "n": n}, key="scan")
    hits = sum(b"9.5" in payload for payload in run.payloads())
    assert 10 < hits < 40
    assert interceptor.hits[0] == hits
    assert interceptor.topics == ["odom"]


def test_the_seed_belongs_to_the_plan_too(plan):
    built = build("inject", {"plan": plan, "seed": 7, "end": 3.0})
    assert isinstance(built, Selective)
    assert built.interceptor.seed == built.when.seed == 7


def test_a_wrong_plan_is_refused_when_it_is_named(tmp_path):
    with pytest.raises(ConfigError, match="cannot read the injection plan"):
        build("inject", {"plan": str(tmp_path / "none.toml")})
