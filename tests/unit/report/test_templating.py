from __future__ import annotations

from riot_bus.report.templating import page_environment


def test_what_others_wrote_is_escaped_and_links_stay_below_the_page() -> None:
    environment = page_environment()
    template = environment.from_string("{{ text }} {{ 'a/b c' | link }} {{ '../x' | link or 'none' }}")
    assert template.render(text="<b>\x1b[31m") == "&lt;b&gt;\\x1b[31m ./a/b%20c none"
    assert environment.globals["digest"]
