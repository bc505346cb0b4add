"""The markers of slow tests and of those with Blender, which are declared here and nowhere else."""

from pathlib import Path

TESTS = Path(__file__).parent
# Markers of files, and of tests whose names begin so. `make fast` leaves all of them out.
MARKED = {
    "slow": {
        "app/test_api.py::test_words_become",
        "app/test_browser_training.py::test_a_generator",
        "app/test_newer_blender.py::test_a_newer_file",
        "app/test_trainings.py",
        "cli/test_assets.py::test_a_folder_is_worked_through",
        "cli/test_batch.py::test_a_name_that_is_no_utf8",
        "data/test_cluster.py",
        "evaluation/test_evaluate.py",
        "importing/test_openscad.py::test_an_openscad_file_goes",
        "importing/test_seeded.py",
        "inference/test_classifier.py",
        "security/test_builds.py",
        "security/test_pictures.py",
        "security/test_traces.py",
        "test_benchmarks.py::test_a_finished_training",
        "test_end_to_end.py",
        "test_extending.py",
        "training/test_captions.py::test_a_classifier_fitted_on_captions",
        "training/test_distributed.py",
        "training/test_recipes.py",
        "training/test_snapshots.py",
        "training/test_train.py",
    },
    "blender": {"training/test_captions.py::test_a_sentence_becomes_an_asset"},
}
