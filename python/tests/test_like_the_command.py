"""The package and the command make the same points and say the same sentences."""

from __future__ import annotations

import json

import numpy as np
import pytest
import recordings

import radarllm as rl

MOTIONS = [
    "builtin:walk?direction=backward",
    "builtin:walk?speed=slow",
    "builtin:wave?side=left",
    "builtin:sit_down",
    "builtin:squat",
    "builtin:punch",
    "builtin:jumping_jack",
    "builtin:kick?side=right",
    "builtin:turn",
    "builtin:pick_up",
]


def known(run) -> list[str]:
    names = json.loads(run("motion", "list", "--json"))
    return [entry["name"] if isinstance(entry, dict) else entry for entry in names]


def without_time(row: dict) -> dict:
    return {k: v for k, v in row.items() if k not in ("seconds", "peak_memory_mb", "source")}


def rounded(row: dict) -> dict:
    """The row with the numbers that JSON shortens as JSON has them."""
    return json.loads(json.dumps(row), parse_float=lambda text: np.float32(text).item())


@pytest.mark.parametrize("motion", MOTIONS)
def test_simulated_motions(motion, run, described, model, tmp_path):
    if motion.removeprefix("builtin:").split("?")[0] not in known(run):
        pytest.fail(f"{motion} is no built-in motion any more")
    ours, theirs = tmp_path / "ours.parquet", tmp_path / "theirs.parquet"
    run("simulate", motion, "--out", theirs, "--seed", 3)
    points = rl.simulate(motion, seed=3, own_noise=True)
    points.write(ours)
    assert ours.read_bytes() == theirs.read_bytes()

    row = described(motion, "--seed", 3)
    sentence = model.describe(rl.simulate(motion, seed=3))
    assert rounded(without_time(sentence.to_dict())) == rounded(without_time(row))
    assert sentence.source == row["source"]

    row = described(theirs)
    sentence = model.describe(rl.Points.read(ours))
    assert rounded(without_time(sentence.to_dict())) == rounded(without_time(row))


@pytest.mark.parametrize("kind", ["bvh", "npy"])
def test_motion_files(kind, run, described, model, tmp_path):
    path = tmp_path / f"take.{kind}"
    if kind == "bvh":
        path.write_text(recordings.bvh())
    else:
        run("motion", "mesh", "builtin:walk", "--out", tmp_path / "mesh.npz")
        x, y, z = np.moveaxis(np.load(tmp_path / "mesh.npz")["joints"][:, :22], -1, 0)
        # HumanML3D's joints have y up.
        np.save(path, np.stack([x, z, -y], axis=-1).astype("f4"))
    ours, theirs = tmp_path / "ours.parquet", tmp_path / "theirs.parquet"
    run("simulate", path, "--out", theirs)
    rl.simulate(path, own_noise=True).write(ours)
    assert ours.read_bytes() == theirs.read_bytes()
    row = described(path)
    sentence = model.describe(rl.simulate(path))
    assert rounded(without_time(sentence.to_dict())) == rounded(without_time(row))


# A file of points is described and not processed.
RECORDINGS = ["uart", "npy", "npy axes", "adc", "pcap", "radhar", "mars", "bag", "points", "csv"]


@pytest.mark.parametrize("name", RECORDINGS)
def test_recordings(name, files, run, described, model, tmp_path):
    path, keywords, flags = files[name]
    ours, theirs = tmp_path / "ours.parquet", tmp_path / "theirs.parquet"
    if name == "points":
        theirs.write_bytes(path.read_bytes())
    else:
        report = json.loads(run("process", path, *flags, "--out", theirs, "--json"))
    with rl.open_capture(path, **keywords) as capture:
        points = capture.points()
        points.write(ours)
        assert ours.read_bytes() == theirs.read_bytes()
        if name != "points":
            assert {**capture.report, "out": 0} == {**report, "out": 0}
        assert points.n_points > 0
        if name in ("npy", "npy axes", "adc"):
            arrays = rl.process(list(capture), radar=keywords["radar"], synthetic=False, source=str(path))
            arrays.write(ours, overwrite=True)
            assert ours.read_bytes() == theirs.read_bytes()
    row = described(path, *flags)
    sentence = model.describe(points)
    assert rounded(without_time(sentence.to_dict())) == rounded(without_time(row))


def test_people(run, model, files, walk, tmp_path):
    path = tmp_path / "walk.parquet"
    walk.write(path)
    lines = run("describe", path, "--people", "auto", "--json").splitlines()
    rows = [json.loads(line) for line in lines]
    found = rl.people(rl.Points.read(path))
    assert [row["person"]["id"] for row in rows] == [person.id for person in found] == [1]
    for row, person in zip(rows, found):
        assert row["person"]["points"] == person.points.n_points
        assert row["person"]["start_s"] == person.start_s
        assert row["caption"] == model.describe(person.points).caption


def test_choices_and_memory(run, model, tmp_path):
    motion = "builtin:squat"
    row = json.loads(run("describe", motion, "--choose", "boxing,squats,walking", "--json"))
    sentence = rl.Model(choose=["boxing", "squats", "walking"]).describe(rl.simulate(motion))
    assert rounded(sentence.to_dict()["choices"]) == rounded(row["choices"])
    assert sentence.choices[0][0] == "squats"

    says = "a person sits down in the wheelchair"
    ours, theirs = tmp_path / "ours.json", tmp_path / "theirs.json"
    memory = rl.Memory()
    for seed in (1, 2, 3):
        points = tmp_path / f"{seed}.parquet"
        rl.simulate("builtin:sit_down", seed=seed).write(points)
        memory.teach("wheelchair", rl.Points.read(points), says=says)
        run("teach", "wheelchair", "--says", says, points, "--memory", theirs)
    memory.save(ours)
    assert ours.read_bytes() == theirs.read_bytes()
    row = json.loads(run("describe", points, "--memory", theirs, "--json"))
    for taught in (memory, ours):
        sentence = rl.Model(memory=taught).describe(rl.Points.read(points))
        assert rounded(without_time(sentence.to_dict())) == rounded(without_time(row))
    memory.forget("wheelchair")
    assert memory.activities == [] and repr(memory) == "Memory()"
    with pytest.raises(rl.Error, match="nothing named `wheelchair`"):
        memory.forget("wheelchair")
    with pytest.raises(rl.Error, match="what is said"):
        memory.teach("wheelchair", rl.Points.read(points))


def test_a_memory_that_another_program_changed_is_kept(run, tmp_path):
    says = "a person sits down in the wheelchair"
    path, points = tmp_path / "memory.json", tmp_path / "points.parquet"
    rl.simulate("builtin:sit_down").write(points)
    first = rl.Memory()
    first.teach("wheelchair", rl.Points.read(points), says=says)
    first.save(path)
    ours = rl.Memory(path)
    run("teach", "squats", "--says", "a person squats", "builtin:squat", "--memory", path)
    for memory in (first, ours):
        memory.teach("bows", rl.simulate("builtin:bow"), says="a person bows")
        with pytest.raises(rl.Error, match="another program changed this memory"):
            memory.save(path)
    assert [a["name"] for a in rl.Memory(path).activities] == ["wheelchair", "squats"]
    again = rl.Memory(path)
    again.teach("bows", rl.simulate("builtin:bow"), says="a person bows")
    again.save(path)
    again.forget("bows")
    again.save(path)
    assert [a["name"] for a in rl.Memory(path).activities] == ["wheelchair", "squats"]


@pytest.mark.parametrize("protocol", ["plain", "nlg-eval", "coco", "motiongpt"])
def test_scores(protocol, run, tmp_path):
    candidates = ["a person walks forward slowly", "a person waves", "a person kicks with the left leg"]
    references = [
        ["a person walks forward", "somebody slowly walks ahead", "a human walks"],
        ["someone is waving", "a person waves with the right hand", "a man waves"],
        ["a person kicks", "someone kicks with the left foot", "a person kicks forward"],
    ]
    c, r = tmp_path / "c.jsonl", tmp_path / "r.jsonl"
    c.write_text("".join(json.dumps({"id": str(i), "text": t}) + "\n" for i, t in enumerate(candidates)))
    r.write_text("".join(json.dumps({"id": str(i), "texts": t}) + "\n" for i, t in enumerate(references)))
    theirs = json.loads(run("score", "--candidates", c, "--references", r, "--protocol", protocol))
    assert rl.score(candidates, references, protocol=protocol) == theirs
    by_id = rl.score(
        {str(i): t for i, t in enumerate(candidates)},
        {str(i): t for i, t in enumerate(references)},
        protocol=protocol,
    )
    assert by_id == theirs and list(by_id) == list(theirs)


def test_data_sets(run, tmp_path):
    plan = tmp_path / "plan.toml"
    plan.write_text('name = "small"\n[[source]]\nkind = "procedural"\ntrain = 3\nval = 1\ntest = 1\n')
    run("dataset", "build", plan, "--out", tmp_path / "theirs")
    report = rl.DatasetPlan(plan).build(tmp_path / "ours", threads=2)
    assert {**report, "seconds": 0} == {
        "clips": 5,
        "failed": 0,
        "skipped": 0,
        "shards": 3,
        "shards_made": 3,
        "seconds": 0,
    }
    ours = sorted(p.relative_to(tmp_path / "ours") for p in (tmp_path / "ours").rglob("*") if p.is_file())
    theirs = sorted(p.relative_to(tmp_path / "theirs") for p in (tmp_path / "theirs").rglob("*") if p.is_file())
    assert ours == theirs
    for name in ours:
        assert (tmp_path / "ours" / name).read_bytes() == (tmp_path / "theirs" / name).read_bytes(), name
    assert rl.DatasetPlan(plan).build(tmp_path / "ours")["shards_made"] == 0
    assert rl.Dataset(tmp_path / "ours").info() == json.loads(run("dataset", "info", tmp_path / "theirs", "--json"))
