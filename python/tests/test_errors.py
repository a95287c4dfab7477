"""Exceptions: kinds, hints, paths."""

from __future__ import annotations

import pickle

import pytest

import radarllm as rl


def test_kinds():
    assert issubclass(rl.Error, ValueError)
    assert issubclass(rl.NotFoundError, FileNotFoundError) and issubclass(rl.NotFoundError, rl.Error)
    assert issubclass(rl.ExistsError, FileExistsError) and issubclass(rl.ExistsError, rl.Error)
    assert issubclass(rl.Bug, RuntimeError) and not issubclass(rl.Bug, rl.Error)


def test_hint_and_path_are_kept():
    for kind in (rl.Error, rl.NotFoundError, rl.ExistsError):
        for error in (kind("what", hint="how", path="where"), pickle.loads(pickle.dumps(kind("what", hint="how", path="where")))):
            assert (error.hint, error.path) == ("how", "where")
            assert str(error) == "what\nhint: how"
        assert str(kind("what")) == "what" and kind("what").hint is None


@pytest.mark.parametrize(
    ("call", "kind", "message", "hint"),
    [
        (lambda: rl.Radar("none"), FileNotFoundError, "neither a built-in radar nor", None),
        (lambda: rl.Radar("none.cfg"), FileNotFoundError, "none.cfg", None),
        (lambda: rl.simulate("builtin:fly"), rl.Error, "fly", "radarllm motion list"),
        (lambda: rl.simulate("none.bvh"), FileNotFoundError, "none.bvh", "builtin:NAME"),
        (lambda: rl.simulate("builtin:walk", emit="sound"), rl.Error, "`emit`", "points"),
        (lambda: rl.simulate("builtin:walk", distance_m=-1), rl.Error, "`distance_m`", None),
        (lambda: rl.simulate("builtin:walk", distance_m=float("nan")), rl.Error, "`distance_m`", None),
        (lambda: rl.simulate("builtin:walk", threads=0), rl.Error, "`threads` 0", None),
        (lambda: rl.simulate("builtin:walk", processing="none.toml"), FileNotFoundError, "none.toml", None),
        (lambda: rl.simulate("builtin:walk", firmware="mine"), rl.Error, "`firmware`", "out-of-box"),
        (lambda: rl.simulate("builtin:walk", firmware="out-of-box"), rl.Error, "TI .cfg", None),
        (lambda: rl.simulate("builtin:walk", objects="none.toml"), FileNotFoundError, "none.toml", None),
        (lambda: rl.simulate("none.toml"), FileNotFoundError, "none.toml", None),
        (lambda: rl.Model("none"), FileNotFoundError, "none", None),
        (lambda: rl.Model(precision="f16"), rl.Error, "f16", "f32"),
        (lambda: rl.Model(choose=["boxing"]), rl.Error, "two different activities", "boxing"),
        (lambda: rl.Memory("none.json"), FileNotFoundError, "none.json", None),
        (lambda: rl.open_capture("none.dat"), FileNotFoundError, "none.dat", None),
        (lambda: rl.Dataset("none"), FileNotFoundError, "none", "DatasetPlan"),
        (lambda: rl.DatasetPlan("none.toml"), FileNotFoundError, "none.toml", None),
        (lambda: rl.score(["a"], [["a"]], protocol="x"), rl.Error, "`protocol`", "nlg-eval"),
        (lambda: rl.score(["a"], ["a"]), rl.Error, "one text", "a list of texts"),
        (lambda: rl.score(["a", "b"], [["a"]]), rl.Error, "missing from the references", None),
        (lambda: rl.score([], []), rl.Error, "no candidates", None),
    ],
)
def test_what_goes_wrong_is_named(call, kind, message, hint, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(kind) as raised:
        call()
    assert message in str(raised.value)
    if hint is not None:
        assert hint in raised.value.hint


def test_wrong_radar_files_are_named(tmp_path):
    path = tmp_path / "wrong.cfg"
    path.write_text("profileCfg 0 77\n")
    with pytest.raises(rl.Error) as raised:
        rl.Radar(path)
    assert raised.value.path == str(path) and not isinstance(raised.value, FileNotFoundError)


def test_a_panic_is_a_bug():
    from radarllm import _native

    with pytest.raises(rl.Bug, match="a wheel came off"):
        _native._panic("a wheel came off")
    # The package works on.
    assert rl.Radar("awr1843boost").frame_rate_hz == 10.0


def test_arguments_after_the_first_are_keywords(walk):
    for call in (
        lambda: rl.simulate("builtin:walk", "awr1843boost"),
        lambda: rl.people(walk, 2),
        lambda: walk.write("x", True),
        lambda: rl.open_capture("x", "awr1843boost"),
        lambda: rl.Model("x", "f32"),
    ):
        with pytest.raises(TypeError):
            call()
