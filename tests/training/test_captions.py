"""Sentences: captions are true, tokens do not depend on the batch, and estimates and recognition follow the text."""

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
from dipcg.training.captions import FOLDER, MAX_PHRASES, caption, load_words, paraphrase, value_label

pytestmark = pytest.mark.slow

DESCRIBED = sorted(path.stem for path in FOLDER.glob("[a-z]*.toml"))


@pytest.mark.parametrize("name", registry.names("generators"))
def test_phrases_have_the_names_of_parameters_and_the_labels_of_their_values(name):
    generator = load_generator(name)
    nouns, phrases = load_words(generator)
    assert nouns
    for name, by_label in phrases.items():
        parameter = generator.space[name]
        labels = set(map(str, parameter.options)) if isinstance(parameter, Choice) else {"low", "high"}
        assert set(by_label) <= labels
        assert all(phrase and not phrase[0].isupper() for many in by_label.values() for phrase in many)


@pytest.mark.parametrize("name", registry.names("generators"))
def test_no_phrase_describes_two_values_of_a_parameter(name):
    for by_label in load_words(load_generator(name))[1].values():
        phrases = [phrase for many in by_label.values() for phrase in many]
        assert len(phrases) == len(set(phrases))


@pytest.mark.parametrize("name", DESCRIBED)
def test_a_caption_has_only_phrases_that_are_true(name, monkeypatch):
    monkeypatch.setattr("dipcg.training.captions.paraphrase", lambda generator, phrase, rng: phrase)
    generator, rng = load_generator(name), np.random.default_rng(0)
    _, phrases = load_words(generator)
    for _ in range(50):
        params = generator.space.sample(rng)
        sentence = caption(generator, params, rng)
        for parameter in generator.space:
            label = value_label(parameter, params[parameter.name])
            active = generator.space.is_active(parameter.name, params)
            others = [other for other in phrases.get(parameter.name, {}) if other != label or not active]
            wrong = {phrase for other in others for phrase in phrases[parameter.name][other]}
            assert not wrong & set(phrases_in(sentence, phrases)), sentence


def phrases_in(sentence: str, phrases) -> list[str]:
    """The phrases in a caption, the longest first, because a phrase may be the beginning of another."""
    by_length = sorted({p for by_label in phrases.values() for many in by_label.values() for p in many}, key=len)
    contained = []
    for phrase in reversed(by_length):
        if f" {phrase} " in f" {sentence.replace(',', ' ,')} ".replace(" ,", " "):
            contained.append(phrase)
            sentence = sentence.replace(phrase, "|")
    return contained


@pytest.mark.parametrize("name", DESCRIBED)
def test_a_paraphrase_is_never_another_phrase_of_the_generator(name):
    generator, rng = load_generator(name), np.random.default_rng(0)
    phrases = [
        phrase for by_label in load_words(generator)[1].values() for many in by_label.values() for phrase in many
    ]
    pairs = [(phrase, paraphrase(generator, phrase, rng)) for phrase in phrases]
    changed = {new for phrase, new in pairs if new != phrase}
    assert len(changed) > len(phrases) / 10
    assert not changed & set(phrases)


def test_synonyms_replace_words_and_articles_fit_them(monkeypatch):
    monkeypatch.setattr("dipcg.training.captions.SYNONYM_PROBABILITY", 1)
    monkeypatch.setattr("dipcg.training.captions._load_thesaurus", lambda: ({"thick": ["ample"]}, {"with": ["having"]}))
    table, rng = load_generator("table"), np.random.default_rng(0)
    expected = "having an ample, ample-edged top with feet"
    assert paraphrase(table, "with a thick, thick-edged top with feet", rng) == expected
    assert paraphrase(table, "as round as a pebble", rng) == "as round as a pebble"
    assert paraphrase(table, "'thick' in every way", rng) == "'ample' in every way"


def test_captions_of_one_asset_differ_and_the_same_seed_gives_the_same():
    chair = load_generator("chair")
    params = chair.space.sample(np.random.default_rng(0))
    captions = {caption(chair, params, np.random.default_rng(seed)) for seed in range(20)}
    assert len(captions) > 15
    assert caption(chair, params, np.random.default_rng(3)) == caption(chair, params, np.random.default_rng(3))


def test_tokens_do_not_depend_on_the_batch_and_are_padded_with_zeros():
    sentence = pytest.importorskip("dipcg.encoders.sentence")
    alone = sentence.embed(["a tall chair"])
    beside = sentence.embed(["a tall chair", "a chair with a ladder back and arms that are thick and low"])
    torch.testing.assert_close(beside[:1], alone, atol=1e-4, rtol=1e-3)
    length = sentence.count_tokens("a tall chair")
    assert (alone[0, length:] == 0).all()
    assert alone[0, :length].abs().sum(1).min() > 1
    assert sentence.embed(["chair " * 500]).shape == (1, sentence.LENGTH, sentence.CHANNELS)


# Batches of training


def test_the_tokens_of_phrases_are_concatenated():
    pytest.importorskip("transformers")
    from dipcg.training.sentences import PhraseEncoder

    encode = PhraseEncoder()
    both, one = encode([["a chair", "with arms"], ["with arms"]])
    length = int((one.abs().sum(1) > 0).sum())
    before = int((both.abs().sum(1) > 0).sum()) - length
    assert length == 2, "a phrase has no start and no end token"
    torch.testing.assert_close(both[before : before + length], one[:length])
    assert (both[before + length :] == 0).all()
    assert encode([["a chair"] * 100]).shape == encode([["a chair"]]).shape, "tokens are truncated"


@pytest.mark.parametrize("batch", [1, 8])
def test_a_batch_of_sentences_counts_described_parameters_of_the_given_shapes(batch):
    pytest.importorskip("transformers")
    from dipcg.encoders.sentence import CHANNELS, LENGTH
    from dipcg.training.sentences import UNDESCRIBED_PROBABILITY, Sentences

    chair, rng = load_generator("chair"), np.random.default_rng(0)
    many = [chair.space.sample(rng) for _ in range(5)]
    x, active = (np.stack([of(params) for params in many]) for of in (chair.space.encode, chair.space.active))
    sentences = Sentences(chair, Shapes([b""] * 5, x.astype(np.float32), active), batch).batch(0)
    assert sentences.images.shape == (batch, LENGTH, CHANNELS)
    for row, counted in zip(sentences.x[:, : len(chair.space)].numpy(), sentences.active.numpy(), strict=True):
        shape = int(np.abs(x - row).sum(1).argmin())
        np.testing.assert_allclose(row, x[shape], atol=1e-6)
        assert not (counted & ~active[shape]).any(), "inactive parameters do not count"
        assert counted.sum() <= MAX_PHRASES + 5 * UNDESCRIBED_PROBABILITY * active[shape].sum()


# The checkpoints that ship


def test_every_shipped_generator_has_a_checkpoint_for_sentences():
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


def test_a_sentence_becomes_an_asset_with_a_preview(tmp_path, capsys):
    pytest.importorskip("transformers")
    words = ["--text", "a daisy with broad petals", "-g", "flower", "-o", str(tmp_path / "a.glb")]
    main(["estimate", *words, "--light", "--preview", str(tmp_path / "a.png")])
    assert (tmp_path / "a.glb").stat().st_size > 1000
    width, height = Image.open(tmp_path / "a.png").size
    assert width == 2 * height, "the preview shows two sides and no photo"
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
def test_the_generator_of_a_sentence_is_recognised(sentence, name):
    pytest.importorskip("transformers")
    from dipcg.inference.recognise_text import recognise_text

    probabilities = recognise_text(sentence)
    assert next(iter(probabilities)) == name
    assert sum(probabilities.values()) == pytest.approx(1)
    two = recognise_text(sentence, ["vase", "basket"])
    assert two.keys() == {"vase", "basket"}
    assert sum(two.values()) == pytest.approx(1)


def test_the_shipped_classifier_of_sentences_covers_all_shipped_generators():
    from dipcg.inference.classifier import read_classifier
    from dipcg.inference.recognise_text import ENCODER, FILE

    classifier = read_classifier(FILE)
    assert (sorted(classifier.names), classifier.encoder) == (shipped(), ENCODER)


def test_a_classifier_fitted_on_captions_recognises_unseen_captions():
    pytest.importorskip("transformers")
    from dipcg.inference.recognise_text import summaries
    from dipcg.training.fit_text import captions, fit

    classifier = fit(["flower", "box"], 60)
    unseen = captions(load_generator("flower"), 20, np.random.default_rng(9))
    likeliest = [next(iter(classifier.probabilities(summaries([text])))) for text in unseen]
    assert np.mean([name == "flower" for name in likeliest]) > 0.9


def test_a_sentence_for_a_generator_without_a_class_is_refused():
    pytest.importorskip("transformers")
    from dipcg.inference.recognise_text import recognise_text

    with pytest.raises(ValueError, match="Say which generator is meant"):
        recognise_text("a lamp", ["lamp"])
