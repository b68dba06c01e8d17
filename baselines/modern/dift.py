"""DIFT: features of a diffusion model's U-Net (Tang et al. 2023), by the library `diffusers`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, Final

from pliant.baselines.adapters.descriptors import DescriptorMatcher
from pliant.baselines.modern.loading import images_for, library, pretrained
from pliant.spec.errors import CallError

_MULTIPLE: Final = 64
_INSTALL: Final = "pip install diffusers 'pliant[modern]'"


class Dift(DescriptorMatcher):
    """Features of Stable Diffusion for a noisy image, nearest by cosine on the object.

    Args:
        weights: A folder, or an id on the Hugging Face Hub, such as
            `stabilityai/stable-diffusion-2-1`.
        device: A torch device.
        size: Width and height that images are resized to, rounded up to multiples of 64.
        timestep: How noisy the image is made; the paper takes 261 of 1,000 for semantic and 0 for
            geometric correspondence.
        block: Which block of the decoder, from 0, the coarsest; the paper takes 1 and 2 likewise.
        ensemble: Draws of noise whose features are averaged, >= 1.
        prompt: Text that describes the image.
        seed: Random seed of the noise.
    """

    library: Final = "diffusers"

    def __init__(
        self,
        weights: str,
        device: str = "cpu",
        size: Sequence[int] = (768, 576),
        timestep: int = 261,
        block: int = 1,
        ensemble: int = 8,
        prompt: str = "",
        seed: int = 0,
    ) -> None:
        diffusers = library(self.library, "dift", _INSTALL)
        transformers = library("transformers", "dift", _INSTALL)
        if ensemble < 1:
            raise CallError("too few draws of noise", found=ensemble, required="ensemble >= 1")
        part = partial(_part, weights)
        self._unet = part(diffusers.UNet2DConditionModel, "unet").to(device).eval()
        self._vae = part(diffusers.AutoencoderKL, "vae").to(device).eval()
        self._scheduler = part(diffusers.DDIMScheduler, "scheduler")
        if not 0 <= block < len(self._unet.up_blocks):
            raise CallError(
                "there is no such block",
                found=block,
                required=f"0 to {len(self._unet.up_blocks) - 1}",
            )
        text = part(transformers.CLIPTextModel, "text_encoder").eval()
        self._prompt = _embedded(
            part(transformers.CLIPTokenizer, "tokenizer"), text, prompt, device
        )
        self._timestep, self._ensemble, self._seed = timestep, ensemble, seed
        self._kept: dict[str, Any] = {}
        self._unet.up_blocks[block].register_forward_hook(
            lambda block, given, features: self._kept.update(features=features)
        )
        facts = {
            "weights": weights, "timestep": timestep, "block": block, "ensemble": ensemble,
            "prompt": prompt, "seed": seed, "version": diffusers.__version__,
        }  # fmt: skip
        images = images_for(device, size, _MULTIPLE)
        super().__init__(self._features, "dift", images, facts=facts)

    def _features(self, image: Any) -> Any:
        """Return the features, (D, h, w), of an image (1, 3, H, W), 0 to 1."""
        import torch

        generator = torch.Generator().manual_seed(self._seed)
        with torch.inference_mode():
            latent = self._vae.encode(2 * image - 1).latent_dist.mean
            latent = (latent * self._vae.config.scaling_factor).expand(self._ensemble, -1, -1, -1)
            noise = torch.randn(latent.shape, generator=generator).to(latent)
            step = torch.tensor(self._timestep, device=latent.device)
            noisy = self._scheduler.add_noise(latent, noise, step)
            text = self._prompt.expand(self._ensemble, -1, -1)
            self._unet(noisy, step, encoder_hidden_states=text)
        return self._kept.pop("features").mean(dim=0)


def _part(weights: str, kind: Any, folder: str) -> Any:
    return pretrained(kind, weights, subfolder=folder)


def _embedded(tokenizer: Any, encoder: Any, prompt: str, device: str) -> Any:
    """Return the embedding of a text, (1, L, D)."""
    import torch

    tokens = tokenizer(
        prompt, padding="max_length", max_length=tokenizer.model_max_length, truncation=True,
        return_tensors="pt",
    )  # fmt: skip
    with torch.inference_mode():
        return encoder(tokens.input_ids)[0].to(device)
