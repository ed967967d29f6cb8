"""What the commands print with."""

from telescope_mount.commands import console


def test_a_name_with_brackets_is_no_markup_in_the_line_of_progress(monkeypatch, capsys):
    monkeypatch.setattr('sys.stderr.isatty', lambda: True)
    monkeypatch.setattr(console, 'PATIENCE', 3600.0)
    with console.Progress() as progress:
        progress('a[/]b.csv', 1, 3)
        progress._begin()
    assert 'a[/]b' in capsys.readouterr().err
