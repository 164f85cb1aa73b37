"""Other programs beside this one: the page has the tables of the stored figures."""

import pages
import peers


def test_tables_are_those_of_the_stored_figures():
    page = (pages.DOCS / "validation" / "peers.md").read_text("utf-8")
    for name, text in peers.blocks(peers.stored()).items():
        assert f"<!-- {name} -->\n{text.strip()}\n<!-- /{name} -->" in page, (
            "python pipelines/peers.py --tables makes them anew"
        )
