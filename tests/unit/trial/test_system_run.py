from riot_bus.inject.interceptor import Injector
from riot_bus.pipeline.runner import Pipeline
from riot_bus.trial.system_run import OutsideTap
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message


def test_what_comes_late_is_kept_with_the_time_at_which_it_comes():
    injector = Injector([Injection("late", fault="delay", delay=2.0), Injection("lost", fault="drop")])
    tap = OutsideTap(injector)
    tap.now = lambda: 5 * 10**9
    pipeline = Pipeline([injector, tap], registry=TypeRegistry())
    for key in ("late", "lost", "usual"):
        pipeline.feed(Message(1, key, b"{}"))
    assert [(message.key, message.time) for message in tap.messages] == [("late", 7 * 10**9), ("usual", 5 * 10**9)]
    assert tap.delivered() == [1, 1]
