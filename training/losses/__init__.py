"""Loss terms: pixel, perceptual and adversarial."""
