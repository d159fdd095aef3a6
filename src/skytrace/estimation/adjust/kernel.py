"""Compiled loops over the detections: projections, the cost, and the normal equations of the adjustment.

Detections are worked on in chunks of one camera. Quantities of a chunk are rows of a table whose columns are
detections, so that the compiler computes several detections at once. `reference` says the same in plain numpy.

All compiled code on detections is in this file: the compiler's cache on disk notices only changes of the file itself.

What a detection touches is local: one camera and the four control points around its time. A run of detections of one
camera between the same two knots therefore adds one small matrix, [control | camera | residual]^T [...], to the
equations; sorted by time, few runs are needed.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from skytrace.estimation.adjust.losses import CAUCHY, GEMAN_MCCLURE, HUBER

CHUNK = 64
# Rows of a chunk's `table`.
BASIS, POINT, VELOCITY, TAU, ROW = 0, 4, 7, 10, 11
PREDICTED = 12  # 1 where the state predicts the detection, else 0
X, Y, INVERSE_DEPTH = 13, 14, 15  # ideal coordinates on the plane z = 1
IMAGE, RESIDUAL = 16, 18  # pixels from the principal point; predicted less measured
ROOT_WEIGHT = 20
# From the plane z = 1 to the lens's own: m = SCALE x, dm/dx = SCALE I + BEND x x^T. A pinhole's are 1 and 0.
SCALE, BEND = 21, 22
N_ROWS = 23
# Columns of a camera's constants, `q` below.
ROTATION, CENTRE, CLOCK, FOCAL, PRINCIPAL, RADIAL, TANGENTIAL, CALIBRATED, FISHEYE = 0, 9, 12, 15, 17, 19, 23, 25, 27
UNPREDICTED = 100.0  # squared scales that a detection costs where the state does not predict it

# NaN keeps its meaning: no flag assumes that there is none. Only sums over many detections may be reordered.
_part = njit(forceinline=True, error_model="numpy", fastmath={"contract", "nsz", "arcp"})
_reduction = njit(forceinline=True, error_model="numpy", fastmath={"contract", "nsz", "arcp", "reassoc"})
_loop = njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "arcp"})


def camera_constants(rotation, centre, clock, lens, calibration):
    """What the loops need of each camera (c, 28), in the order of the columns above."""
    scale = np.exp(lens[:, :1] + np.stack([np.zeros(len(lens)), lens[:, 1]], axis=1))
    calibrated = calibration[:, :2]
    radial = np.hstack([calibration[:, [4, 5, 8]] + lens[:, 4:], calibration[:, 9:10]])
    principal = calibration[:, 2:4] + calibrated * lens[:, 2:4]
    pose = [rotation.reshape(-1, 9), centre]
    bent = [radial, calibration[:, 6:8]]
    return np.ascontiguousarray(
        np.hstack([*pose, clock, calibrated * scale, principal, *bent, calibrated, calibration[:, 10:]])
    )


@_part
def loss_value(code, s, c2):
    """rho(s) of a squared deviation s at the squared scale c2, see `losses`."""
    if code == CAUCHY:
        value = c2 * np.log1p(s / c2)
    elif code == HUBER:
        value = s if s <= c2 else 2 * np.sqrt(c2 * s) - c2
    elif code == GEMAN_MCCLURE:
        value = s / (1 + s / c2)
    else:
        value = s
    return value


@_part
def loss_weight(code, s, c2):
    """rho'(s)."""
    if code == CAUCHY:
        weight = 1 / (1 + s / c2)
    elif code == HUBER:
        weight = np.sqrt(c2 / max(s, c2))
    elif code == GEMAN_MCCLURE:
        weight = 1 / ((1 + s / c2) * (1 + s / c2))
    else:
        weight = 1.0
    return weight


@_part
def _chunk_end(camera, begin):
    """End of the chunk of one camera's detections that begins at `begin`."""
    end = begin + 1
    while end < len(camera) and end - begin < CHUNK and camera[end] == camera[begin]:
        end += 1
    return end


@_part
def _locate(table, first, begin, end, tau, row, q, control, control_of_interval, first_interval, spacing):
    """Where on the spline each detection lies: it was exposed at t = alpha j + beta + gamma y / h (Li et al. 2020).

    Fills the first control point, -1 outside all runs, and the rows of basis, point and velocity.
    """
    for i in range(end - begin):
        t = q[CLOCK] + q[CLOCK + 1] * tau[begin + i] + q[CLOCK + 2] * row[begin + i]
        position = t / spacing
        interval = np.floor(position)
        first[i] = -1
        if first_interval <= interval < first_interval + len(control_of_interval):
            first[i] = control_of_interval[int(interval) - first_interval]
        table[PREDICTED, i] = 1.0 if first[i] >= 0 else 0.0
        table[TAU, i], table[ROW, i] = tau[begin + i], row[begin + i]
        if first[i] < 0:
            continue
        u = position - interval
        v = 1 - u
        b0, b1, b3 = v * v * v / 6, (3 * u * u * u - 6 * u * u + 4) / 6, u * u * u / 6
        b2 = (-3 * u * u * u + 3 * u * u + 3 * u + 1) / 6
        table[BASIS, i], table[BASIS + 1, i], table[BASIS + 2, i], table[BASIS + 3, i] = b0, b1, b2, b3
        half = 0.5 / spacing
        d0, d1, d2, d3 = -half * v * v, half * (3 * u * u - 4 * u), half * (-3 * u * u + 2 * u + 1), half * u * u
        k = first[i]
        for a in range(3):
            c0, c1, c2, c3 = control[k, a], control[k + 1, a], control[k + 2, a], control[k + 3, a]
            table[POINT + a, i] = b0 * c0 + b1 * c1 + b2 * c2 + b3 * c3
            table[VELOCITY + a, i] = d0 * c0 + d1 * c1 + d2 * c2 + d3 * c3
    for i in range(end - begin, CHUNK):
        table[PREDICTED, i] = 0.0


@_part
def _project(table, q):
    """Pixels from the principal point; points behind the camera are not predicted."""
    fx, fy = q[FOCAL], q[FOCAL + 1]
    k1, k2, k3, k4, p1, p2 = q[RADIAL], q[RADIAL + 1], q[RADIAL + 2], q[RADIAL + 3], q[TANGENTIAL], q[TANGENTIAL + 1]
    for i in range(CHUNK):
        d0 = table[POINT, i] - q[CENTRE]
        d1 = table[POINT + 1, i] - q[CENTRE + 1]
        d2 = table[POINT + 2, i] - q[CENTRE + 2]
        px = q[ROTATION] * d0 + q[ROTATION + 1] * d1 + q[ROTATION + 2] * d2
        py = q[ROTATION + 3] * d0 + q[ROTATION + 4] * d1 + q[ROTATION + 5] * d2
        pz = q[ROTATION + 6] * d0 + q[ROTATION + 7] * d1 + q[ROTATION + 8] * d2
        seen = (table[PREDICTED, i] > 0) & (pz > 1e-9 * (abs(px) + abs(py)))
        inverse = 1 / (pz if seen else 1.0)
        table[X, i], table[Y, i] = (px if seen else 0.0) * inverse, (py if seen else 0.0) * inverse
        table[PREDICTED, i], table[INVERSE_DEPTH, i] = 1.0 if seen else 0.0, inverse
        table[SCALE, i], table[BEND, i] = 1.0, 0.0
    if q[FISHEYE] > 0:
        _bend_to_angles(table)
    for i in range(CHUNK):
        x, y = table[SCALE, i] * table[X, i], table[SCALE, i] * table[Y, i]
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
        table[IMAGE, i] = fx * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x))
        table[IMAGE + 1, i] = fy * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y)


@_part
def _bend_to_angles(table):
    """A fisheye's lens plane: the radius is the angle to the axis (Kannala & Brandt 2006)."""
    for i in range(CHUNK):
        r2 = table[X, i] * table[X, i] + table[Y, i] * table[Y, i]
        if r2 < 1e-6:
            scale, slope = 1 - r2 / 3 + r2 * r2 / 5, -1.0 / 3 + 2 * r2 / 5
        else:
            r = np.sqrt(r2)
            scale = np.arctan(r) / r
            slope = (1 / (1 + r2) - scale) / (2 * r2)
        table[SCALE, i], table[BEND, i] = scale, 2 * slope


@_part
def _compare(table, begin, end, measured, q):
    for i in range(end - begin):
        table[RESIDUAL, i] = table[IMAGE, i] + q[PRINCIPAL] - measured[begin + i, 0]
        table[RESIDUAL + 1, i] = table[IMAGE + 1, i] + q[PRINCIPAL + 1] - measured[begin + i, 1]


@_part
def _weigh(table, sigma, information, loss, c2):
    """Root weights of iteratively reweighted least squares, 0 where nothing is predicted."""
    for i in range(CHUNK):
        s = (table[RESIDUAL, i] ** 2 + table[RESIDUAL + 1, i] ** 2) / sigma**2
        w = np.sqrt(information * loss_weight(loss, s, c2)) / sigma
        table[ROOT_WEIGHT, i] = w if table[PREDICTED, i] > 0 else 0.0


@_part
def _linearise(table, J, q):
    """Weighted derivatives by the camera's 16 parameters, then the weighted residual and a row of zeros.

    Columns of J (18, 2 CHUNK) are the x of all detections, then the y. The derivative by the point is that by the
    camera's centre with the other sign.
    """
    fx, fy = q[FOCAL], q[FOCAL + 1]
    k1, k2, k3, k4, p1, p2 = q[RADIAL], q[RADIAL + 1], q[RADIAL + 2], q[RADIAL + 3], q[TANGENTIAL], q[TANGENTIAL + 1]
    for i in range(CHUNK):
        j = CHUNK + i
        w, x, y, scale, bend = table[ROOT_WEIGHT, i], table[X, i], table[Y, i], table[SCALE, i], table[BEND, i]
        mx, my = scale * x, scale * y
        r2 = mx * mx + my * my
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
        slope = k1 + r2 * (2 * k2 + r2 * (3 * k3 + 4 * r2 * k4))
        across = 2 * mx * my * slope + 2 * (p1 * mx + p2 * my)
        # By the lens plane.
        xx, xy = w * fx * (radial + 2 * mx * mx * slope + 2 * p1 * my + 6 * p2 * mx), w * fx * across
        yx, yy = w * fy * across, w * fy * (radial + 2 * my * my * slope + 6 * p1 * my + 2 * p2 * mx)
        # By x, y and z of the point in the camera frame, at depth 1.
        outward_x, outward_y = bend * (xx * x + xy * y), bend * (yx * x + yy * y)
        xx, xy = scale * xx + outward_x * x, scale * xy + outward_x * y
        yx, yy = scale * yx + outward_y * x, scale * yy + outward_y * y
        xz, yz = -(xx * x + xy * y), -(yx * x + yy * y)
        # R <- exp(omega) R moves the point by omega x point.
        J[0, i], J[1, i], J[2, i] = xz * y - xy, xx - xz * x, xy * x - xx * y
        J[0, j], J[1, j], J[2, j] = yz * y - yy, yx - yz * x, yy * x - yx * y
        shift_x, shift_y = 0.0, 0.0
        for a in range(3):
            r0, r1, r2_ = q[ROTATION + a], q[ROTATION + 3 + a], q[ROTATION + 6 + a]
            by_point_x = table[INVERSE_DEPTH, i] * (xx * r0 + xy * r1 + xz * r2_)
            by_point_y = table[INVERSE_DEPTH, i] * (yx * r0 + yy * r1 + yz * r2_)
            J[3 + a, i], J[3 + a, j] = -by_point_x, -by_point_y
            shift_x += by_point_x * table[VELOCITY + a, i]
            shift_y += by_point_y * table[VELOCITY + a, i]
        J[6, i], J[7, i], J[8, i] = shift_x, shift_x * table[TAU, i], shift_x * table[ROW, i]
        J[6, j], J[7, j], J[8, j] = shift_y, shift_y * table[TAU, i], shift_y * table[ROW, i]
        J[9, i], J[9, j] = w * table[IMAGE, i], w * table[IMAGE + 1, i]
        J[10, i], J[10, j] = 0.0, w * table[IMAGE + 1, i]
        J[11, i], J[11, j] = w * q[CALIBRATED], 0.0
        J[12, i], J[12, j] = 0.0, w * q[CALIBRATED + 1]
        first_x, first_y = w * fx * mx * r2, w * fy * my * r2
        J[13, i], J[14, i], J[15, i] = first_x, first_x * r2, first_x * r2 * r2
        J[13, j], J[14, j], J[15, j] = first_y, first_y * r2, first_y * r2 * r2
        J[16, i], J[16, j] = w * table[RESIDUAL, i], w * table[RESIDUAL + 1, i]
        J[17, i], J[17, j] = 0.0, 0.0


@_reduction
def _add_camera(H, J):
    """H (18, 18) += J J^T above the diagonal, by blocks of two by two."""
    for a in range(0, 18, 2):
        for b in range(a, 18, 2):
            h00, h01, h10, h11 = 0.0, 0.0, 0.0, 0.0
            for i in range(2 * CHUNK):
                h00 += J[a, i] * J[b, i]
                h01 += J[a, i] * J[b + 1, i]
                h10 += J[a + 1, i] * J[b, i]
                h11 += J[a + 1, i] * J[b + 1, i]
            H[a, b] += h00
            H[a, b + 1] += h01
            H[a + 1, b] += h10
            H[a + 1, b + 1] += h11


@_part
def _take(rows, weights, k, table, J, i):
    """Copy detection i to place k (0 or 1) of a pair: [camera | control | residual] of its x and its y."""
    for b in range(4):
        weights[k, b] = table[BASIS + b, i]
    for axis in range(2):
        r, j = 2 * k + axis, axis * CHUNK + i
        for a in range(16):
            rows[r, a] = J[a, j]
        for b in range(4):
            for a in range(3):
                rows[r, 16 + 3 * b + a] = -weights[k, b] * J[3 + a, j]
        rows[r, 28] = J[16, j]


@_part
def _add_pair(local, rows, weights):
    """Add the products of the 12 control coordinates of two detections with their rows, to local (12, 32)."""
    u0, u1, u2, u3 = weights[0, 0], weights[0, 1], weights[0, 2], weights[0, 3]
    v0, v1, v2, v3 = weights[1, 0], weights[1, 1], weights[1, 2], weights[1, 3]
    for a in range(3):
        p0, p1, p2, p3 = -rows[0, 3 + a], -rows[1, 3 + a], -rows[2, 3 + a], -rows[3, 3 + a]
        for b in range(32):
            u = p0 * rows[0, b] + p1 * rows[1, b]
            v = p2 * rows[2, b] + p3 * rows[3, b]
            local[a, b] += u0 * u + v0 * v
            local[3 + a, b] += u1 * u + v1 * v
            local[6 + a, b] += u2 * u + v2 * v
            local[9 + a, b] += u3 * u + v3 * v


@_part
def _finish_run(local, rows, weights, odd, first, c, coupling, band, gradient):
    """Add what a run of detections gathered to the equations, and clear it."""
    if odd:
        rows[2:] = 0.0
        _add_pair(local, rows, weights)
    for a in range(12):
        for b in range(16):
            coupling[3 * first + a, c, b] += local[a, b]
        for b in range(a, 12):
            band[3 * first + a, b - a] += local[a, 16 + b]
        gradient[3 * first + a] += local[a, 28]
    local[:] = 0.0


@_loop
def predict(camera, tau, row, constants, control, control_of_interval, first_interval, spacing):
    """Projections (n, 2) of all detections; NaN where the state does not predict one."""
    out = np.empty((len(camera), 2))
    table, first = np.zeros((N_ROWS, CHUNK)), np.empty(CHUNK, np.int64)
    begin = np.int64(0)
    while begin < len(camera):
        end, q = _chunk_end(camera, begin), constants[camera[begin]]
        _locate(table, first, begin, end, tau, row, q, control, control_of_interval, first_interval, spacing)
        _project(table, q)
        for i in range(end - begin):
            for axis in range(2):
                out[begin + i, axis] = table[IMAGE + axis, i] + q[PRINCIPAL + axis]
                if table[PREDICTED, i] == 0:
                    out[begin + i, axis] = np.nan
        begin = end
    return out


@_loop
def cost(
    camera, tau, row, constants, control, control_of_interval, first_interval, spacing,
    measured, sigma, information, loss, loss_scale,
):  # fmt: skip
    """Half the sum of the weighted losses; detections that are not predicted count as errors of ten loss scales."""
    total, c2 = 0.0, loss_scale**2
    table, first = np.zeros((N_ROWS, CHUNK)), np.empty(CHUNK, np.int64)
    begin = np.int64(0)
    while begin < len(camera):
        end, c = _chunk_end(camera, begin), camera[begin]
        q = constants[c]
        _locate(table, first, begin, end, tau, row, q, control, control_of_interval, first_interval, spacing)
        _project(table, q)
        _compare(table, begin, end, measured, q)
        for i in range(end - begin):
            s = (table[RESIDUAL, i] ** 2 + table[RESIDUAL + 1, i] ** 2) / sigma[c] ** 2
            total += information[c] * loss_value(loss, s if table[PREDICTED, i] > 0 else UNPREDICTED * c2, c2)
        begin = end
    return 0.5 * total


@_loop
def normal_equations(
    camera, tau, row, constants, control, control_of_interval, first_interval, spacing,
    measured, sigma, information, loss, loss_scale,
):  # fmt: skip
    """Gauss-Newton normal equations of the robust cost.

    Returns camera blocks (c, 16, 16), camera gradient (c, 16), coupling (3 m, c, 16), the spline's band (3 m, 12),
    entry [i, d] coupling coordinates i and i + d, and the spline's gradient (3 m,).
    """
    n_cameras, n = len(constants), 3 * len(control)
    blocks, coupling = np.zeros((n_cameras, 18, 18)), np.zeros((n, n_cameras, 16))
    band, gradient = np.zeros((n, 12)), np.zeros(n)
    table, first = np.zeros((N_ROWS, CHUNK)), np.empty(CHUNK, np.int64)
    J = np.empty((18, 2 * CHUNK))
    rows, weights, local = np.zeros((4, 32)), np.zeros((2, 4)), np.zeros((12, 32))
    begin = np.int64(0)
    while begin < len(camera):
        end, c = _chunk_end(camera, begin), camera[begin]
        q = constants[c]
        _locate(table, first, begin, end, tau, row, q, control, control_of_interval, first_interval, spacing)
        _project(table, q)
        _compare(table, begin, end, measured, q)
        _weigh(table, sigma[c], information[c], loss, loss_scale**2)
        _linearise(table, J, q)
        _add_camera(blocks[c], J)
        run, held = np.int64(-1), np.int64(0)
        for i in range(end - begin):
            if first[i] != run:
                if run >= 0:
                    _finish_run(local, rows, weights, held == 1, run, c, coupling, band, gradient)
                run, held = first[i], np.int64(0)
            if run >= 0:
                _take(rows, weights, held, table, J, i)
                held += 1
                if held == 2:
                    _add_pair(local, rows, weights)
                    held = np.int64(0)
        if run >= 0:
            _finish_run(local, rows, weights, held == 1, run, c, coupling, band, gradient)
        begin = end
    for c in range(n_cameras):
        for a in range(16):
            for b in range(a):
                blocks[c, a, b] = blocks[c, b, a]
    return blocks[:, :16, :16].copy(), blocks[:, :16, 16].copy(), coupling, band, gradient
