"""Tables as pages."""

import re

from sphpod.pipeline import page


def test_a_page_holds_all_of_a_table_as_text(tmp_path):
    table = tmp_path / "some_rows.csv"
    table.write_text(
        "name,error,verdict\n<b>a & b</b>,0.000123456789,reproduced\nc,,deviates\n",
        encoding="utf-8",
    )
    page.write(table, tmp_path / "some_rows.html")
    text = (tmp_path / "some_rows.html").read_text(encoding="utf-8")
    assert "<title>some rows</title>" in text
    assert "<td>&lt;b&gt;a &amp; b&lt;/b&gt;</td>" in text
    # Sorted by all digits, read by four.
    assert '<td class="number" data-value="0.000123456789">0.0001235</td>' in text
    assert '<tr class="deviates"><td>c</td><td></td><td>deviates</td></tr>' in text
    assert not re.search(r"(src|href)=", text)


def test_a_table_without_rows_is_a_page(tmp_path):
    (tmp_path / "none.csv").write_text("a,b\n", encoding="utf-8")
    page.write(tmp_path / "none.csv", tmp_path / "none.html")
    assert "<tbody></tbody>" in (tmp_path / "none.html").read_text(encoding="utf-8")
