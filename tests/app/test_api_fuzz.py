"""Anything at all is sent to the app's actions: an answer comes, or a sentence."""

import io
import os
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from boxes import BOX, TRUTH
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from dipcg.app import actions as app_actions
from dipcg.export.asset import FORMATS
from dipcg.space import params_from_json

T = TypeVar("T")
CASES = int(os.environ.get("DIPCG_FUZZ_CASES", "150"))  # of each test

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inside: st.lists(inside, max_size=3) | st.dictionaries(st.text(max_size=8), inside, max_size=3),
    max_leaves=6,
)
NEARLY_PARAMS = st.fixed_dictionaries({}, optional={name: JSON | st.just(TRUTH[name]) for name in BOX.names})


@st.composite
def pictures(draw) -> bytes:
    """Real picture files, some of them damaged, and bytes that are none."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.binary(max_size=200))
    height, width = draw(st.integers(1, 90)), draw(st.integers(1, 90))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    pixels = np.full((height, width, 4), rng.integers(0, 256, 4), np.uint8)
    pixels[height // 4 : -height // 4, width // 4 : -width // 4] = rng.integers(0, 256, 4)
    pixels[rng.random((height, width)) < draw(st.sampled_from([0, 0.02, 0.5]))] = rng.integers(0, 256, 4)
    mode = draw(st.sampled_from(["RGBA", "RGB", "L", "1", "P", "LA", "CMYK", "I;16", "F"]))
    kind = draw(st.sampled_from(["PNG", "JPEG", "WEBP", "GIF", "BMP", "TIFF"]))
    file = io.BytesIO()
    try:
        converted = Image.fromarray(pixels).convert(mode if mode != "I;16" else "I")
        (converted if mode != "I;16" else converted.convert("I;16")).save(file, kind)
    except (OSError, ValueError):  # not every format has every mode
        Image.fromarray(pixels).save(file, "PNG")
    content = bytearray(file.getvalue())
    for place in draw(st.lists(st.integers(0, len(content) - 1), max_size=3)):
        content[place] = draw(st.integers(0, 255))
    return bytes(content[: draw(st.sampled_from([len(content), len(content), len(content) // 2]))])


def answer(work: Callable[..., T], *asked: Any) -> T | None:
    """The result, or nothing after a sentence."""
    try:
        return work(*asked)
    except ValueError as error:
        words = str(error)
    assert len(words) > 10
    assert words[-1] in ".?"
    return None


@settings(max_examples=CASES)
@given(pictures(), st.none() | st.floats(0, 100))
def test_any_bytes_are_cut_out_or_refused_in_a_sentence(content, difference):
    cut = answer(app_actions.answer_cut_out, content, difference)
    assert cut is None or (cut[..., 3] > 32).any()


@settings(max_examples=CASES)
@given(params=NEARLY_PARAMS | JSON, suffix=st.sampled_from([".json", ".json", ".exe"]) | st.text(max_size=5))
def test_any_parameters_are_written_or_refused_in_a_sentence(studio, tmp_path_factory, params, suffix):
    folder = tmp_path_factory.getbasetemp()
    made = answer(app_actions.write, studio, folder, "box", params, ".json" if suffix in FORMATS else suffix)
    written = params_from_json(made.read_text())[1] if made else TRUTH
    assert BOX.validate(written) == written


@settings(max_examples=max(4, CASES // 40))
@given(content=pictures(), keep=NEARLY_PARAMS, seed=st.integers(0, 2**31))
def test_any_request_for_an_estimate_gets_candidates_or_a_sentence(studio, content, keep, seed):
    found = answer(app_actions.answer_estimate, studio, content, "box", 1, seed, keep)
    assert found is None or BOX.validate(found["candidates"][0]["params"])
