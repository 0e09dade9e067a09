import math
import random

import pytest
from rover.component import Component
from rover.controller import Controller
from rover.mapper import Mapper, window_origin
from rover.maps import OccupancyGrid, OccupancyGridUpdate
from rover.messages import Path, PoseStamped, Twist
from rover.operator_ import Operator
from rover.planner import Planner
from rover.sensors import Odometry
from rover.sim import Sim
from rover.workspace import WORKSPACE, Workspace

EXTREMES = (-(2**31), -(2**31) + 1, -1, 0, 1, 2**31 - 1)


def start(kind, *arguments):
    sent = []
    return kind(lambda topic, message: sent.append((topic, message)), *arguments), sent


def update(x, y):
    return OccupancyGridUpdate((0, 0), x, y, 8, 8, bytes(64))


def crashes(planner, x, y):
    try:
        planner.receive("/map_updates", update(x, y).encode())
    except ValueError as fault:
        place = fault.__traceback__
        while place.tb_next:
            place = place.tb_next
        assert place.tb_frame.f_code is Workspace.window.__code__
        assert place.tb_lineno == Workspace.window.__code__.co_firstlineno + 2
        return True
    return False


def test_planner_fails_exactly_where_the_product_is_negative_or_large():
    planner, _ = start(Planner)
    rng = random.Random(4)
    pairs = [(x, y) for x in EXTREMES for y in EXTREMES]
    pairs += [(rng.randrange(-(2**31), 2**31), rng.randrange(-(2**31), 2**31)) for _ in range(1000)]
    pairs += [(rng.randrange(-4000, 4000), rng.randrange(-4000, 4000)) for _ in range(1000)]
    pairs += [(2048, 2048), (1, WORKSPACE), (1, WORKSPACE + 1), (0, -5), (-2, -3)]
    for x, y in pairs:
        assert crashes(planner, x, y) == (not 0 <= x * y <= WORKSPACE), (x, y)


def test_planner_refuses_all_else_that_is_wrong(capsys):
    planner, sent = start(Planner)
    nan = math.nan
    wrong = [
        ("/map_updates", OccupancyGridUpdate((0, 0), 1, 5, 8, 8, bytes(63))),
        ("/map", OccupancyGrid((0, 0), 2.0, 2, 3, 0.0, 0.0, bytes(5))),
        ("/map", OccupancyGrid((0, 0), nan, 1, 1, 0.0, 0.0, bytes(1))),
        ("/map", OccupancyGrid((0, 0), 2.0, 0, 0, 0.0, 0.0, b"")),
        ("/odom", Odometry((0, 0), nan, 0.0, 0.0, 0.0)),
        ("/goal", PoseStamped((0, 0), 0.0, -100.0)),
        ("/goal", PoseStamped((0, 0), math.inf, 0.0)),
    ]
    for topic, message in wrong:
        planner.receive(topic, message.encode())
    assert not sent
    assert capsys.readouterr().err.count("refused") == 4


@pytest.mark.parametrize("kind", [Planner, Mapper, Controller])
def test_random_bytes_do_no_harm(kind, capsys):
    component, _ = start(kind)
    rng = random.Random(5)
    for _ in range(3000):
        topic = rng.choice(component.INPUTS)
        raw = b"\x00\x01\x00\x00" * (rng.random() < 0.8) + rng.randbytes(rng.randrange(400))
        try:
            component.receive(topic, raw)
        except ValueError:
            fault = OccupancyGridUpdate.decode(raw)
            assert kind is Planner
            assert not 0 <= fault.x * fault.y <= WORKSPACE
    assert capsys.readouterr().err.count("\n") <= 12


@pytest.mark.parametrize("topic", Planner.INPUTS)
def test_planner_survives_flipped_bytes(topic, capsys):
    planner, _ = start(Planner)
    message = {
        "/map": OccupancyGrid((1, 2), 2.0, 3, 2, 0.0, 0.0, bytes(6)),
        "/map_updates": update(3, 4),
        "/odom": Odometry((2**31 - 1, 2**32 - 1), 1.0, 2.0, 0.0, 0.0),
        "/goal": PoseStamped((1, 2), 3.0, 4.0),
    }[topic]
    raw = message.encode()
    rng = random.Random(6)
    for _ in range(3000):
        changed = bytearray(raw)
        changed[rng.randrange(len(raw))] = rng.randrange(256)
        try:
            planner.receive(topic, bytes(changed))
        except ValueError:
            fault = OccupancyGridUpdate.decode(bytes(changed))
            assert not 0 <= fault.x * fault.y <= WORKSPACE


def test_planner_plans_from_the_rover_to_the_goal():
    planner, sent = start(Planner)
    planner.receive("/odom", Odometry((9, 1), 1.0, 2.0, 0.0, 0.0).encode())
    planner.receive("/goal", PoseStamped((0, 0), 9.0, 10.0).encode())
    for _ in range(4):
        planner.receive("/odom", Odometry((9, 1), 1.0, 2.0, 0.0, 0.0).encode())
    [(topic, plan)] = sent
    assert topic == "/plan"
    assert (plan.poses[-1].x, plan.poses[-1].y) == (9.0, 10.0)
    assert plan.stamp == (9, 1)


def test_window_leaves_the_map_only_for_goals_in_the_south():
    rng = random.Random(7)
    for _ in range(5000):
        goal_x, goal_y = rng.uniform(-100, 100), rng.uniform(-100, 100)
        vx, vy = rng.uniform(-2, 2), rng.uniform(-2, 2)
        x, y = window_origin(goal_x, goal_y, vx, vy)
        assert 1 <= x <= 399
        assert y <= 399
        assert (y < 0) == (goal_y - vy < -80.0)


def mapped(goals, velocity=(0.0, 0.0), count=5):
    mapper, sent = start(Mapper)
    for x, y in goals:
        mapper.receive("/goal", PoseStamped((0, 0), x, y).encode())
    for step in range(count):
        mapper.receive("/odom", Odometry((step // 25, step % 25 * 40_000_000), 0.0, 0.0, *velocity).encode())
    return [message for topic, message in sent if topic == "/map_updates"], sent


def test_mapper_limits_what_the_odometry_says():
    assert mapped([(0.0, 0.0)])[0][0].y == 160
    assert mapped([(0.0, 0.0)], (1e9, -1e9))[0][0].x == 196
    assert mapped([(0.0, 0.0)], (1e9, -1e9))[0][0].y == 164
    assert mapped([(0.0, 0.0)], (math.nan, math.inf))[0][0].y == 160


@pytest.mark.parametrize("goal", [(0.0, -100.0), (100.0, 0.0), (math.nan, 0.0), (0.0, math.inf), (1e308, -90.0)])
def test_refused_goals_change_nothing(goal, capsys):
    assert mapped([goal])[0] == []
    assert [window.y for window in mapped([(0.0, 10.0), goal])[0]] == [180]
    assert "goal refused" in capsys.readouterr().err


def test_mapper_sends_maps_by_simulated_time():
    updates, sent = mapped([(1.0, 1.0)], count=251)
    assert len(updates) == 50
    assert len([topic for topic, _ in sent if topic == "/map"]) == 2
    assert sent[0][1].data.count(0) == 1


def test_window_shows_where_the_rover_was():
    assert mapped([(0.5, 20.5)])[0][0].data.count(0) == 0
    assert mapped([(0.0, 20.0)])[0][0].data[0] == 0


def world(seed, commands=0):
    sim, sent = start(Sim, seed)
    for tick in range(100):
        if commands:
            sim.receive("/cmd_vel", Twist(1.0, -5.0).encode())
        sim.tick(tick)
    return sim, [(topic, message.encode()) for topic, message in sent]


def test_sim_depends_on_its_seed_alone():
    assert world(1)[1] == world(1)[1]
    assert world(1)[1] != world(2)[1]
    topics = [topic for topic, _ in world(1)[1]]
    counts = {topic: topics.count(topic) for topic in Sim.OUTPUTS}
    assert counts == {"/odom": 100, "/imu": 100, "/gps/fix": 20, "/battery_state": 8, "/joy": 20}


def test_sim_drives_as_commanded_within_its_means():
    sim, _ = world(1, commands=1)
    assert 3.0 < sim.body.x < 4.0
    assert -6.0 < sim.body.y < -4.5


def test_operator_stays_away_from_the_edges():
    operator, sent = start(Operator, 3)
    for tick in range(400):
        operator.tick(tick)
    places = [(goal.x, goal.y) for _, goal in sent]
    assert len(set(places)) > 200
    assert all(abs(x) <= 60 and abs(y) <= 60 for x, y in places)
    again, resent = start(Operator, 3)
    for tick in range(400):
        again.tick(tick)
    assert [goal.encode() for _, goal in resent] == [goal.encode() for _, goal in sent]


def test_controller_steers_along_the_plan(capsys):
    controller, sent = start(Controller)
    poses = [PoseStamped((0, 0), 0.1, 0.0), PoseStamped((0, 0), 0.0, 50.0)]
    controller.receive("/plan", Path((0, 0), poses).encode())
    controller.receive("/plan", Path((0, 0), [PoseStamped((0, 0), math.nan, 0.0)]).encode())
    for _ in range(2):
        controller.receive("/odom", Odometry((0, 0), 0.0, 0.0, 0.0, 0.0).encode())
    [(_, command)] = sent
    assert (command.vx, command.vy) == pytest.approx((0.0, 1.4))
    assert "plan refused" in capsys.readouterr().err


def test_warnings_are_limited(capsys):
    component = Component(print)
    for _ in range(100):
        component.warn("goal refused", "off the map")
    assert capsys.readouterr().err.count("\n") == 1
