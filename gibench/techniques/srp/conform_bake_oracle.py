"""What SRP's bake is held against: transport of a receiver by direct evaluation in float64."""

from __future__ import annotations

import numpy as np

from gibench.arrays import Array
from gibench.scene.model import Scene
from gibench.techniques.srp.bake.data import ProbeSet
from gibench.techniques.srp.bake.sh import sh_basis
from gibench.techniques.srp.bake.transport import TransportBaker
from gibench.techniques.srp.bake.weights import spatial_weight


def intersect(corners: Array, origins: Array, directions: Array) -> Array:
    """Moeller and Trumbore 1997 in float64: distances (n, t), inf where missed."""
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = np.cross(directions[:, None], e2[None])
    det = (p * e1).sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = origins[:, None] - corners[None, :, 0]
        u = (s * p).sum(axis=-1) / det
        q = np.cross(s, e1[None])
        v = (q * directions[:, None]).sum(axis=-1) / det
        t = (q * e2).sum(axis=-1) / det
    inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-9) & (np.abs(det) > 1e-14)
    return np.asarray(np.where(inside, t, np.inf))


def order_1(directions: Array, normal: Array) -> Array:
    """What samples (s, 3) of density (1 + 2 cosine) / 4 pi about ``normal`` weigh in units of pi:
    (s, 4) for irradiance at the normal and its gradient, by radiance in spherical harmonics and the
    constants of the convolution with the clamped cosine (Ramamoorthi and Hanrahan 2001).
    """
    cosine = directions @ normal
    convolved = sh_basis(1, directions) * [np.pi, *[2 * np.pi / 3] * 3]
    convolved /= (1 + 2 * cosine)[:, None] / (4 * np.pi)

    def at(normals: Array) -> Array:
        return np.asarray(convolved @ sh_basis(1, normals).T / np.pi)

    axes = np.eye(3)
    return np.concatenate([at(normal[None]), (at(axes) - at(-axes)) / 2], axis=1)


def brute_force(
    scene: Scene,
    probes: ProbeSet,
    receiver: Array,
    origins: Array,
    directions: Array,
    order: int,
    normal: Array | None = None,
) -> tuple[Array, int] | None:
    """Eq. 5.6 for one receiver and its sample rays: (p, c) float64 and the valid samples; (4, p, c)
    with a ``normal``, for receivers of order 1.

    None for a receiver one of whose rays grazes an edge so closely that lifting its target by
    2e-5 m off its surface changes what is seen: the bake lifts targets by half of that.
    """
    corners = scene.corners.astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    started = (directions**2).sum(axis=1) > 0.5
    o, d = origins[started].astype(np.float64), directions[started].astype(np.float64)
    t = intersect(corners, o, d)
    struck, distance = t.argmin(axis=1), t.min(axis=1)
    escaped = np.isinf(distance)
    faced = (normals[struck] * d).sum(axis=1) < 0
    hit = o + np.where(escaped, 0.0, distance)[:, None] * d
    p = probes.positions.astype(np.float64)
    weight = spatial_weight(np.linalg.norm(receiver - p, axis=1) / probes.radius)
    visible = np.zeros((len(p), len(o)), bool)
    phi = np.empty((len(p), len(o), 3))
    for i in range(len(p)):
        toward = np.where(escaped[:, None], d, hit - p[i])
        phi[i] = toward / np.linalg.norm(toward, axis=1, keepdims=True)
        t = intersect(corners, np.broadcast_to(p[i], o.shape), toward)
        unit = normals[struck] / np.linalg.norm(normals[struck], axis=1, keepdims=True)
        lifted = toward + np.where(escaped, 0.0, 2e-5)[:, None] * unit
        again = intersect(corners, np.broadcast_to(p[i], o.shape), lifted)
        if ((t < 1 - 1e-4).any(axis=1) != (again < 1 - 1e-4).any(axis=1)).any():
            return None
        in_front = (normals[struck] * (p[i] - hit)).sum(axis=1) > 0
        # Whatever lies before the hit point itself.
        seen = faced & in_front & ~(t < 1 - 1e-6).any(axis=1)
        visible[i] = np.where(escaped, ~np.isfinite(t).any(axis=1), seen)
    share = weight[:, None] * visible
    total = share.sum(axis=0)
    kernel = np.divide(share, total, out=np.zeros_like(share), where=total > 0)
    valid = int((total > 0).sum())
    basis = sh_basis(order, phi.reshape(-1, 3)).reshape(*phi.shape[:2], -1)
    scale = np.pi / max(valid, 1)
    if normal is not None:
        return scale * np.einsum("ps,sk,psc->kpc", kernel, order_1(d, normal), basis), valid
    return scale * np.einsum("ps,psc->pc", kernel, basis), valid


def primary_rays(baker: TransportBaker, receivers: Array) -> tuple[Array, Array, Array]:
    """Origins and directions (m, s, 3) of the primary rays of ``receivers`` (m,), and which samples
    (m, s) float32 knows to 1e-5: not those whose first number is so near its ends that its root is
    known less well, nor those at a border between two pieces of a texel's surface, or on a piece's
    first corner, nor those that all but graze it.
    """
    held = baker.lightmap
    read, count = baker.device.read, baker.settings.transport_rays
    points = read(baker.shared["points"]).astype(np.float64)[:count]
    rotations = read(baker.shared["rotations"]).astype(np.float64)[receivers]
    share = read(baker.shared["fragment_share"]).astype(np.float64)
    planes = read(baker.shared["planes"]).astype(np.float64)[:, :3]
    u = (points[None, :, [0, 3, 4]] + rotations[:, None, [0, 3, 4]]) % 1.0
    turned = (points[None, :, 1] + 1j * points[None, :, 2]) * (
        rotations[:, None, 1] + 1j * rotations[:, None, 2]
    )
    origins = np.zeros((len(receivers), count, 3))
    directions, certain = np.zeros_like(origins), np.ones(origins.shape[:2], bool)
    for i, receiver in enumerate(receivers):
        n = held.receivers.normal[receiver].astype(np.float64)
        t, b = _basis(n)
        cosine = np.sqrt(1 - u[i, :, 0])
        if baker.components > 1:
            cosine = (np.sqrt(9 - 8 * u[i, :, 0]) - 1) / 2
        radius = np.sqrt(np.maximum(1 - cosine**2, 0))
        directions[i] = (radius * turned[i].real)[:, None] * t
        directions[i] += (radius * turned[i].imag)[:, None] * b + cosine[:, None] * n
        first, last = held.fragments.start[receiver : receiver + 2]
        ends = share[first:last]
        piece = np.minimum(np.searchsorted(ends, u[i, :, 1], "right"), last - first - 1)
        below = np.concatenate([[0], ends])[piece]
        rest = np.clip((u[i, :, 1] - below) / (ends[piece] - below), 0, 1)
        corners = held.fragments.corners[first + piece].astype(np.float64)
        a, w = np.sqrt(rest), u[i, :, 2]
        weights = np.stack([1 - a, a * (1 - w), a * w], axis=1)
        surface = planes[held.fragments.triangle[first + piece]]
        origins[i] = np.einsum("sk,skx->sx", weights, corners) + baker.offset * surface
        facing = (directions[i] * surface).sum(axis=1)
        directions[i, facing <= 0] = 0
        apart = np.abs(u[i, :, 1, None] - np.concatenate([[0], ends])).min(axis=1)
        ends_of = np.minimum(u[i], 1 - u[i]).min(axis=1)
        certain[i] = (ends_of > 1e-3) & (apart > 1e-3) & (np.abs(facing) > 1e-5)
    return origins, directions, certain


def _basis(n: Array) -> tuple[Array, Array]:
    """Duff et al. 2017, listing 3."""
    s = np.copysign(1.0, n[2])
    a = -1 / (s + n[2])
    c = n[0] * n[1] * a
    t = np.array([1 + s * n[0] ** 2 * a, s * c, -s * n[0]])
    return t, np.array([c, s + n[1] ** 2 * a, -n[1]])
