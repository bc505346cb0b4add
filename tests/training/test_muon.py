"""Muon: updates are orthogonal, and a badly scaled problem is solved."""

from copy import deepcopy

import pytest
import torch
from torch import nn

from dipcg.training.muon import Muon, _newton_schulz, _newton_schulz_of_squares, orthogonal


@pytest.mark.parametrize("shape", [(16, 16), (16, 40), (40, 16)])
def test_singular_vectors_stay_and_singular_values_become_alike(shape):
    matrix = torch.randn(3, *shape, generator=torch.Generator().manual_seed(0))
    left, _, right = torch.linalg.svd(matrix, full_matrices=False)
    found = orthogonal(matrix)
    values = torch.linalg.svdvals(found)
    assert values.min() > 0.4
    assert values.max() < 1.4
    rotated = left.mT @ found @ right.mT
    torch.testing.assert_close(rotated.diagonal(dim1=1, dim2=2).sort(descending=True).values, values, atol=0.05, rtol=0)
    assert (rotated - torch.diag_embed(rotated.diagonal(dim1=1, dim2=2))).abs().max() < 0.05


def test_steps_on_the_squares_of_wide_matrices_are_the_same_steps():
    torch.manual_seed(0)
    left, right = torch.linalg.qr(torch.randn(48, 48))[0], torch.linalg.qr(torch.randn(400, 48))[0]
    # Momentum has some large directions and many small ones.
    matrix = (left * torch.logspace(0, -4, 48)) @ right.mT
    matrix = (matrix / matrix.norm())[None]
    torch.testing.assert_close(_newton_schulz_of_squares(matrix), _newton_schulz(matrix), atol=1e-3, rtol=0)


def test_a_linear_map_is_found_from_inputs_of_very_different_sizes():
    torch.manual_seed(0)
    truth, layer = torch.randn(24, 24), nn.Linear(24, 24, bias=False)
    optimiser = Muon(layer.parameters(), lr=0.3)
    sizes = torch.logspace(0, -1.5, 24)
    for step in range(300):
        inputs = torch.randn(256, 24) * sizes
        loss = (layer(inputs) - inputs @ truth.T).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.param_groups[0]["lr"] = 0.3 * (1 - step / 300)
        optimiser.step()
    assert (layer.weight - truth).abs().mean() < 0.05 * truth.abs().mean()


def test_filters_are_matrices_and_the_state_is_restored():
    torch.manual_seed(0)
    layers = [nn.Conv2d(3, 8, 3) for _ in range(2)]
    images = torch.randn(2, 3, 9, 9)
    layers[1].load_state_dict(layers[0].state_dict())
    optimisers = [Muon([layer.weight]) for layer in layers]
    for step in range(4):
        if step == 2:
            optimisers[1].load_state_dict(deepcopy(optimisers[0].state_dict()))
            layers[1].load_state_dict(layers[0].state_dict())
        for layer, optimiser in zip(layers, optimisers, strict=True):
            if step < 2 and layer is layers[1]:
                continue
            optimiser.zero_grad()
            layer(images).square().mean().backward()
            optimiser.step()
    assert torch.equal(layers[0].weight, layers[1].weight)
