"""Compiled loops over the observations: residuals, and the normal equations of the adjustment."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def _observe(
    tau, row, rotation, centre, clock, lens, calibration, control, table, first_interval, spacing, xy, position, jac
):
    """Predict one detection.

    Fills xy (2,) with the projection; with a non-empty jac (2, 19) also its derivatives by the 16 camera parameters and
    the 3 coordinates of the point; position (2,) receives the first control point and u. Returns False where the time
    lies outside the spline or the point behind the camera.
    """
    t = clock[0] + clock[1] * tau + clock[2] * row
    p = t / spacing
    k = int(np.floor(p))
    if k < first_interval or k - first_interval >= table.shape[0]:
        return False
    first = table[k - first_interval]
    if first < 0:
        return False
    u = p - k
    position[0], position[1] = first, u

    b0 = (1 - u) ** 3 / 6
    b1 = (3 * u**3 - 6 * u**2 + 4) / 6
    b2 = (-3 * u**3 + 3 * u**2 + 3 * u + 1) / 6
    b3 = u**3 / 6
    d0 = b0 * control[first, 0] + b1 * control[first + 1, 0] + b2 * control[first + 2, 0] + b3 * control[first + 3, 0]
    d1 = b0 * control[first, 1] + b1 * control[first + 1, 1] + b2 * control[first + 2, 1] + b3 * control[first + 3, 1]
    d2 = b0 * control[first, 2] + b1 * control[first + 1, 2] + b2 * control[first + 2, 2] + b3 * control[first + 3, 2]
    d0, d1, d2 = d0 - centre[0], d1 - centre[1], d2 - centre[2]
    X = rotation[0, 0] * d0 + rotation[0, 1] * d1 + rotation[0, 2] * d2
    Y = rotation[1, 0] * d0 + rotation[1, 1] * d1 + rotation[1, 2] * d2
    Z = rotation[2, 0] * d0 + rotation[2, 1] * d1 + rotation[2, 2] * d2
    if 1e-9 * (abs(X) + abs(Y)) >= Z:
        return False

    x, y = X / Z, Y / Z
    focal = np.exp(lens[0])
    fx = calibration[0] * focal
    fy = calibration[1] * focal * np.exp(lens[1])
    k1, k2, k3 = calibration[4] + lens[4], calibration[5] + lens[5], calibration[8] + lens[6]
    p1, p2 = calibration[6], calibration[7]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    xy[0] = fx * xd + calibration[2] + calibration[0] * lens[2]
    xy[1] = fy * yd + calibration[3] + calibration[1] * lens[3]
    if jac.shape[0] == 0:
        return True

    slope = k1 + r2 * (2 * k2 + 3 * r2 * k3)
    xx = fx * (radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x)
    xy_ = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    yy = fy * (radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x)
    iz = 1 / Z
    # Derivative by the point in the camera frame, (2, 3).
    c00, c01 = xx * iz, fx * xy_ * iz
    c02 = -(c00 * x + c01 * y)
    c10, c11 = fy * xy_ * iz, yy * iz
    c12 = -(c10 * x + c11 * y)
    # R <- exp(omega) R moves the point by omega x point.
    jac[0, 0], jac[0, 1], jac[0, 2] = c02 * Y - c01 * Z, c00 * Z - c02 * X, c01 * X - c00 * Y
    jac[1, 0], jac[1, 1], jac[1, 2] = c12 * Y - c11 * Z, c10 * Z - c12 * X, c11 * X - c10 * Y
    for a in range(3):
        w0 = c00 * rotation[0, a] + c01 * rotation[1, a] + c02 * rotation[2, a]
        w1 = c10 * rotation[0, a] + c11 * rotation[1, a] + c12 * rotation[2, a]
        jac[0, 16 + a], jac[1, 16 + a] = w0, w1
        jac[0, 3 + a], jac[1, 3 + a] = -w0, -w1
    e0 = -((1 - u) ** 2) / (2 * spacing)
    e1 = (3 * u**2 - 4 * u) / (2 * spacing)
    e2 = (-3 * u**2 + 2 * u + 1) / (2 * spacing)
    e3 = u**2 / (2 * spacing)
    s0, s1 = 0.0, 0.0
    for a in range(3):
        v = (
            e0 * control[first, a]
            + e1 * control[first + 1, a]
            + e2 * control[first + 2, a]
            + e3 * control[first + 3, a]
        )
        s0 += jac[0, 16 + a] * v
        s1 += jac[1, 16 + a] * v
    jac[0, 6], jac[0, 7], jac[0, 8] = s0, s0 * tau, s0 * row
    jac[1, 6], jac[1, 7], jac[1, 8] = s1, s1 * tau, s1 * row
    jac[0, 9], jac[1, 9] = fx * xd, fy * yd
    jac[0, 10], jac[1, 10] = 0.0, fy * yd
    jac[0, 11], jac[1, 11] = calibration[0], 0.0
    jac[0, 12], jac[1, 12] = 0.0, calibration[1]
    r = r2
    for i in range(3):
        jac[0, 13 + i], jac[1, 13 + i] = fx * x * r, fy * y * r
        r *= r2
    return True


@njit(cache=True, error_model="numpy")
def predict(camera, tau, row, rotation, centre, clock, lens, calibration, control, table, first_interval, spacing):
    """Projections (n, 2) of all detections; NaN where the state does not predict one."""
    n = camera.shape[0]
    out = np.full((n, 2), np.nan)
    xy, position, no_jac = np.empty(2), np.empty(2), np.empty((0, 0))
    for i in range(n):
        c = camera[i]
        if _observe(
            tau[i], row[i], rotation[c], centre[c], clock[c], lens[c], calibration[c],
            control, table, first_interval, spacing, xy, position, no_jac,
        ):  # fmt: skip
            out[i, 0], out[i, 1] = xy[0], xy[1]
    return out


@njit(cache=True, error_model="numpy")
def jacobian(camera, tau, row, rotation, centre, clock, lens, calibration, control, table, first_interval, spacing):
    """Derivatives (n, 2, 19) of all projections by the camera's 16 parameters and the point's 3 coordinates."""
    n = camera.shape[0]
    out = np.full((n, 2, 19), np.nan)
    xy, position = np.empty(2), np.empty(2)
    for i in range(n):
        c = camera[i]
        _observe(
            tau[i], row[i], rotation[c], centre[c], clock[c], lens[c], calibration[c],
            control, table, first_interval, spacing, xy, position, out[i],
        )  # fmt: skip
    return out


@njit(cache=True, error_model="numpy")
def robust_cost(measured, predicted, camera, sigma, information, loss_scale):
    """Sum of the weighted Cauchy losses; detections that are not predicted count as errors of ten loss scales."""
    total = 0.0
    c2 = loss_scale**2
    unpredicted = c2 * np.log1p(100.0)
    for i in range(camera.shape[0]):
        c = camera[i]
        dx, dy = predicted[i, 0] - measured[i, 0], predicted[i, 1] - measured[i, 1]
        s = (dx * dx + dy * dy) / sigma[c] ** 2
        total += information[c] * (c2 * np.log1p(s / c2) if s == s else unpredicted)
    return 0.5 * total


@njit(cache=True, error_model="numpy")
def normal_equations(
    camera, tau, row, measured, rotation, centre, clock, lens, calibration, control, table, first_interval, spacing,
    sigma, information, loss_scale,
):  # fmt: skip
    """Gauss-Newton normal equations of the robust cost.

    Returns camera blocks (c, 16, 16), camera gradient (c, 16), coupling (c, m, 3, 16), spline blocks (m, 4, 3, 3) where
    [i, d] couples control points i and i + d, and spline gradient (m, 3).
    """
    n_cameras, m = rotation.shape[0], control.shape[0]
    H_camera, g_camera = np.zeros((n_cameras, 16, 16)), np.zeros((n_cameras, 16))
    coupling = np.zeros((n_cameras, m, 3, 16))
    H_spline, g_spline = np.zeros((m, 4, 3, 3)), np.zeros((m, 3))
    xy, position, J = np.empty(2), np.empty(2), np.empty((2, 19))
    basis, G, N = np.empty(4), np.empty((3, 3)), np.empty((3, 16))
    c2 = loss_scale**2
    for i in range(camera.shape[0]):
        c = camera[i]
        if not _observe(
            tau[i], row[i], rotation[c], centre[c], clock[c], lens[c], calibration[c],
            control, table, first_interval, spacing, xy, position, J,
        ):  # fmt: skip
            continue
        rx, ry = xy[0] - measured[i, 0], xy[1] - measured[i, 1]
        s = (rx * rx + ry * ry) / sigma[c] ** 2
        w = information[c] / (sigma[c] ** 2 * (1 + s / c2))
        first, u = int(position[0]), position[1]
        basis[0] = (1 - u) ** 3 / 6
        basis[1] = (3 * u**3 - 6 * u**2 + 4) / 6
        basis[2] = (-3 * u**3 + 3 * u**2 + 3 * u + 1) / 6
        basis[3] = u**3 / 6
        for a in range(16):
            ja, jb = w * J[0, a], w * J[1, a]
            g_camera[c, a] += ja * rx + jb * ry
            for b in range(a, 16):
                H_camera[c, a, b] += ja * J[0, b] + jb * J[1, b]
            for b in range(3):
                N[b, a] = ja * J[0, 16 + b] + jb * J[1, 16 + b]
        for a in range(3):
            for b in range(3):
                G[a, b] = w * (J[0, 16 + a] * J[0, 16 + b] + J[1, 16 + a] * J[1, 16 + b])
        for k in range(4):
            bk = basis[k]
            for a in range(3):
                g_spline[first + k, a] += bk * w * (J[0, 16 + a] * rx + J[1, 16 + a] * ry)
                for b in range(16):
                    coupling[c, first + k, a, b] += bk * N[a, b]
            for d in range(4 - k):
                bb = bk * basis[k + d]
                for a in range(3):
                    for b in range(3):
                        H_spline[first + k, d, a, b] += bb * G[a, b]
    for c in range(n_cameras):
        for a in range(16):
            for b in range(a):
                H_camera[c, a, b] = H_camera[c, b, a]
    return H_camera, g_camera, coupling, H_spline, g_spline


@njit(cache=True, error_model="numpy")
def banded_inverse(factor):
    """The band of the inverse of a banded matrix from its Cholesky factor, both in LAPACK's lower band storage.

    Takahashi, Fagan & Chen 1973; Erisman & Tinney 1975: only entries inside the band are formed.
    """
    width, n = factor.shape
    Z = np.zeros((width, n))
    for j in range(n - 1, -1, -1):
        last = min(width - 1, n - 1 - j)
        for i in range(last, -1, -1):
            total = 0.0
            for k in range(1, last + 1):
                low, high = (i, k) if i < k else (k, i)
                total += factor[k, j] * Z[high - low, j + low]
            if i == 0:
                Z[0, j] = (1 / factor[0, j] - total) / factor[0, j]
            else:
                Z[i, j] = -total / factor[0, j]
    return Z
