"""The faults of `make chaos`: what is done to a whole run, the tests that do it, and what is promised."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that befalls a run."""

    name: str
    """As in the marker `chaos` of its tests."""
    promise: str
    """What holds afterwards; the rows are those of a run that nothing befell unless it says otherwise."""
    tests: tuple[str, ...]
    """Files, below tests/, and functions."""


CRASH, KILLS = "jobs/test_crash.py::test_", "jobs/test_kills.py::test_"
PROCESSES, SIMULATED = "jobs/chaos/test_processes.py::test_", "jobs/chaos/test_simulated_driver.py::test_"
SERVERS, DATA = "jobs/chaos/test_servers.py::test_", "jobs/chaos/test_data.py::test_"
A_WHILE = f"{SERVERS}run_with_a_server_that_fails_for_a_while_ends_with_the_rows_of_a_good_day"
GOES_ON = "goes on by itself; what was answered is not sent again"

FAULTS = (
    Fault(
        "worker kill -9",
        "its questions are tried again elsewhere; exit 0",
        (f"{PROCESSES}workers_killed_again_and_again_cost_tries_and_no_row",),
    ),
    Fault(
        "driver kill -9",
        "at every write point, also by a power cut: what a reader saw stays, nothing is damaged, `resume` finishes",
        (
            f"{SIMULATED}driver_killed_at_any_touches_of_the_disk_loses_doubles_and_mixes_nothing",
            f"{SIMULATED}driver_killed_at_every_touch_of_the_disk_loses_doubles_and_mixes_nothing",
            f"{CRASH}killed_driver_resumes_to_the_same_bytes",
        ),
    ),
    Fault(
        "node loss",
        "its questions are tried again elsewhere; exit 0",
        ("jobs/test_cluster.py::test_run_whose_node_dies_ends_with_the_rows_of_an_undisturbed_one",),
    ),
    Fault(
        "GCS loss",
        "killed or stuck: exit 1 within 90 s, `resume` finishes",
        (f"{CRASH}driver_whose_ray_loses_its_head_ends_in_time_and_can_be_resumed",),
    ),
    Fault(
        "driver's raylet killed",
        "Ray ends the driver's process without a word, exit 1; `resume` finishes",
        (f"{PROCESSES}driver_whose_own_raylet_is_killed_ends_and_can_be_resumed",),
    ),
    Fault(
        "repeated OOM",
        "the question that takes the memory is a failed row, all others are answered; exit 0",
        (f"{PROCESSES}question_that_runs_out_of_memory_each_time_becomes_a_failed_row_and_takes_no_other_down",),
    ),
    Fault(
        "limiter killed",
        "started again from its journal: same limits, no call lost or sent twice; exit 0",
        (
            f"{KILLS}a_killed_limiter_and_a_killed_actor_lose_no_answer",
            f"{KILLS}a_limiter_killed_at_any_point_costs_no_call",
        ),
    ),
    Fault("429 storm", GOES_ON, (A_WHILE,)),
    Fault(
        "Retry-After 1 h",
        "no call before the hour is over, not in later sessions either; questions that cannot wait are failed rows; "
        "`retry` and `resume` finish",
        (f"{SERVERS}server_that_asks_for_an_hour_gets_an_hour_also_from_later_sessions",),
    ),
    Fault("5xx burst", GOES_ON, (A_WHILE,)),
    Fault("hung connection", "ends at the read timeout, then as above", (A_WHILE,)),
    Fault("malformed output", "no completion: sent again; unreadable text: asked again, told the form", (A_WHILE,)),
    Fault(
        "bad key",
        "exit 1 at once, nothing charged, the key is in no file; `resume` finishes",
        (f"{SERVERS}refused_key_stops_the_run_and_is_nowhere_on_disk",),
    ),
    Fault(
        "damaged Parquet",
        "bits flipped, files cut, emptied or gone: `verify` names them, `resume` does their units again",
        (f"{DATA}damaged_files_of_a_run_are_found_and_their_units_done_again",),
    ),
    Fault(
        "full disk",
        "exit 1, what was committed stays; with room `resume` finishes",
        (f"{CRASH}full_disk_stops_the_run_and_costs_nothing_that_was_committed",),
    ),
    Fault(
        "corrupt PLY",
        "that scene's questions are failed rows that name the file, all others are answered; exit 0",
        (f"{DATA}scene_with_a_corrupt_ply_is_failed_rows_and_the_others_are_answered",),
    ),
    Fault(
        "NaN poses",
        "views without a pose are left out, as the plan says; a scene without any is refused at plan, exit 2",
        (f"{DATA}views_without_a_pose_are_left_out_and_a_scene_without_any_is_refused",),
    ),
    Fault(
        "duplicate ids",
        "refused at plan, exit 2, nothing written",
        (f"{DATA}repeated_question_id_is_refused_before_anything_is_written",),
    ),
    Fault(
        "clock jump",
        "an hour ahead or back, in a session and between two: nobody waits for it, no deadline fires",
        ("jobs/chaos/test_clock.py::test_clock_that_jumps_in_a_session_and_between_two_changes_nothing",),
    ),
    Fault(
        "two drivers",
        "the second is refused; one that slept while another took over is fenced out, exit 1, nothing of it counts",
        (f"{CRASH}driver_that_slept_while_another_finished_its_run_is_fenced_out",),
    ),
    Fault(
        "changed config",
        "refused with the difference, exit 2; another folder takes it and the first run goes on as it was",
        (f"{DATA}other_config_in_a_run_that_has_begun_is_refused_with_the_difference",),
    ),
    Fault(
        "SIGTERM",
        "what is whole is committed, exit 130; `resume` finishes (Ctrl-C likewise)",
        (f"{CRASH}signal_commits_what_is_done_and_exits_130",),
    ),
    Fault(
        "budget reached",
        "exit 1 at the cap, never above it; with a higher one `resume` finishes and pays for nothing twice",
        ("jobs/test_budget.py::test_a_cap_ends_the_run_and_a_higher_one_finishes_it",),
    ),
    Fault(
        "S3 away",
        "asked again for half a minute; uploads whose answer was lost count once; exit 0",
        ("jobs/test_s3_run.py::test_run_outlives_a_store_that_is_away_and_a_second_driver_finds_it_taken",),
    ),
    Fault(
        "stored reply damaged",
        "asked again, and only that one; exit 0",
        (f"{SERVERS}damaged_stored_replies_are_asked_again_and_no_others",),
    ),
    Fault(
        "folder removed",
        "driver/, visibility/, calls/, manifests/ or the diary: work is done again, no row is lost",
        (f"{DATA}folder_removed_from_a_run_costs_work_and_no_row",),
    ),
)
