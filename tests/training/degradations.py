"""Low-resolution pictures by torch, for tests: a reference for `training.data.downscale`, and for whole batches."""

import torch


def bicubic(image, scale):
    """`(N, C, scale*H, scale*W)` in [0, 1] -> `(N, C, H, W)`, rounded to 8 bits: Keys' cubic, widened by `scale`."""
    size = [side // scale for side in image.shape[-2:]]
    small = torch.nn.functional.interpolate(image, size=size, mode="bicubic", align_corners=False, antialias=True)
    return small.clamp(0, 1).mul(255).round().div(255)


def box(image, scale):
    """The mean over each `scale x scale` cell. Shapes and range as of `bicubic`."""
    return torch.nn.functional.avg_pool2d(image, scale).mul(255).round().div(255)
