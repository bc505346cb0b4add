"""The markers of slow tests and of those with Blender, which are declared here and nowhere else."""

from pathlib import Path

TESTS = Path(__file__).parent
# Markers of files, and of tests whose names begin so. `make fast` leaves all of them out.
MARKED = {
    "slow": {
        "data/test_cluster.py",
        "evaluation/test_evaluate.py",
        "importing/test_openscad.py::test_an_openscad_file_goes",
        "importing/test_seeded.py",
        "inference/test_classifier.py",
        "security/test_builds.py",
        "security/test_pictures.py",
        "security/test_traces.py",
        "test_end_to_end.py",
        "test_extending.py",
        "training/test_distributed.py",
        "training/test_recipes.py",
        "training/test_snapshots.py",
        "training/test_train.py",
    },
    "blender": {"training/test_captions.py::test_a_sentence_becomes_an_asset"},
}
