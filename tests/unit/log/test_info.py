from riot_bus.log.info import log_info
from riot_bus.log.writer import LogWriter
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message


def test_counts_per_topic(tmp_path):
    path = tmp_path / "a.mcap"
    with LogWriter(path, registry=TypeRegistry(), metadata={"seed": "3"}) as writer:
        for n in range(11):
            writer.write(Message(10**9 + n * 10**8, "a", b"{}"))
        writer.write(Message(10**9, "b", b"\xff"), role="original")
    info = log_info(path)
    a, b = info.topics
    assert (a.topic, a.count, a.encoding, a.bytes, a.rate) == ("a", 11, "json", 22, 10.0)
    assert (b.count, b.originals) == (0, 1)
    assert (info.count, info.seconds, info.size) == (11, 1.0, path.stat().st_size)
    assert info.metadata == {"seed": "3"}
    assert not info.loss


def test_empty_log(tmp_path):
    LogWriter(tmp_path / "a.mcap").close()
    info = log_info(tmp_path / "a.mcap")
    assert (info.count, info.start, info.seconds, bool(info.loss)) == (0, None, 0.0, False)
