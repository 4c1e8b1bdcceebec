"""Reading TOML: what is none has one message that names the file."""

import pytest

from driveline.quantities import InputError
from driveline.toml import read_toml


@pytest.mark.parametrize(("text", "message"), [
    ("a = 1" + 400 * "0", "a is an integer of more than 64 bits"),
    ("[a]\nb = [1.0, { c = -9223372036854775809 }]", r"a\.b\.c is an integer of more than 64 bits"),
    ("a = 0x" + 5000 * "f", "a is an integer of more than 64 bits"),
    ("a = " + 5000 * "1", "this is not TOML: .*digits"),
    ("a = " + 5000 * "[" + 5000 * "]", "tables or lists are nested too deeply"),
    ("[" + 3000 * "a." + "b]", "tables or lists are nested too deeply"),
    ("a = 1 = 2", "this is not TOML: .*line 1"),
])
def test_what_python_reads_though_it_is_no_toml_is_refused(tmp_path, text, message):
    path = tmp_path / "file.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=rf"file.toml: {message}"):
        read_toml(path)


def test_the_longest_integers_of_toml_are_read(tmp_path):
    path = tmp_path / "file.toml"
    path.write_text("a = [9223372036854775807, -9223372036854775808]", encoding="utf-8")
    assert read_toml(path)[1] == {"a": [2**63 - 1, -2**63]}
