import signatures


def test_public_names_parameters_and_defaults_are_those_on_file():
    before, now = signatures.FILE.read_text().splitlines(), signatures.lines()
    changed = [f"- {line}" for line in before if line not in now] + [f"+ {line}" for line in now if line not in before]
    assert not changed, "if this is meant, run python tests/signatures.py:\n" + "\n".join(changed)
    assert now == before


def test_it_tells_a_changed_default():
    def one(a, *, b=3):
        pass

    assert signatures.described("one", one) == ["one(a, keyword b=3)"]
    one.__kwdefaults__["b"] = 4
    assert signatures.described("one", one) == ["one(a, keyword b=4)"]
