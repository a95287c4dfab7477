"""Examples in docstrings and in the documentation run; stubs fit; the command is there."""

from __future__ import annotations

import doctest
import os
import subprocess
import sys
from pathlib import Path

import pytest

import radarllm as rl

ROOT = Path(__file__).parents[2]
# CI builds the package with the features of the workspace's tests, releases without.
HAS_TRAINING = "train" in os.environ.get("FEATURES", "").split(",")


def documented():
    yield "radarllm", rl.__doc__
    for name in rl.__all__:
        item = getattr(rl, name)
        if isinstance(item, str):
            continue
        yield name, item.__doc__
        if isinstance(item, type):
            for member in vars(item):
                if not member.startswith("_"):
                    yield f"{name}.{member}", getattr(vars(item)[member], "__doc__", None)


@pytest.mark.parametrize(("name", "text"), [pytest.param(n, t, id=n) for n, t in documented() if t and ">>>" in t])
def test_examples_of_docstrings(name, text):
    test = doctest.DocTestParser().get_doctest(text, dict(vars(rl)), name, None, 0)
    report: list[str] = []
    doctest.DocTestRunner().run(test, out=report.append)
    assert not report, "".join(report)


def test_everything_is_documented():
    # A class attribute that is a plain value has the documentation of its class.
    missing = [name for name, text in documented() if not text and name != "Points.columns"]
    assert missing == []


def blocks(page: str) -> list[str]:
    return [b.split("```")[0] for b in (ROOT / page).read_text().split("```python\n")[1:]]


@pytest.mark.skipif(not (ROOT / "docs/guides/python.md").exists(), reason="no documentation beside the tests")
@pytest.mark.parametrize("page", ["README.md", "docs/guides/python.md"])
def test_blocks_of_the_documentation(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (block, *_) = blocks(page)
    exec(compile(block, page, "exec"), {})


@pytest.mark.skipif(not (ROOT / "examples").exists(), reason="no examples beside the tests")
def test_the_notebook_runs(tmp_path):
    nbformat = pytest.importorskip("nbformat", reason="nbformat is not installed")
    nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")
    pytest.importorskip("ipykernel", reason="ipykernel is not installed")
    for path in sorted((ROOT / "examples").glob("*.ipynb")):
        book = nbformat.read(path, as_version=4)
        nbclient.NotebookClient(book, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
        pages = [o for c in book.cells for o in c.get("outputs", []) if "text/html" in o.get("data", {})]
        assert pages, f"{path.name} shows no page"


def test_the_stubs_fit(tmp_path):
    pytest.importorskip("mypy", reason="mypy is not installed")
    # These modules are Python, without stubs of their own, and need what the package does not install.
    allowed = tmp_path / "allowed"
    allowed.write_text("radarllm\\.(torch|ray)(\\..*)?\n")
    # PyTorch and Ray need not be installed.
    config = tmp_path / "mypy.ini"
    config.write_text("[mypy]\n[mypy-torch.*,ray.*]\nignore_missing_imports = true\n")
    done = subprocess.run(
        [
            *(sys.executable, "-m", "mypy.stubtest", "radarllm", "--ignore-unused-allowlist"),
            *("--allowlist", str(allowed), "--mypy-config-file", str(config)),
        ],
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_package_is_typed(tmp_path):
    pytest.importorskip("mypy", reason="mypy is not installed")
    use = tmp_path / "use.py"
    use.write_text(
        "import radarllm as rl\n"
        "import numpy as np\n"
        "from numpy.typing import NDArray\n"
        "points: rl.Points = rl.simulate('builtin:walk')\n"
        "x_m: NDArray[np.float32] = points['x_m']\n"
        "sentences: list[rl.Sentence] = rl.Model().describe([points])\n"
        "cube: NDArray[np.complex64] = next(iter(rl.simulate('builtin:walk', emit='cubes')))\n"
    )
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", str(use)], capture_output=True, text=True, cwd=tmp_path, timeout=600
    )
    assert done.returncode == 0, done.stdout + done.stderr
    use.write_text("import radarllm as rl\nrl.simulate('builtin:walk', 'awr1843boost')\n")
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", str(use)], capture_output=True, text=True, cwd=tmp_path, timeout=600
    )
    assert done.returncode == 1 and "No overload variant" in done.stdout


def test_the_command_of_the_package():
    def run(*args, code=0):
        done = subprocess.run([sys.executable, "-m", "radarllm", *args], capture_output=True, text=True, timeout=600)
        assert done.returncode == code, done.stderr
        return done

    assert rl.__version__ in run("--version").stdout
    assert "a person" in run("demo").stdout
    wrong = run("describe", "none.dat", code=1)
    assert wrong.stderr.startswith("error: ")
    # Without training the hint says which build has it, otherwise the file is missing.
    missing = run("train", "all", "x.toml", code=1).stderr
    assert "x.toml: No such file" in missing if HAS_TRAINING else "hint: " in missing
    assert "Usage" in run("--help").stdout
    run("nonsense", code=1)


@pytest.mark.skipif(os.name != "posix", reason="reads a Linux library")
@pytest.mark.skipif(HAS_TRAINING, reason="built with training; crates/cli/tests/it/architecture.rs checks the default build")
def test_what_is_not_linked():
    from radarllm import _native

    code = Path(_native.__file__).read_bytes()
    for absent in (b"mimalloc", b"mi_malloc", b"burn_tensor", b"burn-tensor"):
        assert absent not in code, absent
    # What is there is found this way.
    assert b"radarllm" in code and b"safetensors" in code
