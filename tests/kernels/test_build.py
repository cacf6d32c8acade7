"""The build chooses a compiler, and names what is missing."""

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import types
from pathlib import Path

import pytest

KERNELS = Path(__file__).parents[2] / "nvsdata/kernels"
HOOKS = """build_sdist build_wheel build_editable get_requires_for_build_sdist get_requires_for_build_wheel
get_requires_for_build_editable prepare_metadata_for_build_wheel prepare_metadata_for_build_editable""".split()


@pytest.fixture
def backend(monkeypatch, tmp_path):
    """The backend, with a scikit-build-core that builds nothing, on a machine without compilers."""
    build = types.ModuleType("scikit_build_core.build")
    for name in HOOKS:
        setattr(build, name, lambda *_: ["ninja"])
    core = types.ModuleType("scikit_build_core")
    core.build = build
    monkeypatch.setitem(sys.modules, "scikit_build_core", core)
    monkeypatch.setitem(sys.modules, "scikit_build_core.build", build)
    for name in "CC CXX AR RANLIB".split():
        # what a test sets is undone
        monkeypatch.setenv(name, "")
    (tmp_path / "bin").mkdir()
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    spec = importlib.util.spec_from_file_location("backend", KERNELS / "native/backend.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def add_program(path, lines):
    path.write_text("#!/bin/sh\n" + lines)
    path.chmod(0o755)
    return path


@pytest.mark.skipif(os.name == "nt", reason="CMake finds Visual Studio's compiler")
class TestWithoutCompilers:
    def test_needs_zig(self, backend):
        assert backend.get_requires_for_build_wheel() == ["ninja", "ziglang"]
        assert backend.get_requires_for_build_editable() == ["ninja", "ziglang"]

    @pytest.mark.parametrize("hook", ["build_wheel", "build_editable"])
    def test_compiles_by_zig(self, backend, hook, monkeypatch, tmp_path):
        zig = tmp_path / "site/ziglang"
        zig.mkdir(parents=True)
        (zig / "__init__.py").touch()
        (zig / "__main__.py").write_text("import sys; print(*sys.argv[1:], sep='|')")
        monkeypatch.syspath_prepend(zig.parent)
        monkeypatch.setenv("PYTHONPATH", str(zig.parent))
        ran = []

        def compile_one(*_):
            for name in "CC CXX AR RANLIB".split():
                line = [os.environ[name], "a file.cpp"]
                ran.append(subprocess.run(line, capture_output=True, text=True, check=True).stdout.strip())
            return os.environ["CXX"]

        monkeypatch.setattr(backend.build, hook, compile_one)
        script = getattr(backend, hook)("out")
        # zig's own choice is the processor that it runs on
        cpu = "-mcpu=x86_64_v2" if platform.machine() == "x86_64" else "-mcpu=baseline"
        assert ran == [f"cc|{cpu}|a file.cpp", f"c++|{cpu}|a file.cpp", "ar|a file.cpp", "ranlib|a file.cpp"]
        assert not Path(script).exists()

    @pytest.mark.parametrize("hook", ["build_wheel", "build_editable"])
    def test_says_what_to_install_without_zig(self, backend, hook, monkeypatch):
        monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
        with pytest.raises(SystemExit, match=r"no C\+\+ compiler was found. Install one .*pip install ziglang"):
            getattr(backend, hook)("out")

    @pytest.mark.parametrize("name", ["c++", "g++", "clang++"])
    def test_a_compiler_is_enough(self, backend, name, tmp_path):
        add_program(tmp_path / "bin" / name, "")
        assert backend.get_requires_for_build_wheel() == ["ninja"]
        assert backend.build_wheel("out") == ["ninja"]
        assert not os.environ["CXX"]

    def test_a_named_compiler_is_enough(self, backend, monkeypatch):
        monkeypatch.setenv("CXX", "/opt/c++")
        assert backend.get_requires_for_build_wheel() == ["ninja"]
        backend.build_wheel("out")
        assert os.environ["CXX"] == "/opt/c++"


def configure(folder, *options, **environment):
    line = ["cmake", "-S", KERNELS, "-B", folder, f"-DPython_EXECUTABLE={sys.executable}", *options]
    found = subprocess.run(line, capture_output=True, text=True, env=os.environ | environment, check=False)
    return found.returncode, " ".join(found.stderr.split())


needs_cmake = pytest.mark.skipif(
    os.name == "nt" or not (shutil.which("cmake") and shutil.which("g++")), reason="needs cmake and g++"
)


@needs_cmake
def test_a_compiler_too_old_is_named(tmp_path):
    lines = f"""
for word in "$@"; do
    case "$word" in -std=*17) echo "unrecognized command line option '$word'" >&2; exit 1;; esac
done
exec "{shutil.which("g++")}" -U__GNUC__ -U__GNUC_MINOR__ -D__GNUC__=4 -D__GNUC_MINOR__=8 -std=gnu++98 "$@"
"""
    old = add_program(tmp_path / "g++-4.8", lines)
    code, error = configure(tmp_path / "build", CXX=str(old))
    assert code
    assert f"{old} (GNU 4.8.0) does not compile C++17, which nvsdata's kernels need. Install gcc 9" in error


@needs_cmake
def test_missing_headers_are_named(tmp_path):
    code, error = configure(tmp_path / "build", f"-DPython_INCLUDE_DIR={tmp_path}")
    assert code
    assert f"The headers of Python (Python.h) are missing for {sys.executable}" in error
