"""What people read for parameters: human names, different within a part, and options with a label each."""

import pytest

from dipcg.generators import load_generator
from dipcg.labels import label, labelled, option_labels
from dipcg.space import Choice, ParameterSpace, Real

SHIPPED = ("box", "chair", "table", "vase", "basket", "flower", "dandelion")
# Words of programmers, and signs of numbered names.
CRYPTIC = {"ngon", "subsurf", "mid", "ctrl", "pts", "locs", "ncuts", "pct", "rad", "sub", "level", "x", "y", "z"}


@pytest.mark.parametrize("name", SHIPPED)
def test_labels_of_shipped_generators_are_words_that_tell_the_parameters_of_a_part_apart(name: str) -> None:
    space = load_generator(name).space
    shown = [(p.group, label(p)) for p in space]
    assert len(set(shown)) == len(shown)
    for _, words in shown:
        assert not set(words.split()) & CRYPTIC, words
        assert "_" not in words


@pytest.mark.parametrize("name", SHIPPED)
def test_every_option_has_its_own_label(name: str) -> None:
    for choice in load_generator(name).space:
        if isinstance(choice, Choice):
            assert len(set(option_labels(choice))) == len(choice.options), choice.name


def test_labels_change_no_print_of_a_space_and_refuse_unknown_names() -> None:
    space = ParameterSpace(Real("leg_ngon", 0, 1), Real("leg_w", 0, 1))
    named = labelled(space, {"leg_ngon": "corners"})
    assert [label(p) for p in named] == ["corners", "leg w"]
    assert named.fingerprint == space.fingerprint
    with pytest.raises(ValueError, match="no parameter 'leg'"):
        labelled(space, {"leg": "legs"})
