"""Cross-correlations of sampled signals at every lag, by FFT."""

from __future__ import annotations

import numpy as np

from skytrace.geometry.arrays import FloatArray


def fast_length(n: int) -> int:
    """The smallest length of at least n that real FFTs handle fast."""
    from scipy.fft import next_fast_len

    return int(next_fast_len(n, real=True))  # type: ignore[arg-type]


def cross_correlations(a: FloatArray, b: FloatArray) -> FloatArray:
    """c[i, j, lag] = sum_t a[i, t] b[j, t + lag], lags -(n - 1) .. m - 1, of signals (k, n) and (l, m)."""
    n, m = a.shape[1], b.shape[1]
    length = fast_length(n + m - 1)
    spectrum = np.fft.rfft(a, length).conj()[:, None] * np.fft.rfft(b, length)[None]
    full = np.fft.irfft(spectrum, length)
    return np.concatenate([full[..., length - (n - 1) :] if n > 1 else full[..., :0], full[..., :m]], axis=-1)


def autocorrelation(a: FloatArray, n_lags: int) -> FloatArray:
    """c[i, lag] = sum_t a[i, t] a[i, t + lag], lags 0 .. n_lags - 1, of signals (k, n)."""
    length = fast_length(a.shape[1] + n_lags)
    return np.fft.irfft(np.abs(np.fft.rfft(a, length)) ** 2, length)[:, :n_lags]
