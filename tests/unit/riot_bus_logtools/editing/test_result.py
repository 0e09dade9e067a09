from riot_bus_logtools.editing.result import EditCounts, EditResult


def test_sums_over_all_topics():
    result = EditResult([EditCounts("a", "a", 5, 3, 1, 2, 0, 1), EditCounts("b", "c", 2, 2, 0, 0, 4)])
    document = result.document()
    assert document["total"] == {"read": 7, "kept": 5, "changed": 1, "dropped": 2, "added": 4, "originals": 1}
    assert [each["written_as"] for each in document["topics"]] == ["a", "c"]
