"""The hot loops are vector code: what the compiler really emitted is read back."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from llvmlite import binding
from numba import njit

from pipeline import cached_kernels
from pipeline.render import composite_kernels, dominance_kernels, passes
from tests.render.scenes import camera, random_scene

pytestmark = pytest.mark.skipif(
    not binding.get_host_cpu_features().get("avx2", False), reason="this machine has no AVX2"
)


def _assembly(monkeypatch: pytest.MonkeyPatch, module, name: str, outputs: tuple[str, ...]) -> list[str]:
    """Compile a kernel anew (a cached one has no assembly) on one real frame and return its instructions."""
    fresh = njit(nogil=True, error_model="numpy")(getattr(module, name).py_func)
    monkeypatch.setattr(passes, name, fresh)
    from pipeline.render import render

    render(random_scene(1, 50), camera(32, 32), outputs)
    (text,) = fresh.inspect_asm().values()
    return text.splitlines()


@pytest.mark.parametrize(
    ("module", "name", "outputs"),
    [
        (composite_kernels, "composite", ("color", "depth", "alpha")),
        (dominance_kernels, "dominate", ("dominant",)),
    ],
)
def test_blending_uses_whole_vectors(monkeypatch, module, name: str, outputs: tuple[str, ...]) -> None:
    lines = _assembly(monkeypatch, module, name, outputs)
    wide = [line for line in lines if re.search(r"\b[yz]mm\d", line)]
    fused = [line for line in wide if "vfmadd" in line or "vfnmadd" in line]
    scalar_fused = [line for line in lines if re.search(r"vfn?m(add|sub)\d+ss", line)]
    # One loop body needs about 30 vector instructions, 10 of them fused.
    assert len(wide) > 60
    assert len(fused) >= 10
    assert len(scalar_fused) < len(fused)


def test_cached_machine_code_depends_on_every_kernel_file(tmp_path: Path) -> None:
    """A changed helper in another file must not leave an old kernel in the cache."""
    folder = Path(cached_kernels.__file__).parent
    paths = sorted(path.relative_to(folder) for path in folder.rglob("*_kernels.py"))
    assert {Path("render/tile_kernels.py"), Path("render/simd_kernels.py"), Path("cached_kernels.py")} <= set(paths)
    stamp = composite_kernels.composite._cache._cache_file._source_stamp
    assert stamp == cached_kernels.source_digest()
    for path in paths:
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_bytes((folder / path).read_bytes())
    assert _digest_of(tmp_path) == stamp
    with (tmp_path / "render/tile_kernels.py").open("a") as file:
        file.write("# changed")
    assert _digest_of(tmp_path) != stamp


def test_kernels_work_where_nothing_can_be_cached(monkeypatch: pytest.MonkeyPatch) -> None:
    def njit_without_cache(*, cache: bool = False, **options: object):
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return njit(**options)

    monkeypatch.setattr(cached_kernels, "njit", njit_without_cache)
    assert cached_kernels.kernel(lambda x: x + 1)(41) == 42


def _digest_of(folder: Path) -> str:
    """Run the digest as if the package lay in `folder`."""
    name = str(folder / "cached_kernels.py")
    namespace = {"__file__": name, "__name__": "copied_kernels"}
    exec(compile(Path(name).read_text(), name, "exec"), namespace)
    return namespace["source_digest"]()
