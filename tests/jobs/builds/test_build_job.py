"""Build jobs as files and as options of the command line, and the verbs that tell of their runs."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from jobs.builds.build_captures import submit_build
from jobs.builds.build_job import BuildJob, load_build_job
from jobs.builds.build_plan import END_BYTES, capture_sha256, plan_captures
from jobs.cli import app
from pipeline.construct.training.train_config import TrainConfig
from schemas.errors import InputError, StopError
from tests.scene.box_room import write_seven_scenes
from tests.workers.fake_builds import MARKS, fake_build


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_seven_scenes(tmp_path_factory.mktemp("captures") / "room")


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_paths_are_relative_to_the_job_file(tmp_path: Path) -> None:
    (tmp_path / "labels").mkdir()
    job = load_build_job(
        write(
            tmp_path / "job.yaml",
            """
name: all
output: built
captures: [scans/*, {path: other, kind: scannet, name: hall}]
questions: q.jsonl
build:
  train: {steps: 0}
  semantics: {source: {kind: label_files, folder: labels}}
""",
        )
    )
    assert [entry.path for entry in job.captures] == [str(tmp_path / "scans/*"), str(tmp_path / "other")]
    assert (job.captures[1].kind, job.captures[1].name) == ("scannet", "hall")
    assert job.questions == str(tmp_path / "q.jsonl")
    assert job.build.train.steps == 0
    assert job.build.semantics.source is not None
    assert job.build.semantics.source.model_dump()["folder"] == str(tmp_path / "labels")
    assert job.scene_folder("hall") == str(tmp_path / "built" / "scenes" / "hall")


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("{kind: label_files, folder: 'labels/{scene}', instance: '{frame}.png'}", "labels/{scene}"),
        ("{kind: sam_clip, clip: labels}", "labels"),
        ("{kind: sam_clip, clip: openai/clip}", None),
    ],
)
def test_what_a_source_names_is_relative_to_the_job_file_where_it_is_a_path(
    tmp_path: Path, text: str, found: str | None
) -> None:
    (tmp_path / "labels").mkdir()
    job = f"{{name: a, output: b, captures: c, build: {{semantics: {{source: {text}}}}}}}"
    source = load_build_job(write(tmp_path / "job.yaml", job)).build.semantics.source
    assert source is not None
    values = source.model_dump()
    named = values["folder"] if "folder" in values else values["clip"]
    assert named == ("openai/clip" if found is None else str(tmp_path / found))
    assert values.get("instance", "{frame}.png") == "{frame}.png"


def test_pattern_may_ask_for_what_lies_in_a_capture(room: Path, tmp_path: Path) -> None:
    import shutil

    shutil.copytree(room, tmp_path / "scans" / "one" / "inner")
    (tmp_path / "scans" / "questions.jsonl").touch()
    job = load_build_job(write(tmp_path / "job.yaml", "{name: a, output: b, captures: 'scans/*/inner/../inner'}"))
    (planned,) = plan_captures(job)
    assert planned.capture == str(tmp_path / "scans" / "one" / "inner")


def test_pattern_that_ends_in_a_slash_asks_for_folders(room: Path, tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    (tmp_path / "scans" / "room").symlink_to(room)
    (tmp_path / "scans" / "questions.jsonl").touch()
    job = load_build_job(write(tmp_path / "job.yaml", "{name: a, output: b, captures: 'scans/*/'}"))
    (planned,) = plan_captures(job)
    assert planned.capture == str(tmp_path / "scans" / "room")


def test_one_capture_need_not_be_a_list(tmp_path: Path) -> None:
    job = load_build_job(write(tmp_path / "job.yaml", "{name: one, output: built, captures: kitchen}"))
    assert [entry.path for entry in job.captures] == [str(tmp_path / "kitchen")]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("{name: a, output: b, captures: []}", "captures: expected at least one capture"),
        ("{name: a, output: b, captures: c, build: {train: {stepps: 1}}}", "build.train: expected one of steps"),
        ("{name: a, output: 's3://bucket/run', captures: c}", "working must name a local folder"),
        ("{name: a, output: b, captures: [{path: c, kind: foo}]}", "captures.0.kind: expected 'auto', 'openeqa'"),
        ("{name: a, output: b}", "captures: expected a value (what is built), found nothing"),
    ],
)
def test_wrong_fields_are_told_with_file_and_place(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(InputError) as refused:
        load_build_job(write(tmp_path / "job.yaml", text))
    assert str(refused.value).startswith(str(tmp_path / "job.yaml"))
    assert told in str(refused.value)


def test_unit_is_made_of_all_that_shapes_its_scene_and_of_nothing_else(room: Path, tmp_path: Path) -> None:
    def unit(text: str) -> str:
        (planned,) = plan_captures(load_build_job(write(tmp_path / "job.yaml", text)))
        return planned.unit

    first = unit(f"{{name: a, output: b, captures: {room}}}")
    assert unit(f"{{name: other, output: c, captures: {room}, workers: {{threads: 3}}}}") == first
    others = [
        unit(f"{{name: a, output: b, captures: {{path: {room}, name: hall}}}}"),
        unit(f"{{name: a, output: b, captures: {room}, build: {{hold_out: 3}}}}"),
    ]
    assert len({first, *others}) == 3


def test_capture_is_another_with_a_changed_pose_or_another_file_but_not_elsewhere(room: Path, tmp_path: Path) -> None:
    import shutil

    copy = Path(shutil.copytree(room, tmp_path / "copy"))
    whole = capture_sha256(str(room))
    assert capture_sha256(str(copy)) == whole
    pose = copy / "frame-000000.pose.txt"
    text = pose.read_text()
    pose.write_text(text.replace("0", "1", 1))
    assert capture_sha256(str(copy)) != whole
    pose.write_text(text)
    assert capture_sha256(str(copy)) == whole
    photo = copy / "frame-000003.color.png"
    pixels = photo.read_bytes()
    photo.write_bytes(pixels[:-1] + bytes([pixels[-1] ^ 1]))
    assert capture_sha256(str(copy)) != whole, "of the same size, but another"
    photo.unlink()
    assert capture_sha256(str(copy)) != whole


def test_large_file_is_another_with_a_changed_start_or_end(tmp_path: Path) -> None:
    content = bytearray(3 * END_BYTES)
    (tmp_path / "a.png").write_bytes(content)
    found = [capture_sha256(str(tmp_path))]
    for place in (END_BYTES - 1, -END_BYTES):
        content[place] = 1
        (tmp_path / "a.png").write_bytes(content)
        found.append(capture_sha256(str(tmp_path)))
    assert len(set(found)) == 3


def test_unit_is_another_with_other_label_images(room: Path, tmp_path: Path) -> None:
    labels = tmp_path / "labels" / "room"
    labels.mkdir(parents=True)
    source = {"kind": "label_files", "folder": str(tmp_path / "labels" / "{scene}")}
    fields = {"name": "a", "output": "b", "captures": [str(room)], "build": {"semantics": {"source": source}}}
    found = []
    for pixel in (b"1", b"2", b"1"):
        (labels / "frame-000000.label.png").write_bytes(pixel)
        (planned,) = plan_captures(BuildJob.model_validate(fields))
        found.append((planned.unit, planned.capture_sha256))
    assert found[0] == found[2]
    assert found[0][0] != found[1][0]
    assert found[0][1] != found[1][1]


def test_driver_of_a_build_does_not_import_what_its_workers_need() -> None:
    code = "import sys, jobs.builds.build_captures, jobs.verbs.build; print(*sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert not {"numba", "torch", "ray", "scipy", "cv2"} & set(out.split())


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--output", "x"], "expected one of --capture, --job, --scannet-mesh, --procedural, found none"),
        (["--output", "x", "--capture", "a", "--procedural", "1"], "found --capture and --procedural"),
        (["--capture", "a"], "--output: expected a folder"),
        (["--capture", "a", "--capture", "b", "--name", "c", "--output", "x"], "--name: expected one capture"),
        (["--capture", "a", "--output", "x", "--semantics", "cat"], "expected one of label_files"),
        (["--job", "a.yaml", "--kind", "sens"], "found --kind or --name"),
        (["--job", "a.yaml", "--name", "hall"], "found --kind or --name"),
    ],
)
def test_options_that_make_no_build_are_refused(options: list[str], told: str) -> None:
    result = CliRunner().invoke(app, ["build", *options])
    assert isinstance(result.exception, InputError)
    assert told in str(result.exception)


def test_command_line_builds_a_capture_and_the_other_verbs_tell_of_it(
    room: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(room.parent)
    options = ["--capture", room.name, "--steps", "0", "--hold-out", "0", "--plain", "--cpus", "1"]
    output = os.path.relpath(tmp_path / "built", room.parent)
    built = CliRunner().invoke(app, ["build", *options, "--output", output], catch_exceptions=False)
    assert built.exit_code == 0
    assert "1 of 1 captures committed" in built.stdout
    assert f"{tmp_path / 'built' / 'scenes' / 'room'}: " in built.stdout
    assert "4 frames fitted" in built.stdout
    told = CliRunner().invoke(app, ["status", str(tmp_path / "built")], catch_exceptions=False).stdout
    assert "captures: 1 of 1 committed" in told
    assert "questions" not in told
    assert CliRunner().invoke(app, ["verify", str(tmp_path / "built")], catch_exceptions=False).exit_code == 0
    checked = CliRunner().invoke(app, ["check", str(tmp_path / "built" / "scenes" / "room")], catch_exceptions=False)
    assert f"built from: {room}, 4 frames fitted, 0 steps" in checked.stdout
    again = CliRunner().invoke(app, ["resume", str(tmp_path / "built"), "--plain"], catch_exceptions=False)
    assert "1 of 1 captures committed" in again.stdout


@pytest.mark.parametrize(
    ("options", "steps"), [(["--minutes", "5"], 30_000), (["--minutes", "5", "--steps", "70"], 70), ([], None)]
)
def test_minutes_alone_end_the_optimisation(
    room: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: list[str], steps: int | None
) -> None:
    asked: list[BuildJob] = []

    def refuse(job: BuildJob, **others: object) -> None:
        asked.append(job)
        raise StopError("enough")

    monkeypatch.setattr("jobs.builds.build_captures.submit_build", refuse)
    others = ["--start", "depth", "--no-depth-loss"]
    CliRunner().invoke(app, ["build", "--capture", str(room), "--output", str(tmp_path), *options, *others])
    (job,) = asked
    assert (job.build.start, job.build.train.depth_first) == ("depth", 0.0)
    assert job.build.train.steps == (TrainConfig().steps if steps is None else steps)
    assert job.build.train.minutes == (5.0 if options else None)


def test_resume_of_a_run_with_a_failed_capture_exits_1_and_says_what_to_do(
    room: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(MARKS, str(tmp_path))
    text = f"{{name: a, output: built, captures: [{{path: {room}, name: wrong}}], workers: {{in_process: true}}}}"
    submit_build(load_build_job(write(tmp_path / "job.yaml", text)), build=fake_build)
    result = CliRunner().invoke(app, ["resume", str(tmp_path / "built"), "--plain"])
    assert result.exit_code == 1
    assert f"{room}: InputError: {room}: depth: expected depth, found none" in result.stdout
    assert "splatreasoner retry" in result.stdout
