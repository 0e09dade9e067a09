from pathlib import Path

import pytest

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_bridges.ros2.options import Names, Ros2BridgeOptions

TOPICS = ["/odom", "/camera/left/image", "/camera/info", "/_hidden/x", "/rosout", "/parameter_events", "/tf_static"]
SERVICES = ["/switch", "/robot/switch", "/robot/get_parameters", "/robot/set_parameters", "/_secret"]
ACTION_TOPICS = ["/dock/_action/feedback", "/dock/_action/status"]
ACTION_SERVICES = ["/dock/_action/send_goal", "/dock/_action/cancel_goal", "/dock/_action/get_result"]


def chosen(**options):
    names = Names(Ros2BridgeOptions(**options))
    return (
        [each for each in TOPICS + ACTION_TOPICS if names.topic(each)],
        [each for each in SERVICES + ACTION_SERVICES if names.service(each)],
    )


def test_by_default_everything_but_what_is_hidden_or_of_every_node():
    assert chosen() == (
        ["/odom", "/camera/left/image", "/camera/info", "/tf_static", *ACTION_TOPICS],
        ["/switch", "/robot/switch", *ACTION_SERVICES],
    )


@pytest.mark.parametrize(
    ("options", "topics", "services"),
    [
        ({"topics": ["/camera/**"]}, ["/camera/left/image", "/camera/info"], ["/switch", "/robot/switch"]),
        ({"topics": ["/camera/*"]}, ["/camera/info"], ["/switch", "/robot/switch"]),
        ({"topics": ["/rosout", "/_hidden/*"]}, ["/_hidden/x", "/rosout"], ["/switch", "/robot/switch"]),
        ({"topics": []}, [], ["/switch", "/robot/switch"]),
        ({"topics": ["/odom"], "services": ["/robot/**"]}, ["/odom"], SERVICES[1:4]),
        ({"topics": ["/odom"], "services": ["/dock"]}, ["/odom", *ACTION_TOPICS], ACTION_SERVICES),
        ({"topics": ["/dock"], "services": []}, ACTION_TOPICS, ACTION_SERVICES),
        (
            {"exclude": ["/camera/**", "/dock", "/switch"]},
            ["/odom", "/tf_static"],
            ["/robot/switch"],
        ),
        ({"topics": ["/odom"], "exclude": ["/odom"]}, [], ["/switch", "/robot/switch"]),
        ({"topics": [], "parameters": ["/rob*"]}, [], ["/switch", "/robot/switch"]),
        ({"topics": [], "parameters": ["/robot"]}, [], ["/switch", "/robot/switch", "/robot/set_parameters"]),
        ({"topics": ["/dock"], "services": [], "parameters": ["/*"]}, ACTION_TOPICS, [SERVICES[3], *ACTION_SERVICES]),
    ],
)
def test_names_may_be_chosen(options, topics, services):
    assert chosen(**options) == (topics, services)


@pytest.mark.parametrize(
    ("options", "where"),
    [
        ({"domain": -1}, "--domain"),
        ({"domain": 233}, "--domain"),
        ({"zenoh_domain": -1}, "--zenoh-domain"),
        ({"depth": 0}, "--depth"),
        ({"latched": 1 << 21}, "--latched"),
        ({"topics": ["odom"]}, "--topics"),
        ({"services": ["switch"]}, "--services"),
        ({"exclude": ["**"]}, "--exclude"),
        ({"parameters": ["robot"]}, "--parameters"),
        ({"setup": Path("/no/such/setup.bash")}, "--setup"),
    ],
)
def test_errors_name_the_option(options, where):
    with pytest.raises(ConfigError) as caught:
        Ros2BridgeOptions(**options).check()
    assert where in str(caught.value)
    assert caught.value.hint
