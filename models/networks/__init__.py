"""Networks from an image to a descriptor at every pixel, and pretrained weights for them."""
