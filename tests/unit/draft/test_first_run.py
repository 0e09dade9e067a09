"""What a first run adds to what is known; runs themselves are tested with real processes in tests/integration."""

from __future__ import annotations

from riot_bus.draft.first_run import FirstRun, with_run
from riot_bus.draft.graph_draft import Seen, graph_draft
from riot_bus.draft.model import CommandDraft, TopicDraft
from riot_bus.graph.model import ConnectedComponent, Edge, Graph


def test_what_components_did_when_they_were_started() -> None:
    components = [ConnectedComponent("s", zid, "client", command=zid) for zid in ("sim", "arm")]
    known = [Edge("x", "publishes", "s", evidence=("traffic",)), Edge("x", "subscribes", "s", evidence=("matching",)),
             Edge("y", "subscribes", "s", evidence=("matching",)), Edge("z", "publishes", "s", "sim")]  # fmt: skip
    before = Seen(
        Graph.of(components, (), known, ()),
        {"x": TopicDraft("x", "x", "json", count=3)},
        {"sim": CommandDraft(("sim",)), "arm": CommandDraft(("arm",))},
    )
    names = graph_draft(before).names
    new = TopicDraft("w", "w", "cbor", count=1)
    run = FirstRun({"arm": {"x"}}, {"sim": {"x", "w"}}, {"arm": "it ended"}, {"x": TopicDraft("x", "x"), "w": new})
    found = with_run(before, run, names)
    assert [(each.topic, each.role, each.zid) for each in found.graph.edges] == [
        ("w", "publishes", "sim"), ("x", "publishes", "sim"), ("x", "subscribes", "arm"), ("y", "subscribes", ""),
        ("z", "publishes", "sim"),
    ]  # fmt: skip
    assert found.topics == {"x": before.topics["x"], "w": new}  # what was recorded counts
    assert found.commands["arm"].missing == ("what makes it work when riot starts it: it ended",)
    assert found.commands["sim"] is before.commands["sim"]
    draft = graph_draft(found, names=names)
    assert {part.name: part.external for part in draft.parts}["sim"] == "it subscribes to nothing"
    assert draft.unread == ("y",)
