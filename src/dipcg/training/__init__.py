"""Training: pictures and sentences as input, augmentation, the training loop, and the recipes of the paper.

Pictures are rendered during training and never stored. A rendered view is used several times, each time with
another augmentation, because rendering takes about as long as a training step on it. The encoder and its direct
regression are trained first, and the denoiser later, on what the encoder has learnt. The state beside a checkpoint
lets a killed run continue. Three quarters of a batch of sentences are put together from phrases that were encoded
alone. The frozen sentence encoder takes longer than a training step, and a network that sees the same sentences
many times overfits to them. The rest of a batch is whole sentences, so that the network also learns what one word
does to another. Several GPUs are several processes. Each computes its own gradients, all gradients are averaged in
one exchange per step, and values such as the time come by a broadcast from rank 0. The network is called in parts,
so a wrapper around a single `forward` does not fit; accelerate starts the processes and chooses their devices. A
recipe is a pair of frozen configurations. `--recipe` makes them the defaults of all other flags.
"""
