from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from jobs.config import JobConfig, load_job
from schemas.errors import InputError

GOOD = "name: test\noutput: run\nscenes: scenes/*\n"


def write(folder: Path, text: str) -> Path:
    path = folder / "job.yaml"
    path.write_text(text)
    return path


def test_smallest_job_has_the_documented_defaults(tmp_path: Path) -> None:
    job = load_job(write(tmp_path, GOOD))
    assert job.scenes == (str(tmp_path / "scenes/*"),)
    assert job.output == str(tmp_path / "run")
    assert job.questions == "scene"
    assert job.calls_folder() == str(tmp_path / "run" / "calls")
    assert job.models.default == "symbolic"


def test_paths_are_relative_to_the_job_file_and_uris_stay(tmp_path: Path) -> None:
    text = "name: t\noutput: s3://bucket/run\nscenes: [a, /b, s3://c/d]\nquestions: q.jsonl\ncalls: ../calls\n"
    folder = tmp_path / "jobs"
    folder.mkdir()
    job = load_job(write(folder, text))
    assert job.output == "s3://bucket/run"
    assert job.scenes == (str(folder / "a"), "/b", "s3://c/d")
    assert job.questions == str(folder / "q.jsonl")
    assert Path(job.calls_folder()).resolve() == tmp_path / "calls"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "job.yaml: expected fields, one `name: value` a line, found an empty file"),
        ("- a\n", "job.yaml: expected fields, one `name: value` a line, found a list"),
        ("name: [\n", "job.yaml: expected YAML, found "),
        ("name: a\nname: b\n", "job.yaml: expected YAML, found the key 'name' a second time at line 2"),
        ("name: !!python/object/apply:os.system [ls]\n", "job.yaml: expected YAML, found could not determine"),
        ("name: t\noutput: r\n", "job.yaml: dataset: expected scenes or a dataset to be given, found None"),
        (GOOD + "scene: x\n", "job.yaml: top level: expected one of name, output, scenes, .*, found scene"),
        (GOOD + "workers: {cpu: 2}\n", "job.yaml: workers: expected one of cpus, address, .*, found cpu"),
        (GOOD + "workers: {cpus: two}\n", "job.yaml: workers.cpus: expected a valid integer.*, found 'two'"),
        (GOOD + "workers: {chunk: 0}\n", "job.yaml: workers.chunk: expected greater than or equal to 1, found 0"),
        (GOOD + "tasks: [eqa, vqa]\n", "job.yaml: tasks.1: expected 'eqa', 'ground_one' or 'ground_many', found 'vqa'"),
        (GOOD + "method: {novel_views: {cuont: 8}}\n", "method.novel_views: expected one of .*count.*, found cuont"),
        (GOOD + "models: {default: gpt}\n", "job.yaml: models.default: expected an endpoint: symbolic, found 'gpt'"),
        (
            "name: t\noutput: s3://b/run\nscenes: x\n",
            "calls: expected a local folder, since the output is not local, found nothing",
        ),
    ],
)
def test_wrong_job_file_is_refused_in_one_line_that_says_where(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        load_job(write(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_every_wrong_field_is_named_not_only_the_first(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        load_job(write(tmp_path, GOOD + "limit: 0\nimages: maybe\nworkers: {retries: -1}\n"))
    told = [str(caught.value), *caught.value.__notes__]
    assert [line.split(": ")[1] for line in told] == ["limit", "images", "workers.retries"]


def test_missing_job_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none.yaml: expected a file that can be read, found nothing there"):
        load_job(tmp_path / "none.yaml")


def undescribed(model: type[BaseModel], place: str) -> list[str]:
    found = []
    for name, field in model.model_fields.items():
        if not field.description:
            found.append(f"{place}{name}")
        kind: Any = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            found += undescribed(kind, f"{place}{name}.")
    return found


def test_every_field_of_a_job_file_is_described() -> None:
    assert undescribed(JobConfig, "") == []
