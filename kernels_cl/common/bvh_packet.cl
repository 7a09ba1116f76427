// PACKET coherent rays (8 or 16, a vector of the device) at a time through the tree of
// common/bvh.cl: primary rays of a tile of pixels, shadow rays of neighbouring texels. For
// processors with wide vectors.
//
// Boxes are tested once for the whole packet, 8 at a time, with the intervals of its origins and
// inverse directions (Boulos, Wald and Shirley 2006, "Geometric and Arithmetic Culling Methods for
// Entire Ray Packets"); triangles one at a time, all rays at once, by the same watertight test as for
// single rays with one shear axis for all. Results are those of single rays up to rounding whatever
// the rays are; they are fast only where rays start and head alike. A packet whose directions
// differ in sign on an axis, or have no long axis in common, is traced ray by ray, and one that has
// spent BVH_PACKET_BUDGET goes on ray by ray: its bounds hold too much besides its rays.
#ifndef GIBENCH_BVH_PACKET
#define GIBENCH_BVH_PACKET

#include "common/bvh.cl"

#include "common/vec_width.cl"

typedef VEC_JOIN(float, PACKET) pfloat;
typedef VEC_JOIN(int, PACKET) pint;
#define pload(i, p) VEC_JOIN(vload, PACKET)(i, p)
#define pstore(v, i, p) VEC_JOIN(vstore, PACKET)(v, i, p)

// What a packet may spend, a node counting 1 and a block of triangles 4 (their times, measured on
// PoCL). Sixteen single primary rays in Sponza spend about 400 in these units.
#define BVH_PACKET_BUDGET (10 * PACKET)

typedef struct {
    pfloat t;
    pfloat u;
    pfloat v;
    pint triangle;
} HitPacket;

typedef struct {
    // Per axis: the origins' bounds that make entry early and exit late, least and greatest inverse.
    float3 origin_near, origin_far;
    float3 inverse_low, inverse_high;
    int near_x, near_y, near_z;
    int kx, ky, kz;
    pfloat ox, oy, oz;
    pfloat sx, sy, sz;
} BvhPacket;

inline float bvh_least(pfloat a)
{
#if PACKET == 16
    const float8 *halves = (const float8 *)&a;
    const float8 b = bvh_min8(halves[0], halves[1]);
#else
    const float8 b = a;
#endif
    const float4 *quarters = (const float4 *)&b;
    const float4 c = quarters[0] < quarters[1] ? quarters[0] : quarters[1];
    const float d = c.x < c.y ? c.x : c.y;
    const float e = c.z < c.w ? c.z : c.w;
    return d < e ? d : e;
}

inline float bvh_greatest(pfloat a)
{
    return -bvh_least(-a);
}

inline uint bvh_lanes(pint lanes)
{
#if PACKET == 16
    const int8 *halves = (const int8 *)&lanes;
    return bvh_mask(halves[0]) | (bvh_mask(halves[1]) << 8);
#else
    return bvh_mask(lanes);
#endif
}

// Bounds of one axis; false where directions differ in sign or vanish.
inline bool bvh_axis(pfloat o, pfloat d, float *origin_near, float *origin_far,
                     float *inverse_low, float *inverse_high)
{
    const float low = bvh_least(d), high = bvh_greatest(d);
    const bool backwards = high < 0.0f;
    *origin_near = backwards ? bvh_least(o) : bvh_greatest(o);
    *origin_far = backwards ? bvh_greatest(o) : bvh_least(o);
    // Divided with the rounding of either side covered: 1 ulp is far less than 4e-7.
    *inverse_low = 1.0f / high * (backwards ? 1.0000004f : 0.9999996f);
    *inverse_high = 1.0f / low * (backwards ? 0.9999996f : 1.0000004f);
    return (low > 1e-18f || high < -1e-18f);
}

// Sets the packet up; false where it must be traced ray by ray.
inline bool bvh_packet(pfloat ox, pfloat oy, pfloat oz, pfloat dx, pfloat dy, pfloat dz,
                       BvhPacket *p)
{
    float nx, ny, nz, fx, fy, fz, lx, ly, lz, hx, hy, hz;
    bool fit = bvh_axis(ox, dx, &nx, &fx, &lx, &hx);
    fit &= bvh_axis(oy, dy, &ny, &fy, &ly, &hy);
    fit &= bvh_axis(oz, dz, &nz, &fz, &lz, &hz);
    p->origin_near = (float3)(nx, ny, nz), p->origin_far = (float3)(fx, fy, fz);
    p->inverse_low = (float3)(lx, ly, lz), p->inverse_high = (float3)(hx, hy, hz);
    p->near_x = lx < 0.0f ? 8 : 0;
    p->near_y = ly < 0.0f ? 24 : 16;
    p->near_z = lz < 0.0f ? 40 : 32;
    const pfloat ax = dx < 0.0f ? -dx : dx, ay = dy < 0.0f ? -dy : dy, az = dz < 0.0f ? -dz : dz;
    const pfloat yz = ay > az ? ay : az, xz = ax > az ? ax : az, xy = ax > ay ? ax : ay;
    // A shear axis shorter than half of the longest one would cost precision.
    if (bvh_lanes(ax * 2.0f < yz) == 0) {
        p->kx = 8, p->ky = 16, p->kz = 0;
        p->ox = oy, p->oy = oz, p->oz = ox;
        p->sz = 1.0f / dx;
        p->sx = dy * p->sz, p->sy = dz * p->sz;
    } else if (bvh_lanes(ay * 2.0f < xz) == 0) {
        p->kx = 16, p->ky = 0, p->kz = 8;
        p->ox = oz, p->oy = ox, p->oz = oy;
        p->sz = 1.0f / dy;
        p->sx = dz * p->sz, p->sy = dx * p->sz;
    } else if (bvh_lanes(az * 2.0f < xy) == 0) {
        p->kx = 0, p->ky = 8, p->kz = 16;
        p->ox = ox, p->oy = oy, p->oz = oz;
        p->sz = 1.0f / dz;
        p->sx = dx * p->sz, p->sy = dy * p->sz;
    } else {
        fit = false;
    }
    return fit;
}

inline float8 bvh_enter(__global const float *bounds, float origin, float low, float high)
{
    const float8 b = bvh_load8(bounds) - origin;
    return bvh_min8(b * low, b * high);
}

inline float8 bvh_leave(__global const float *bounds, float origin, float low, float high)
{
    const float8 b = bvh_load8(bounds) - origin;
    return bvh_max8(b * low, b * high);
}

// Which boxes any ray may meet before t_max; no ray enters before `entry`.
inline uint bvh_packet_boxes(__global const float *node, const BvhPacket *p, float t_max,
                             float8 *entry)
{
    const float3 near = p->origin_near, far = p->origin_far;
    const float3 low = p->inverse_low, high = p->inverse_high;
    const float8 nx = bvh_enter(node + p->near_x, near.x, low.x, high.x);
    const float8 ny = bvh_enter(node + p->near_y, near.y, low.y, high.y);
    const float8 nz = bvh_enter(node + p->near_z, near.z, low.z, high.z);
    const float8 fx = bvh_leave(node + (p->near_x ^ 8), far.x, low.x, high.x);
    const float8 fy = bvh_leave(node + (p->near_y ^ 8), far.y, low.y, high.y);
    const float8 fz = bvh_leave(node + (p->near_z ^ 8), far.z, low.z, high.z);
    const float8 enter = bvh_max8(bvh_max8(nx, ny), bvh_max8(nz, (float8)(0.0f)));
    const float8 leave = bvh_min8(bvh_min8(fx, fy), bvh_min8(fz, (float8)(t_max))) * 1.0000004f;
    *entry = enter;
    return bvh_mask(enter <= leave);
}

inline pfloat bvh_edge_packet(pfloat a, pfloat b, pfloat c, pfloat d)
{
#pragma OPENCL FP_CONTRACT OFF
    const pfloat p = a * b;
    const pfloat q = c * d;
    return p - q;
}

// Which rays hit the triangle whose corner 0 is at `corner` in a block, in (0, t_max).
inline pint bvh_packet_triangle(__global const float *corner, const BvhPacket *p, pfloat t_max,
                                 pfloat *t, pfloat *u, pfloat *v)
{
    const pfloat az = corner[p->kz] - p->oz;
    const pfloat bz = corner[24 + p->kz] - p->oz;
    const pfloat cz = corner[48 + p->kz] - p->oz;
    const pfloat ax = (corner[p->kx] - p->ox) - p->sx * az;
    const pfloat bx = (corner[24 + p->kx] - p->ox) - p->sx * bz;
    const pfloat cx = (corner[48 + p->kx] - p->ox) - p->sx * cz;
    const pfloat ay = (corner[p->ky] - p->oy) - p->sy * az;
    const pfloat by = (corner[24 + p->ky] - p->oy) - p->sy * bz;
    const pfloat cy = (corner[48 + p->ky] - p->oy) - p->sy * cz;
    const pfloat e0 = bvh_edge_packet(cx, by, cy, bx);
    const pfloat e1 = bvh_edge_packet(ax, cy, ay, cx);
    const pfloat e2 = bvh_edge_packet(bx, ay, by, ax);
    const pint inside = ((e0 >= 0.0f) & (e1 >= 0.0f) & (e2 >= 0.0f))
        | ((e0 <= 0.0f) & (e1 <= 0.0f) & (e2 <= 0.0f));
    if (bvh_lanes(inside) == 0)
        return inside;
    const pfloat det = e0 + e1 + e2;
    const pfloat inverse = 1.0f / det;
    const pfloat distance = (e0 * az + e1 * bz + e2 * cz) * p->sz * inverse;
    *t = distance;
    *u = e1 * inverse;
    *v = e2 * inverse;
    return inside & (distance > 0.0f) & (distance < t_max) & (det != 0.0f);
}

#if CUTOUTS
// Which of the rays that hit `triangle` do so where it is there.
inline pint bvh_packet_there(pint hit, int triangle, const pfloat *u, const pfloat *v CUTOUT_PARAM)
{
    if (bvh_lanes(hit) == 0 || cutouts[triangle] == 0)
        return hit;
    float us[PACKET], vs[PACKET];
    int lanes[PACKET];
    pstore(*u, 0, us), pstore(*v, 0, vs), pstore(hit, 0, lanes);
    for (int i = 0; i < PACKET; i++)
        if (lanes[i])
            lanes[i] = -(int)!cut_away(cutouts, triangle, us[i], vs[i]);
    return pload(0, lanes);
}
#endif

inline HitPacket bvh_closest_singly(BVH_PARAMS, pfloat ox, pfloat oy, pfloat oz, pfloat dx,
                                pfloat dy, pfloat dz, pfloat t_max)
{
    float o[3][PACKET], d[3][PACKET], limit[PACKET], t[PACKET], u[PACKET], v[PACKET];
    int triangle[PACKET];
    pstore(ox, 0, o[0]), pstore(oy, 0, o[1]), pstore(oz, 0, o[2]);
    pstore(dx, 0, d[0]), pstore(dy, 0, d[1]), pstore(dz, 0, d[2]);
    pstore(t_max, 0, limit);
    for (int i = 0; i < PACKET; i++) {
        Hit hit = {INFINITY, 0.0f, 0.0f, -1};
        if (limit[i] > 0.0f)
            hit = bvh_closest(BVH_ARGS, (float3)(o[0][i], o[1][i], o[2][i]),
                              (float3)(d[0][i], d[1][i], d[2][i]), limit[i]);
        t[i] = hit.t, u[i] = hit.u, v[i] = hit.v, triangle[i] = hit.triangle;
    }
    HitPacket hits;
    hits.t = pload(0, t), hits.u = pload(0, u), hits.v = pload(0, v);
    hits.triangle = pload(0, triangle);
    return hits;
}

inline pint bvh_occluded_singly(BVH_PARAMS, pfloat ox, pfloat oy, pfloat oz, pfloat dx,
                                 pfloat dy, pfloat dz, pfloat t_max)
{
    float o[3][PACKET], d[3][PACKET], limit[PACKET];
    int blocked[PACKET];
    pstore(ox, 0, o[0]), pstore(oy, 0, o[1]), pstore(oz, 0, o[2]);
    pstore(dx, 0, d[0]), pstore(dy, 0, d[1]), pstore(dz, 0, d[2]);
    pstore(t_max, 0, limit);
    for (int i = 0; i < PACKET; i++)
        blocked[i] = -(int)(limit[i] > 0.0f
                            && bvh_occluded(BVH_ARGS, (float3)(o[0][i], o[1][i], o[2][i]),
                                            (float3)(d[0][i], d[1][i], d[2][i]), limit[i]));
    return pload(0, blocked);
}

// Closest hits of PACKET rays at distances in (0, t_max); t_max <= 0 leaves a ray out.
inline HitPacket bvh_closest_packet(BVH_PARAMS, pfloat ox, pfloat oy, pfloat oz, pfloat dx,
                                pfloat dy, pfloat dz, pfloat t_max)
{
    BvhPacket p;
    // Counted, every ray goes alone.
    if (BVH_COUNTS || !bvh_packet(ox, oy, oz, dx, dy, dz, &p))
        return bvh_closest_singly(BVH_ARGS, ox, oy, oz, dx, dy, dz, t_max);
    HitPacket hits;
    hits.t = INFINITY, hits.u = 0.0f, hits.v = 0.0f, hits.triangle = -1;
    pfloat limits = t_max;
    float limit = bvh_greatest(limits);
    int nodes[BVH_STACK];
    float distances[BVH_STACK];
    int top = 0;
    int current = 0;
    int budget = BVH_PACKET_BUDGET;
    while (true) {
        while (current >= 0) {
            budget--;
            __global const float *node = bvh_nodes + (size_t)current * BVH_NODE_FLOATS;
            float8 entry;
            const uint mask = bvh_packet_boxes(node, &p, limit, &entry);
            current = mask ? bvh_push(node, mask, entry, nodes, distances, &top) : INT_MIN;
        }
        if (current != INT_MIN) {
            const uint leaf = (uint)~current;
            __global const float *block = bvh_triangles + (size_t)(leaf >> 2) * BVH_BLOCK_FLOATS;
            __global const float *end = block + ((leaf & 3) + 1) * BVH_BLOCK_FLOATS;
            for (; block != end; block += BVH_BLOCK_FLOATS) {
                __global const int *ids = (__global const int *)(block + 72);
                budget -= 4;
                for (int i = 0; i < 8 && ids[i] >= 0; i++) {
                    pfloat t, u, v;
#if CUTOUTS
                    const pint hit
                        = bvh_packet_there(bvh_packet_triangle(block + i, &p, limits, &t, &u, &v),
                                           ids[i], &u, &v CUTOUT_ARG);
#else
                    const pint hit = bvh_packet_triangle(block + i, &p, limits, &t, &u, &v);
#endif
                    if (bvh_lanes(hit)) {
                        hits.t = hit ? t : hits.t;
                        hits.u = hit ? u : hits.u;
                        hits.v = hit ? v : hits.v;
                        hits.triangle = hit ? (pint)(ids[i]) : hits.triangle;
                        limits = hit ? t : limits;
                        limit = bvh_greatest(limits);
                    }
                }
            }
        }
        do {
            if (top == 0)
                return hits;
            top--;
        } while (distances[top] >= limit);
        if (budget < 0) {
            const HitPacket nearer
                = bvh_closest_singly(BVH_ARGS, ox, oy, oz, dx, dy, dz, limits);
            const pint found = nearer.triangle >= 0;
            hits.t = found ? nearer.t : hits.t;
            hits.u = found ? nearer.u : hits.u;
            hits.v = found ? nearer.v : hits.v;
            hits.triangle = found ? nearer.triangle : hits.triangle;
            return hits;
        }
        current = nodes[top];
    }
}

// Whether anything is hit at a distance in (0, t_max), -1 or 0 for each of PACKET rays; t_max <= 0
// leaves a ray out.
inline pint bvh_occluded_packet(BVH_PARAMS, pfloat ox, pfloat oy, pfloat oz, pfloat dx,
                                 pfloat dy, pfloat dz, pfloat t_max)
{
    BvhPacket p;
    // Counted, every ray goes alone.
    if (BVH_COUNTS || !bvh_packet(ox, oy, oz, dx, dy, dz, &p))
        return bvh_occluded_singly(BVH_ARGS, ox, oy, oz, dx, dy, dz, t_max);
    pint blocked = 0;
    pfloat limits = t_max; // of rays still open; blocked ones have 0
    float limit = bvh_greatest(limits);
    int nodes[BVH_STACK];
    float distances[BVH_STACK];
    int top = 0;
    int current = limit > 0.0f ? 0 : INT_MIN;
    int budget = BVH_PACKET_BUDGET;
    while (true) {
        while (current >= 0) {
            budget--;
            __global const float *node = bvh_nodes + (size_t)current * BVH_NODE_FLOATS;
            float8 entry;
            const uint mask = bvh_packet_boxes(node, &p, limit, &entry);
            current = mask ? bvh_push(node, mask, entry, nodes, distances, &top) : INT_MIN;
        }
        if (current != INT_MIN) {
            const uint leaf = (uint)~current;
            __global const float *block = bvh_triangles + (size_t)(leaf >> 2) * BVH_BLOCK_FLOATS;
            __global const float *end = block + ((leaf & 3) + 1) * BVH_BLOCK_FLOATS;
            for (; block != end; block += BVH_BLOCK_FLOATS) {
                __global const int *ids = (__global const int *)(block + 72);
                budget -= 4;
                for (int i = 0; i < 8 && ids[i] >= 0; i++) {
                    pfloat t, u, v;
#if CUTOUTS
                    const pint hit
                        = bvh_packet_there(bvh_packet_triangle(block + i, &p, limits, &t, &u, &v),
                                           ids[i], &u, &v CUTOUT_ARG);
#else
                    const pint hit = bvh_packet_triangle(block + i, &p, limits, &t, &u, &v);
#endif
                    if (bvh_lanes(hit)) {
                        blocked |= hit;
                        limits = hit ? (pfloat)(0.0f) : limits;
                        limit = bvh_greatest(limits);
                        if (limit <= 0.0f)
                            return blocked;
                    }
                }
            }
        }
        do {
            if (top == 0)
                return blocked;
            top--;
        } while (distances[top] >= limit);
        if (budget < 0)
            return blocked | bvh_occluded_singly(BVH_ARGS, ox, oy, oz, dx, dy, dz, limits);
        current = nodes[top];
    }
}

#endif
