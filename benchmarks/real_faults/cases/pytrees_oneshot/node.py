"""Leaves the dock once, then drives around; goes charging while the battery is low."""

import py_trees
from py_trees.common import Status


class Undock(py_trees.behaviour.Behaviour):
    def initialise(self):
        self.odometer = None

    def update(self):
        if self.odometer is None:
            self.odometer = robot["odometer"]
        return Status.SUCCESS if robot["odometer"] - self.odometer >= 0.5 else Status.RUNNING


class Charge(py_trees.behaviour.Behaviour):
    def update(self):
        return Status.RUNNING if robot["volts"] < 11.1 else Status.FAILURE


robot = {}


def node(publish, checked):
    robot.update(volts=12.6, odometer=0.0, out=False)
    undock = py_trees.meta.oneshot(Undock)(name="undock")
    patrol = py_trees.composites.Sequence("mission", children=[undock, py_trees.behaviours.Running(name="drive")])
    root = py_trees.composites.Selector("root", children=[Charge(name="charge"), patrol])
    tree = py_trees.trees.BehaviourTree(root)

    def odometry(m):
        robot["odometer"] = m["odometer"]
        tree.tick()
        do = root.tip().name
        robot["out"] = robot["out"] or do == "drive"
        publish("command", {"do": do, "out": robot["out"], "heading": m["heading"]})

    return {"battery": lambda m: robot.update(volts=m["volts"]), "odometry": odometry}
