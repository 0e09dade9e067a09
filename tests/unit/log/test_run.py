from riot_bus import __version__
from riot_bus.log.run import run_facts


def test_a_recording_says_where_and_when_it_was_made():
    found = run_facts()
    assert found["riot_bus"] == __version__
    assert found["began"].endswith("Z")
    assert all(isinstance(text, str) and text for text in found.values())
