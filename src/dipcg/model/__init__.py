"""The networks, the diffusion, the samplers and the checkpoint files.

The encoder's summary of a picture is first regressed onto `x`, and the denoiser receives this first guess with each
token and the summary with the time embedding; with cross-attention as the only path from picture to denoiser,
training makes no progress for a long time. Real parameters are bounded, and choices are categorical, because an
average of two options is no third option. Inactive parameters hold random values in training and count in no loss.
Some parameters are fixed at their true values in a share of the training pictures, so that `--keep` samples a
conditional distribution instead of overwriting a result. Two fixed values are refused when one makes the other
inactive, and a choice that a fixed value needs is fixed too. For several pictures of one object each denoising step
uses the mean of the real parameters, the product of the probabilities of the options, and a camera for each
picture. The paper's model is a second estimator behind the same interface, without first guess, camera, and fixed
parameters in training; its diffusion is tested against closed forms, and against diffusers where that package is
installed. On a CPU attention is written as matrix products, because the backward pass of the fused kernel in
bfloat16 is slower there. A checkpoint is a safetensors file and a JSON file, never a pickle, and is refused when
the parameter space has changed.
"""
