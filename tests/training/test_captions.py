"""Words: captions say what is true of an asset, and the tokens of a sentence do not depend on what is read with it."""

import numpy as np
import pytest
import torch
from PIL import Image

from dipcg import registry
from dipcg.cli import main
from dipcg.data.shapes import Shapes
from dipcg.generators import load_generator
from dipcg.model.zoo import CheckpointError, find_checkpoint, shipped
from dipcg.pipeline import Inverter
from dipcg.space import Choice
from dipcg.training.captions import FOLDER, MOST, caption, load_words, reworded, says

DESCRIBED = sorted(path.stem for path in FOLDER.glob("[a-z]*.toml"))


@pytest.mark.parametrize("name", registry.names("generators"))
def test_words_belong_to_parameters_and_their_options(name):
    generator = load_generator(name)
    nouns, phrases = load_words(generator)
    assert nouns
    for parameter, by_value in phrases.items():
        declared = generator.space[parameter]
        options = set(map(str, declared.options)) if isinstance(declared, Choice) else {"low", "high"}
        assert set(by_value) <= options
        assert all(said and not said[0].isupper() for phrase in by_value.values() for said in phrase)


@pytest.mark.parametrize("name", registry.names("generators"))
def test_no_phrase_stands_for_two_values_of_a_parameter(name):
    for by_value in load_words(load_generator(name))[1].values():
        said = [phrase for phrases in by_value.values() for phrase in phrases]
        assert len(said) == len(set(said))


@pytest.mark.parametrize("name", DESCRIBED)
def test_a_caption_says_only_what_is_true(name, monkeypatch):
    monkeypatch.setattr("dipcg.training.captions.reworded", lambda generator, phrase, rng: phrase)
    generator, rng = load_generator(name), np.random.default_rng(0)
    _, phrases = load_words(generator)
    for _ in range(50):
        params = generator.space.sample(rng)
        words = caption(generator, params, rng)
        for parameter in generator.space:
            told = says(parameter, params[parameter.name])
            active = generator.space.is_active(parameter.name, params)
            others = [v for v in phrases.get(parameter.name, {}) if v != told or not active]
            wrong = {phrase for value in others for phrase in phrases[parameter.name][value]}
            assert not wrong & set(_pieces(words, phrases)), words


def _pieces(words: str, phrases) -> list[str]:
    """The phrases that a caption is made of: the longest that fit, since one may be the beginning of another."""
    known = sorted({p for by_value in phrases.values() for many in by_value.values() for p in many}, key=len)
    found = []
    for phrase in reversed(known):
        if f" {phrase} " in f" {words.replace(',', ' ,')} ".replace(" ,", " "):
            found.append(phrase)
            words = words.replace(phrase, "|")
    return found


@pytest.mark.parametrize("name", DESCRIBED)
def test_a_phrase_in_other_words_never_becomes_the_phrase_for_something_else(name):
    generator, rng = load_generator(name), np.random.default_rng(0)
    every = [phrase for by_value in load_words(generator)[1].values() for many in by_value.values() for phrase in many]
    said = [(phrase, reworded(generator, phrase, rng)) for phrase in every]
    other = {new for phrase, new in said if new != phrase}
    assert len(other) > len(every) / 10
    assert not other & set(every)


def test_words_are_put_in_others_where_the_thesaurus_has_some_and_articles_follow(monkeypatch):
    monkeypatch.setattr("dipcg.training.captions.REWORDED", 1)
    monkeypatch.setattr("dipcg.training.captions._load_thesaurus", lambda: ({"thick": ["ample"]}, {"with": ["having"]}))
    table, rng = load_generator("table"), np.random.default_rng(0)
    assert (
        reworded(table, "with a thick, thick-edged top with feet", rng) == "having an ample, ample-edged top with feet"
    )
    assert reworded(table, "as round as a pebble", rng) == "as round as a pebble"
    assert reworded(table, "'thick' in every way", rng) == "'ample' in every way"


def test_captions_of_one_asset_differ_and_the_same_seed_gives_the_same():
    chair = load_generator("chair")
    params = chair.space.sample(np.random.default_rng(0))
    said = {caption(chair, params, np.random.default_rng(seed)) for seed in range(20)}
    assert len(said) > 15
    assert caption(chair, params, np.random.default_rng(3)) == caption(chair, params, np.random.default_rng(3))


def test_tokens_do_not_depend_on_the_other_sentences_and_are_zero_after_the_end():
    sentence = pytest.importorskip("dipcg.encoders.sentence")
    alone = sentence.embed(["a tall chair"])
    beside = sentence.embed(["a tall chair", "a chair with a ladder back and arms that are thick and low"])
    torch.testing.assert_close(beside[:1], alone, atol=1e-4, rtol=1e-3)
    length = sentence.count_tokens("a tall chair")
    assert (alone[0, length:] == 0).all()
    assert alone[0, :length].abs().sum(1).min() > 1
    assert sentence.embed(["chair " * 500]).shape == (1, sentence.LENGTH, sentence.CHANNELS)


# What training sees


def test_phrases_read_alone_are_put_one_after_the_other():
    pytest.importorskip("transformers")
    from dipcg.training.sentences import Phrases

    read = Phrases()
    both, one = read([["a chair", "with arms"], ["with arms"]])
    length = int((one.abs().sum(1) > 0).sum())
    before = int((both.abs().sum(1) > 0).sum()) - length
    assert length == 2, "without the marks of a sentence's ends"
    torch.testing.assert_close(both[before : before + length], one[:length])
    assert (both[before + length :] == 0).all()
    assert read([["a chair"] * 100]).shape == read([["a chair"]]).shape, "what is too long is cut"


@pytest.mark.parametrize("batch", [1, 8])
def test_a_batch_of_sentences_asks_for_what_is_said_of_shapes_that_are_there(batch):
    pytest.importorskip("transformers")
    from dipcg.encoders.sentence import CHANNELS, LENGTH
    from dipcg.training.sentences import UNSAID, Sentences

    chair, rng = load_generator("chair"), np.random.default_rng(0)
    many = [chair.space.sample(rng) for _ in range(5)]
    x, active = (np.stack([of(params) for params in many]) for of in (chair.space.encode, chair.space.active))
    told = Sentences(chair, Shapes([b""] * 5, x.astype(np.float32), active), batch).batch(0)
    assert told.images.shape == (batch, LENGTH, CHANNELS)
    for row, wanted in zip(told.x[:, : len(chair.space)].numpy(), told.active.numpy(), strict=True):
        shape = int(np.abs(x - row).sum(1).argmin())
        np.testing.assert_allclose(row, x[shape], atol=1e-6)
        assert not (wanted & ~active[shape]).any(), "nobody asks for what does nothing"
        assert wanted.sum() <= MOST + 5 * UNSAID * active[shape].sum()


# The checkpoints that ship


def test_every_generator_that_ships_reads_words_too():
    assert [find_checkpoint(name, "text").name for name in shipped()] == shipped()
    with pytest.raises(CheckpointError, match="no checkpoint that reads words for 'box'"):
        find_checkpoint("box", "text")


@pytest.mark.parametrize(
    ("generator", "one", "other", "parameter"),
    [
        ("chair", "a chair with two armrests", "a chair without any armrests", "has_arm"),
        ("table", "a round dining table", "a rectangular dining table", "ngon"),
        ("dandelion", "a bald dandelion, all its seeds are gone", "a full fluffy dandelion clock", "flower_mode"),
    ],
)
def test_opposite_sentences_give_opposite_options(generator, one, other, parameter):
    pytest.importorskip("transformers")
    with Inverter.load(str(find_checkpoint(generator, "text"))) as inverter:
        first, second = (inverter.describe(text, candidates=1).params[parameter] for text in (one, other))
    assert first != second
    options = {"has_arm": (True, False), "ngon": (36, 4), "flower_mode": ("no_flower", "full_flower")}
    assert (first, second) == options[parameter]


def test_a_sentence_becomes_an_asset_with_its_picture(tmp_path, capsys):
    pytest.importorskip("transformers")
    words = ["--text", "a daisy with broad petals", "-g", "flower", "-o", str(tmp_path / "a.glb")]
    main(["estimate", *words, "--light", "--preview", str(tmp_path / "a.png")])
    assert (tmp_path / "a.glb").stat().st_size > 1000
    width, height = Image.open(tmp_path / "a.png").size
    assert width == 2 * height, "two sides of it, and no photo"
    assert "Loading" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("sentence", "name"),
    [
        ("a tall bar chair with arms and a slatted back", "chair"),
        ("something to sit on, with four straight legs and no armrests", "chair"),
        ("a round dining table with a single foot", "table"),
        ("an urn with a narrow neck and a wide belly", "vase"),
        ("a wicker basket with two handles", "basket"),
        ("a daisy with many thin petals", "flower"),
        ("a dandelion clock whose seeds are half blown away", "dandelion"),
    ],
)
def test_the_generator_is_recognised_in_the_sentence(sentence, name):
    pytest.importorskip("transformers")
    from dipcg.inference.recognise_text import recognise_text

    probabilities = recognise_text(sentence)
    assert next(iter(probabilities)) == name
    assert sum(probabilities.values()) == pytest.approx(1)
    two = recognise_text(sentence, ["vase", "basket"])
    assert two.keys() == {"vase", "basket"}
    assert sum(two.values()) == pytest.approx(1)


def test_the_classifier_of_sentences_that_ships_knows_all_that_ship():
    from dipcg.inference.classifier import read_classifier
    from dipcg.inference.recognise_text import ENCODER, FILE

    classifier = read_classifier(FILE)
    assert (sorted(classifier.names), classifier.encoder) == (shipped(), ENCODER)


def test_a_classifier_of_captions_is_right_about_others():
    pytest.importorskip("transformers")
    from dipcg.inference.recognise_text import summaries
    from dipcg.training.fit_text import captions, fit

    classifier = fit(["flower", "box"], 60)
    unseen = captions(load_generator("flower"), 20, np.random.default_rng(9))
    likeliest = [next(iter(classifier.probabilities(summaries([text])))) for text in unseen]
    assert np.mean([name == "flower" for name in likeliest]) > 0.9


def test_a_generator_that_words_cannot_tell_apart_has_to_be_named():
    pytest.importorskip("transformers")
    from dipcg.inference.recognise_text import recognise_text

    with pytest.raises(ValueError, match="Say which generator is meant"):
        recognise_text("a lamp", ["lamp"])
