"""ScanNet .sens files: streamed, strict about versions, codes and cut files."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.scene.captures import open_capture, read_sens
from schemas.errors import InputError
from tests.scene import box_room


def write(tmp_path: Path, data: bytes) -> Path:
    path = tmp_path / "scene0001_00.sens"
    path.write_bytes(data)
    return path


def test_names_sizes_and_lenses_come_from_the_head(tmp_path: Path) -> None:
    capture = read_sens(write(tmp_path, box_room.sens_bytes()))
    assert capture.name == "scene0001_00"
    assert [frame.name for frame in capture.frames] == ["000000", "000001", "000002", "000003"]
    frame = capture.frames[0]
    assert (frame.camera.width, frame.depth_lens.width) == (64, 32)
    assert (frame.camera.K[0, 0], frame.depth_lens.K[0, 0]) == (32, 16)
    np.testing.assert_allclose(frame.camera.world_to_camera, box_room.cameras()[0].world_to_camera, atol=1e-6)


def test_infinite_poses_are_skipped_and_counted(tmp_path: Path) -> None:
    poses = [np.full((4, 4), -np.inf), *(np.eye(4) for _ in range(3))]
    capture = read_sens(write(tmp_path, box_room.sens_bytes(poses)))
    assert [frame.name for frame in capture.frames] == ["000001", "000002", "000003"]
    assert capture.skip_counts == {"broken pose": 1}


def test_limit_takes_the_first_frames(tmp_path: Path) -> None:
    path = write(tmp_path, box_room.sens_bytes())
    assert len(read_sens(path, limit=2)) == 2
    assert len(read_sens(path, limit=99)) == 4


def test_openeqa_takes_the_first_600_frames(tmp_path: Path) -> None:
    camera = box_room.cameras()[0]
    pose = np.vstack([camera.camera_to_world, [0, 0, 0, 1]])
    one = box_room.sens_bytes([pose]).removesuffix(b"motion records follow")
    head = len(box_room.sens_bytes([])) - len(b"motion records follow")
    data = one[: head - 8] + (601).to_bytes(8, "little") + one[head:] * 601
    path = write(tmp_path, data)
    assert len(open_capture(str(path), "openeqa")) == 600
    assert len(open_capture(str(path))) == 601


def test_uncompressed_depth_is_read(tmp_path: Path) -> None:
    raw = read_sens(write(tmp_path, box_room.sens_bytes(depth=0))).frames[0].read_depth()
    np.testing.assert_allclose(raw, box_room.depth_m(box_room.cameras(width=32, height=18)[0]), atol=6e-4)


def test_the_file_is_not_held_in_memory(tmp_path: Path) -> None:
    path = write(tmp_path, box_room.sens_bytes())
    with path.open("r+b") as stream:
        # A third frame of 200 MB: a sparse file, so that the test writes nothing.
        data = path.read_bytes()
        at = data.index(b"motion")
        stream.seek(at)
        stream.write(np.eye(4, dtype="<f4").tobytes() + np.array([0, 0, 200_000_000, 0], "<u8").tobytes())
        stream.truncate(at + 96 + 200_000_000)
        stream.seek(data.index(b"StructureSensor") + 15 + 4 * 64 + 8 + 16 + 4)
        stream.write((5).to_bytes(8, "little"))
    tracemalloc.start()
    assert len(read_sens(path)) == 5
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("head", "message"),
    [
        ({"version": 3}, "version: expected 4, found 3"),
        ({"depth": 2}, r"depth compression: expected 0 \(raw\), 1 \(zlib\), found 2"),
        ({"color": 0}, "colour compression: expected 1"),
        ({"frames": 9}, "expected 9 frames, found 4"),
        ({"frames": 2**60}, "found 4, then the file ends"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path: Path, head: dict[str, int], message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_sens(write(tmp_path, box_room.sens_bytes(**head)))


@given(cut=st.integers(0, 4000))
@settings(max_examples=40, deadline=None)
def test_a_cut_file_is_an_input_error(cut: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    data = box_room.sens_bytes().removesuffix(b"motion records follow")
    path = write(tmp_path_factory.mktemp("cut"), data[: max(0, len(data) - 1 - cut)])
    with pytest.raises(InputError, match=r"expected \d+ (frames|more bytes)"):
        read_sens(path)


def test_damaged_depth_is_named_with_its_place(tmp_path: Path) -> None:
    path = write(tmp_path, box_room.sens_bytes())
    frame = read_sens(path).frames[1]
    data = bytearray(path.read_bytes())
    data[frame.depth.offset : frame.depth.offset + 8] = bytes(8)  # type: ignore[union-attr]
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"byte \d+: depth: expected deflated bytes"):
        frame.read_depth()


def test_depth_that_unpacks_to_more_than_the_image_stops_there(tmp_path: Path) -> None:
    path = write(tmp_path, box_room.sens_bytes())
    depth = read_sens(path).frames[0].depth
    import dataclasses

    with pytest.raises(InputError, match="expected 200 bytes, found 201 or more"):
        dataclasses.replace(depth, width=10, height=10).read()  # type: ignore[type-var]


def test_a_folder_without_one_sens_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"one \.sens file"):
        open_capture(str(tmp_path), "sens")
    with pytest.raises(InputError, match=r"a local \.sens file"):
        read_sens("s3://bucket/scene.sens")
