"""What fits leave of real logs: the mean over joints, torques of both low-passed alike."""

import numpy as np

from symid.identification.diagnostics.residual_structure import compute_band_residual, predict_torques


def measure_residuals(estimate, library, recording, processing, bands):
    """Return the relative residuals (bands,) in percent."""
    names = tuple(entry.name for entry in (*library.card.beta, *library.card.friction))
    values = estimate.assemble(names)
    found = [predict_torques(values, library, recording, processing, band=band) for band in bands]
    return np.array([compute_band_residual(prediction).mean_relative_percent for prediction in found])
