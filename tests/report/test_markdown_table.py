from edvo.report.markdown_table import markdown_table


def test_a_bar_in_a_cell_does_not_split_it() -> None:
    assert markdown_table(["a|b", "c"], [["d", "e"]]) == "| a\\|b | c |\n| --- | ---: |\n| d | e |"


def test_columns_go_where_they_are_told() -> None:
    found = markdown_table(["a", "b"], [["1", "c  d"]], right=[True, False])
    assert found == "| a | b |\n| ---: | --- |\n| 1 | c d |"
