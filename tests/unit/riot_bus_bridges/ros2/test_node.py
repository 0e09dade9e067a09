import os
import sys

import pytest

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus_bridges.ros2.node import NodeProcess, interpreter
from riot_bus_bridges.ros2.options import Ros2BridgeOptions


def start(**options):
    node = NodeProcess("riot_bridge_test", Ros2BridgeOptions(**options), lambda frame: None)
    try:
        return node.start()
    finally:
        node.close()
        node.close()


def test_a_python_without_ros_is_named():
    with pytest.raises(ConfigError) as caught:
        start(python=sys.executable)
    assert "No module named 'rclpy'" in caught.value.message
    assert "setup.bash" in str(caught.value.hint)


def test_a_python_that_is_none_is_named():
    with pytest.raises(ConfigError, match="/no/such/python does not start"):
        start(python="/no/such/python")
    with pytest.raises(EnvironmentFaultError, match="does not start in /bin/true"):
        start(python="/bin/true")


def test_a_setup_script_comes_first_and_knows_the_domain(tmp_path):
    setup = tmp_path / "setup file.bash"
    setup.write_text(f'echo "$ROS_DOMAIN_ID" > "{tmp_path}/seen"\n')
    with pytest.raises(ConfigError, match="no rclpy in"):
        start(python=sys.executable, setup=setup, domain=77)
    assert (tmp_path / "seen").read_text() == "77\n"


def test_the_first_python_of_another_installation_is_taken(tmp_path, monkeypatch):
    own, ros = os.path.join(sys.prefix, "bin"), tmp_path / "bin"
    ros.mkdir()
    (ros / "python3").symlink_to(sys.executable)
    monkeypatch.setenv("PATH", os.pathsep.join([own, "", str(ros), os.defpath]))
    assert interpreter() == str(ros / "python3")
    package = tmp_path / f"lib/python{sys.version_info.major}.{sys.version_info.minor}/site-packages/rclpy"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    monkeypatch.syspath_prepend(package.parent)
    assert interpreter() == sys.executable
