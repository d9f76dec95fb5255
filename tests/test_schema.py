"""YAML files: scalars of YAML 1.2, plain data only, and refusals of one short printable sentence."""

import math

import pytest
from hypothesis import given, settings, strategies as st

from exodrake.core.errors import MAX_MESSAGE, InputError
from exodrake.core.schema import MAX_BYTES, dump_yaml, parse_json, parse_yaml
from exodrake.data import case, import_log as mapping
from exodrake.identification.kinematics import markers
from exodrake.machines import robot_file
from exodrake.simulation import scenario

SCHEMAS = [module.SCHEMA for module in (robot_file, scenario, case, mapping, markers)]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 0.001), ("1:30", "1:30"), ("no", "no"), ("on", "on"), ("010", 10), ("0o17", 15), ("0x1F", 31),
        (".inf", math.inf), ("-.INF", -math.inf), ("1_000", "1_000"), ("2020-01-01", "2020-01-01"), ("~", None),
        ("true", True), ("'1'", "1"), ("+.5e1", 5.0), ("1e999", "1e999"), ("<<", "<<"), ("", None), ("# none", None),
    ],
)  # fmt: skip
def test_scalars_are_those_of_yaml_1_2(text, value):
    found = parse_yaml(text.encode(), "f.yaml")
    assert found == value and type(found) is type(value)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"a: &x 1\nb: 2", ["line 1", "anchors"]),
        (b"a: 1\nb: *x", ["line 2", "anchors"]),
        (b"a: !!float 1", ["tag"]),
        (b"a: 1\n'a': 2", ["line 2", "'a'", "twice"]),
        (b"a: {b: 1, b: 1}", ["'b'", "twice"]),
        (b"? [1]\n: 2", ["no name"]),
        (b"[" * 10**6, ["nested"]),
        (b"a: 1\n---\nb: 1", ["second document"]),
        (b"x" * (MAX_BYTES + 1), ["bytes"]),
        (b'"\\a": 1\n"\\a": 2', ["'\\x07'"]),
    ],
)
def test_more_than_plain_data_is_refused(data, words):
    with pytest.raises(InputError) as caught:
        parse_yaml(data, "f.yaml")
    assert "f.yaml" in str(caught.value) and all(word in str(caught.value) for word in words)


KEYS = ("machine", "base", "parameters", "effects", "parts", "limits", "grasps", "tolerances", "logs", "file", "period")
INNER_KEYS = ("time", "columns", "name", "unit", "scale", "value", "range", "tip", "seed", "engine", "transform")
SCALARS = st.one_of(
    st.none(), st.booleans(), st.floats(), st.integers(), st.text(), st.just(10**400), st.just("x" * 999)
)
CONTENT = st.recursive(
    SCALARS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(st.one_of(st.sampled_from(KEYS + INNER_KEYS), st.text()), inner, max_size=4),
    ),
    max_leaves=15,
)


@settings(max_examples=100, deadline=None)
@given(content=CONTENT, schema=st.sampled_from(SCHEMAS), source=st.text(max_size=400))
def test_any_content_is_taken_or_refused_in_a_short_printable_sentence(content, schema, source):
    try:
        schema(content, source)
    except InputError as problem:
        assert len(str(problem)) <= MAX_MESSAGE and str(problem).isprintable()


FINITE = st.one_of(st.none(), st.booleans(), st.floats(allow_nan=False), st.integers(), st.text())
PLAIN = st.recursive(
    FINITE, lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(), inner, max_size=4))
)


@settings(max_examples=100, deadline=None)
@given(content=st.dictionaries(st.text(), PLAIN, max_size=4))
def test_what_is_dumped_is_what_is_parsed(content):
    assert parse_yaml(dump_yaml(content).encode(), "f.yaml") == content


def test_json_may_be_larger_than_yaml():
    """An answer of many frames is; a robot file is not."""
    assert parse_json(b"[" + b" " * MAX_BYTES + b"]", "answer.json") == []
