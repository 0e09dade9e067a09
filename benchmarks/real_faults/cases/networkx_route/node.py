"""Finds the cheapest way between two places of a warehouse; lanes get other costs, or are closed for a while."""

import networkx

REFUSED = (networkx.NetworkXNoPath, networkx.NodeNotFound)


def node(publish, checked):
    lanes = networkx.Graph()
    for row, letter in enumerate("ABCDEF"):
        for column in range(1, 7):
            if column < 6:
                lanes.add_edge(f"{letter}{column}", f"{letter}{column + 1}", cost=1.0, open=True)
            if row < 5:
                lanes.add_edge(f"{letter}{column}", f"{'BCDEF'[row]}{column}", cost=1.5, open=True)

    def cost(a, b, lane):
        return lane["cost"] if lane["open"] else None

    def lane(m):
        if lanes.has_edge(m["a"], m["b"]) and 0.01 <= m["cost"] <= 1e4:
            lanes.edges[m["a"], m["b"]].update(cost=m["cost"], open=m["open"])

    def ask(m):
        total, path = networkx.single_source_dijkstra(lanes, m["start"], m["end"], weight=cost)
        publish("route", {"robot": m["robot"][:40], "path": path, "cost": total})

    return {"lane": lane, "ask": ask}
