from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file
from torch import nn

from pliant.loaders.inputs import InputKind, NetworkInput
from pliant.models.networks.descriptor_network import (
    DescriptorNetwork,
    NetworkSettings,
    sample_descriptors,
)
from pliant.models.networks.mask_network import NARROW, WIDE, MaskNetwork
from pliant.models.networks.pretrained import read_weights
from pliant.models.networks.resnet import BasicBlock, ResNetFCN
from pliant.models.networks.unet import ConvBlock
from pliant.spec.errors import CallError

COLOUR = NetworkInput()
SMALL = NetworkSettings(widths=(8, 16, 32))


@pytest.mark.parametrize("name", ["unet", "resnet18"])
@pytest.mark.parametrize("kind", ["depth", "rgb"])
def test_a_descriptor_and_an_orientation_at_every_pixel(name: str, kind: InputKind) -> None:
    settings = SMALL.replace(name=name, descriptor_dim=5)
    images = torch.randn(1, NetworkInput(kind).channels, 50, 66)
    for orientation in (False, True):
        network = DescriptorNetwork(settings, NetworkInput(kind), orientation=orientation).eval()
        with torch.inference_mode():
            out = network.described(images)
            assert torch.equal(network(images), out.descriptors)
        assert out.descriptors.shape == (1, 5, 50, 66)
        assert out.orientation.shape == (1, 3 * orientation, 50, 66)


@pytest.mark.parametrize(
    ("name", "blocks", "millions"), [("resnet18", 8, 11.18), ("resnet34", 16, 21.28)]
)
def test_resnets_have_depth_and_parameters_of_torchvision_and_stride_8(
    name: str, blocks: int, millions: float
) -> None:
    """Parameters without the classifier, by torchvision's documentation."""
    network = ResNetFCN(name, 3, 4).eval()
    assert sum(len(getattr(network, f"layer{stage}")) for stage in range(1, 5)) == blocks
    counted = sum(p.numel() for key, p in network.named_parameters() if "head" not in key)
    assert counted / 1e6 == pytest.approx(millions, abs=0.01)
    assert "layer4.1.bn2.running_mean" in network.state_dict()
    sizes: list[torch.Size] = []
    network.layer4.register_forward_hook(lambda module, inputs, output: sizes.append(output.shape))
    with torch.inference_mode():
        network(torch.randn(1, 3, 64, 96))
    assert sizes[0][-2:] == (8, 12)


def test_descriptors_between_pixels() -> None:
    """A map that holds each pixel's own centre must give back the position asked for."""
    v, u = torch.meshgrid(torch.arange(6) + 0.5, torch.arange(8) + 0.5, indexing="ij")
    descriptors = torch.stack([u, v])[None]
    uv = torch.tensor([[[0.5, 0.5], [3.7, 2.2], [7.5, 5.5], [4.0, 3.0]]])
    torch.testing.assert_close(sample_descriptors(descriptors, uv), uv)


def test_global_blocks_see_the_whole_image() -> None:
    torch.manual_seed(0)
    image = torch.randn(1, 3, 64, 128, requires_grad=True)
    for blocks, seen in ((0, False), (1, True)):
        network = DescriptorNetwork(SMALL.replace(global_blocks=blocks), COLOUR)
        for module in network.modules():  # group normalisation sees everything too, a little
            if isinstance(module, ConvBlock):
                module.add_module("norm1", nn.Identity())
                module.add_module("norm2", nn.Identity())
        (gradient,) = torch.autograd.grad(network(image)[0, :, 32, 0].sum(), image)
        assert bool((gradient[..., 96:] != 0).any()) == seen


def test_patches_keep_the_size_of_the_output() -> None:
    settings = NetworkSettings(widths=(16, 32, 32), patch=2, descriptor_dim=3)
    assert DescriptorNetwork(settings, COLOUR)(torch.randn(1, 3, 33, 46)).shape == (1, 3, 33, 46)


def resnet_of(network: DescriptorNetwork) -> ResNetFCN:
    assert isinstance(network.backbone, ResNetFCN)
    return network.backbone


def saved(folder: Path, network: nn.Module, pairs: str = "") -> str:
    """Return the folder with a run's weights and, where given, a config that says its input."""
    save_file(network.state_dict(), folder / "best.safetensors")
    if pairs:
        (folder / "config.yaml").write_text(f"pairs: {pairs}\n")
    return str(folder)


@pytest.mark.parametrize("suffix", [".safetensors", ".pth"])
def test_pretrained_weights_from_a_file(tmp_path: Path, suffix: str) -> None:
    torch.manual_seed(1)
    given = ResNetFCN("resnet18", 3, 4).state_dict()
    given["fc.weight"] = torch.zeros(1000, 512)  # what classifiers have besides
    path = tmp_path / f"weights{suffix}"
    if suffix == ".pth":
        torch.save({"state_dict": given}, path)
    else:
        save_file(given, path)
    torch.manual_seed(2)
    settings = NetworkSettings(name="resnet18", descriptor_dim=7, pretrained=str(path))
    network = DescriptorNetwork(settings, COLOUR)
    torch.testing.assert_close(resnet_of(network).conv1.weight, given["conv1.weight"])
    block = resnet_of(network).layer3[1]
    assert isinstance(block, BasicBlock)
    torch.testing.assert_close(block.bn1.running_var, torch.ones(256))


def test_colour_weights_serve_depth(tmp_path: Path) -> None:
    colour = ResNetFCN("resnet18", 3, 4)
    settings = NetworkSettings(name="resnet18", pretrained=saved(tmp_path, colour))
    depth = resnet_of(DescriptorNetwork(settings, NetworkInput("depth", masks=True))).conv1.weight
    torch.testing.assert_close(depth[:, 0], colour.conv1.weight.mean(dim=1))
    assert not depth[:, 1:].any()


@pytest.mark.parametrize("content", [None, b"", b"junk" * 100])
@pytest.mark.parametrize("suffix", [".safetensors", ".pt"])
def test_unreadable_weights_are_one_sentence(
    tmp_path: Path, suffix: str, content: bytes | None
) -> None:
    path = tmp_path / f"bad{suffix}"
    if content is not None:
        path.write_bytes(content)
    found = "no such file" if content is None else "a file that contains no weights"
    with pytest.raises(CallError, match=f"pretrained weights cannot be read; found {found}; req"):
        read_weights(str(path))


def test_a_pickle_with_code_is_not_run(tmp_path: Path) -> None:
    import pickle

    marker = tmp_path / "ran"

    class Evil:
        def __reduce__(self) -> tuple[object, ...]:
            return Path.touch, (marker,)

    path = tmp_path / "evil.pt"
    path.write_bytes(pickle.dumps(Evil()))
    with pytest.raises(CallError):
        read_weights(str(path))
    assert not marker.exists()


def test_weights_of_another_network_are_refused(tmp_path: Path) -> None:
    save_file({"other": torch.zeros(3)}, tmp_path / "w.safetensors")
    settings = SMALL.replace(pretrained=str(tmp_path / "w.safetensors"))
    with pytest.raises(CallError, match=r"none of the pretrained.*Copy `network`"):
        DescriptorNetwork(settings, COLOUR)


def test_scale_is_positive_and_learned_only_if_asked() -> None:
    learned = DescriptorNetwork(SMALL, COLOUR, initial_scale=4.0)
    fixed = DescriptorNetwork(SMALL, COLOUR, initial_scale=4.0, learn_scale=False)
    assert float(learned.scale.detach()) == pytest.approx(4.0)
    assert learned.log_scale.requires_grad
    assert not fixed.log_scale.requires_grad
    assert np.isfinite(float(fixed.scale.detach()))


def test_a_run_goes_on_from_the_weights_and_the_scale_of_another(tmp_path: Path) -> None:
    torch.manual_seed(1)
    earlier = DescriptorNetwork(SMALL, COLOUR, initial_scale=2.5)
    source = saved(tmp_path, earlier)
    torch.manual_seed(2)
    later = DescriptorNetwork(SMALL.replace(pretrained=source), COLOUR, initial_scale=1.0)
    image = torch.rand(1, 3, 32, 32)
    assert torch.equal(later(image), earlier(image))
    assert later.scale.item() == pytest.approx(2.5)


def test_a_colour_network_goes_on_with_grey_and_masks(tmp_path: Path) -> None:
    """On a grey picture, with no mask given, it answers as the colour network does."""
    settings = NetworkSettings(widths=(8, 16, 32), patch=2)
    torch.manual_seed(1)
    earlier = DescriptorNetwork(settings, COLOUR, orientation=True)
    settings = settings.replace(pretrained=saved(tmp_path, earlier, "{input: rgb}"))
    torch.manual_seed(2)
    seen = NetworkInput("grey", masks=True)
    later = DescriptorNetwork(settings, seen, orientation=True, foreground=True)
    grey = torch.rand(1, 1, 32, 32)
    given = torch.cat([grey, torch.zeros(1, 2, 32, 32)], dim=1)
    before, after = earlier.described(grey.expand(-1, 3, -1, -1)), later.described(given)
    torch.testing.assert_close(after.descriptors, before.descriptors)
    torch.testing.assert_close(after.orientation, before.orientation)
    assert after.foreground.shape == (1, 2, 32, 32)


def test_channels_of_two_inputs_are_matched_by_name(tmp_path: Path) -> None:
    """Twelve filters a patch on both sides: taken by position, red would serve as grey."""
    settings = NetworkSettings(widths=(8, 32), patch=2)
    masked = DescriptorNetwork(settings, NetworkInput("depth", masks=True))
    source = saved(tmp_path, masked, "{input: depth, masks: true}")
    settings = settings.replace(pretrained=source)
    grey = DescriptorNetwork(settings, NetworkInput("grey", masks=True))
    name = "backbone.encoder.0.conv1.weight"
    given, taken = masked.state_dict()[name], grey.state_dict()[name]
    assert not taken[:, :4].any()  # nothing is known of grey
    torch.testing.assert_close(taken[:, 4:], given[:, 4:])


def test_a_wider_network_computes_the_same() -> None:
    torch.manual_seed(3)
    narrow = MaskNetwork().eval()
    for values in narrow.parameters():
        torch.nn.init.normal_(values, std=0.5)
    wide = narrow.widened().eval()
    picture = torch.rand(2, 3, 50, 70)
    with torch.inference_mode():
        expected = narrow(picture)
        torch.testing.assert_close(wide(picture), expected, rtol=0, atol=1e-4 * expected.std())
    parameters = [sum(each.numel() for each in of.parameters()) for of in (narrow, wide)]
    assert parameters[1] > 3 * parameters[0]


def test_the_copies_of_a_channel_become_unlike() -> None:
    torch.manual_seed(4)
    wide = MaskNetwork().widened()
    second = wide.get_parameter("encoder.1.conv1.weight")
    torch.testing.assert_close(second[0::2], second[1::2], rtol=0, atol=0)  # incoming weights
    optimiser = torch.optim.SGD(wide.parameters(), lr=0.1)
    for _ in range(2):
        optimiser.zero_grad()
        wide(torch.rand(1, 3, 48, 64)).square().mean().backward()
        optimiser.step()
    apart = (second[0::2] - second[1::2]).flatten(1).norm(dim=1)
    assert float(apart.detach().min()) > 0


def test_weights_say_how_wide_their_network_is() -> None:
    for widths in (NARROW, WIDE):
        weights = MaskNetwork(widths).state_dict()
        MaskNetwork.like(weights).load_state_dict(weights)
    assert len(MaskNetwork.like({}).state_dict()) == len(weights)  # which refuses them by name
