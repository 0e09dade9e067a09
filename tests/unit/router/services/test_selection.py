from __future__ import annotations

from typing import Any

import pytest

from riot_bus.inject.injection_plan import InjectionPlan
from riot_bus.pipeline.conditions import Selective, When
from riot_bus.router.bus import Bus
from riot_bus.router.interception import Interception
from riot_bus.router.services.selection import is_served, service_keys, split, with_spaces
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.session import canonical, includes, intersects

HASH = "RIHS01_" + "0" * 64
ACTION = {
    "send_goal": f"0/fibonacci/_action/send_goal/example_interfaces::action::dds_::Fibonacci_SendGoal_/{HASH}",
    "get_result": f"0/fibonacci/_action/get_result/example_interfaces::action::dds_::Fibonacci_GetResult_/{HASH}",
    "cancel_goal": f"0/fibonacci/_action/cancel_goal/action_msgs::srv::dds_::CancelGoal_/{HASH}",
    "feedback": f"0/fibonacci/_action/feedback/example_interfaces::action::dds_::Fibonacci_FeedbackMessage_/{HASH}",
    "status": f"0/fibonacci/_action/status/action_msgs::msg::dds_::GoalStatusArray_/{HASH}",
}
SERVICE = f"0/fibonacci/example_interfaces::srv::dds_::AddTwoInts_/{HASH}"


@pytest.fixture(scope="module")
def registry() -> TypeRegistry:
    return TypeRegistry(load_adapters(["ros2"]))


def spaces(registry: TypeRegistry) -> list[str]:
    return [text for each in registry.service_adapters() for text in each.services]


def interception(registry: TypeRegistry, keys: list[str], *interceptors: object, plan: str = "") -> Interception:
    def no_bus() -> Bus:
        raise AssertionError("nothing is changed here")

    found = InjectionPlan.parse(plan, "plan") if plan else None
    return Interception(no_bus, keys=keys, interceptors=interceptors, plan=found, registry=registry)


def test_an_action_is_three_services_and_two_topics(registry: TypeRegistry) -> None:
    found = interception(registry, service_keys(["/fibonacci"], registry))
    for name, key in ACTION.items():
        is_service = name in ("send_goal", "get_result", "cancel_goal")
        assert any(includes(text, key) for text in found.services) or not is_service
        assert any(includes(text, key) for text in found.expressions) or is_service
    assert any(includes(text, SERVICE) for text in found.services)
    assert not any(includes(text, SERVICE) for text in found.expressions)
    other = SERVICE.replace("fibonacci", "fibonacci/other")
    assert not any(intersects(text, other) for text in [*found.services, *found.expressions])


def test_names_of_services_are_complete_ones_and_keys_are_not(registry: TypeRegistry) -> None:
    for text in ("/add", "/**", "/robot/*/get_state"):
        (expression,) = canonical([registry.key_expression(text)])
        assert is_served(expression, spaces(registry))
        assert with_spaces([expression], spaces(registry))[-1] == expression
    for text in ("calc/add", "**", "0/**"):
        assert not is_served(text, spaces(registry))
    assert with_spaces(["**"], spaces(registry)) == [*spaces(registry), "**"]
    assert with_spaces(["calc/**"], spaces(registry)) == ["calc/**"]


def test_keys_of_other_middleware_stay_as_they_are() -> None:
    assert service_keys(["calc/*", "calc/*"], TypeRegistry()) == ["calc/*/@request"]


def test_each_part_of_a_call_means_the_service() -> None:
    assert split(["/odom", "/add/@request", "/add/@reply", "a/@error"]) == (["/odom"], ["/add", "a"])


@pytest.mark.parametrize("part", ["@request", "@reply", "@error"])
def test_what_interceptors_and_plans_select_is_intercepted(registry: TypeRegistry, part: str) -> None:
    class Looks:
        def message(self, event: Any) -> None:
            raise AssertionError

    selective = Selective(Looks(), When(select=f"calc/add/{part} where a > 1"))
    assert interception(registry, [], selective).services == ["calc/add"]
    plan = f'[[inject]]\ntopic = "/add/{part}"\nfield = "a"\nvalue = 1\n'
    found = interception(registry, ["/odom"], plan=plan)
    assert found.services == canonical([registry.key_expression("/add")])
    assert found.expressions == canonical([registry.key_expression("/odom")])


def test_what_another_expression_includes_is_not_cut_twice(registry: TypeRegistry) -> None:
    found = interception(registry, ["calc/**/@request", "calc/add/@reply", "calc/**"])
    assert (found.expressions, found.services) == (["calc/**"], ["calc/**"])


def test_the_routers_own_services_cannot_be_intercepted(registry: TypeRegistry) -> None:
    with pytest.raises(ConfigError, match="cannot be intercepted"):
        interception(registry, ["@riot/**/@request"])
