"""Estimators of several generators, each loaded when it is first used, and the classifier that chooses among them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path

from dipcg import registry
from dipcg.generators import load_generator
from dipcg.images import Cutout, Source, cut_out
from dipcg.inference.classifier import ENCODER, FILE, Classifier, load_classifier, read_classifier
from dipcg.model.zoo import CheckpointError, Reads, find_checkpoint, shipped
from dipcg.pipeline import Inverter
from dipcg.space import did_you_mean


class Inverters(Mapping[str, Inverter]):
    """Estimators by the name of their generator; a context manager that closes them together.

    `names` are generators or folders with checkpoints. Without names they are the generators that ship and can be built
    here, or for text all that ship. No checkpoint is loaded twice; one of a folder is loaded at once, since it says
    which generator it is for. Raises LookupError for an unknown name, ValueError for two checkpoints of one generator,
    and zoo.CheckpointError with a sentence.
    """

    def __init__(self, names: Sequence[str] = (), workers: int = 1, reads: Reads = "pictures") -> None:
        self._workers = workers
        self._reads: Reads = reads
        # By reference and by folder, since several references may lead to one folder.
        self._loaded: dict[str, Inverter] = {}
        chosen = names or (recognisable() if reads == "pictures" else shipped(reads))
        self._refs: dict[str, str] = {}
        for ref in chosen:
            self._add(ref if _is_name(ref) else self._load(ref).generator.name, ref)

    def __getitem__(self, name: str) -> Inverter:
        return self._load(self._refs[name])

    def __contains__(self, name: object) -> bool:
        # Without this the mapping would load an estimator to say that it has it.
        return name in self._refs

    def __iter__(self) -> Iterator[str]:
        return iter(self._refs)

    def __len__(self) -> int:
        return len(self._refs)

    def find(self, name: str) -> Inverter:
        """The estimator of a generator; raises ValueError with the nearest name."""
        if name not in self._refs:
            near = did_you_mean(str(name), list(self))
            raise ValueError(f"There is no generator {name!r} here.{near} There are: {', '.join(self)}.")
        return self[name]

    def classify(self, picture: Source | Cutout) -> dict[str, float]:
        """The probability that a picture shows what each shipped generator makes, the likeliest first.

        Empty where the classifier knows none of these generators or its encoder is missing. Raises images.ImageError.
        """
        return self.classify_many([cut_out(picture)])[0]

    def classify_many(self, pictures: Sequence[Cutout]) -> list[dict[str, float]]:
        """As `classify`, for several pictures in one pass of the encoder."""
        if self._classifier is None:
            return [{} for _ in pictures]
        classifier, encoder = self._classifier
        return classifier.classify_many(pictures, encoder)

    def replace(self, folder: str) -> Inverter:
        """Take the checkpoint in a folder in place of the one for the same generator, if there is one."""
        made = Inverter.load(folder, self._workers)
        self.remove(made.generator.name)
        self._loaded |= {folder: made}
        # Another thread may be listing the names.
        self._refs = self._refs | {made.generator.name: folder}
        return made

    def remove(self, name: str) -> None:
        """Forget a generator, and stop its workers; nothing happens when there is none of this name."""
        ref = self._refs.get(name)
        self._refs = {other: where for other, where in self._refs.items() if other != name}
        old = self._loaded.pop(ref, None) if ref else None
        self._loaded = {where: inverter for where, inverter in self._loaded.items() if inverter is not old}
        if old:
            old.close()

    def close(self) -> None:
        """Stop the workers of all estimators."""
        for inverter in self._loaded.values():
            inverter.close()

    def __enter__(self) -> Inverters:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _add(self, name: str, ref: str) -> None:
        other = self._refs.setdefault(name, ref)
        if other != ref and self._load(other) is not self._load(ref):
            raise ValueError(f"{other} and {ref} are both for the generator {name!r}; give only one of them.")

    @cached_property
    def _classifier(self) -> tuple[Classifier, Inverter] | None:
        if not FILE.is_file() or not self.keys() & set(read_classifier(FILE).names):
            return None
        try:
            encoder = self._load(ENCODER)
        except (LookupError, CheckpointError):
            return None
        classifier = load_classifier(encoder)
        return (classifier, encoder) if classifier else None

    def _load(self, ref: str) -> Inverter:
        if ref not in self._loaded:
            folder = str(find_checkpoint(ref, self._reads).resolve())
            inverter = self._loaded.get(folder) or Inverter.load(folder, self._workers)
            self._loaded |= {ref: inverter, folder: inverter}
        return self._loaded[ref]


def _is_name(ref: str) -> bool:
    return ref in registry.names("generators") or not ("/" in ref or registry.is_path(ref) or Path(ref).is_dir())


def recognisable() -> list[str]:
    """The generators with a checkpoint that can be built here; raises zoo.CheckpointError when there is none."""
    names = [name for name in shipped() if not load_generator(name).missing]
    if not names:
        raise CheckpointError(
            "No generator with a trained checkpoint can be built here, so none can be recognised; "
            "run `dipcg doctor`, or name a folder with a checkpoint with -g."
        )
    return names
