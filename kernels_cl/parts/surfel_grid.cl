// The acceleration grid: which cell a point lies in and which cells a surfel reaches.
//
// Uniform (Ekberg 2022, section 4.2): GRID_X * GRID_Y * GRID_Z cubes; points outside belong to the
// nearest cell at the border.
//   grid: 0-2 lower corner, m; 3 cell size, m; 4 its inverse
// Perspective (GRID_PERSPECTIVE; Brinck et al. 2021, "Global Illumination Based on Surfels";
// Ekberg 2022, figure 3.2): around the camera a cube of GRID_N^3 cubes; beyond it six pyramids, one per face
// of the cube, cut sideways by GRID_N^2 planes through the camera and in depth into GRID_SLICES
// slices that grow by a constant factor, so that a cell grows with its distance.
//   grid: 0-2 the camera, m; 3 half the cube's side, m; 4 cells per metre in the cube;
//         5 slices per unit of log(depth)
#ifndef GIBENCH_SURFEL_GRID
#define GIBENCH_SURFEL_GRID

#include "common/vec.cl"

// packed: eleven rows of PACKED_STRIDE floats, an entry of the grid's lists per column:
// position, normal, 1 / radius, irradiance, least mean depth. Beyond the entries there is room for one
// vector, PACKED_PADDING.
#define PACKED_STRIDE (ENTRIES + PACKED_PADDING)
#define PACKED_RADIUS 6
#define PACKED_IRRADIANCE 7
#define PACKED_NEAREST 10

// NORMAL_STRETCH: a surfel's extent along its normal is its radius over this, the Mahalanobis metric's
// stretch.
// ALL_NEIGHBOURS 1: a surfel goes into its cell and all neighbours (Ekberg 2022, section 4.2.1). 0: only
// into cells that its ellipsoid may reach.

// A box of cells of one region of the grid, ends included.
typedef struct {
    int3 first, last;
    int columns, rows; // of the region
    int base;          // the region's first cell
} GridBox;

inline int grid_index(const GridBox *box, int3 at)
{
    return box->base + (at.z * box->rows + at.y) * box->columns + at.x;
}

// x rounded down, within 0 to count - 1; 0 for NaN. (Oclgrind 21.10 crashes on convert_int_sat of a
// scalar when it looks for uninitialised values.)
inline int grid_rounded(float x, int count)
{
    return x >= 0.0f ? (x < count ? (int)x : count - 1) : 0;
}

#if GRID_PERSPECTIVE

#define GRID_REGIONS 7
#define GRID_CELLS (GRID_N * GRID_N * (GRID_N + 6 * GRID_SLICES))

inline int grid_slice(__global const float *grid, float depth)
{
    return grid_rounded(log(depth / grid[3]) * grid[5], GRID_SLICES);
}

inline int grid_column(float u)
{
    return grid_rounded((u + 1.0f) * (0.5f * GRID_N), GRID_N);
}

// The cell of the cube around the camera that `from_corner` lies in or next to.
inline int3 grid_cube(float3 from_corner, float cells_per_metre)
{
    const int3 at = convert_int3_sat(floor(from_corner * cells_per_metre));
    return clamp(at, (int3)(0), (int3)(GRID_N - 1));
}

// `p` with the axis of pyramid `face` (0-1: x, 2-3: y, 4-5: z; odd: negative) in z.
inline float3 grid_turned(int face, float3 p)
{
    const float3 t = face < 2 ? p.yzx : face < 4 ? p.zxy : p;
    return (float3)(t.x, t.y, face & 1 ? -t.z : t.z);
}

inline GridBox grid_region(int region)
{
    GridBox box;
    box.columns = GRID_N;
    box.rows = GRID_N;
    box.base = region == 0 ? 0 : GRID_N * GRID_N * (GRID_N + (region - 1) * GRID_SLICES);
    return box;
}

inline int grid_cell(__global const float *grid, float3 position)
{
    const float3 p = position - load3(grid, 0);
    const float3 a = fabs(p);
    const float depth = fmax(a.x, fmax(a.y, a.z));
    if (depth < grid[3]) {
        const GridBox box = grid_region(0);
        return grid_index(&box, grid_cube(p + grid[3], grid[4]));
    }
    int face = a.x == depth ? 0 : a.y == depth ? 2 : 4;
    face += (face == 0 ? p.x : face == 2 ? p.y : p.z) < 0.0f;
    const float3 t = grid_turned(face, p);
    const GridBox box = grid_region(1 + face);
    const int3 at = (int3)(grid_column(t.x / depth), grid_column(t.y / depth),
                           grid_slice(grid, depth));
    return grid_index(&box, at);
}

// The cells of `region` that the box position +- extent may reach; false when there are none.
inline bool grid_box(__global const float *grid, int region, float3 position, float3 extent,
                     GridBox *box)
{
    const float3 p = position - load3(grid, 0);
    const float3 low = p - extent, high = p + extent;
    const float half_side = grid[3];
    *box = grid_region(region);
    if (region == 0) {
        if (any(low >= half_side) || any(high <= -half_side))
            return false;
        box->first = grid_cube(low + half_side, grid[4]);
        box->last = grid_cube(high + half_side, grid[4]);
        return true;
    }
    const float3 a = grid_turned(region - 1, low), b = grid_turned(region - 1, high);
    const float3 from = fmin(a, b), to = fmax(a, b);
    if (to.z < half_side)
        return false;
    const float near = fmax(from.z, half_side), far = to.z;
    // The sideways coordinate is u = x / depth with depth in [near, far].
    const float2 u_low = from.xy / select((float2)(far), (float2)(near), from.xy < 0.0f);
    const float2 u_high = to.xy / select((float2)(near), (float2)(far), to.xy < 0.0f);
    if (any(u_high < -1.0f) || any(u_low > 1.0f))
        return false;
    box->first = (int3)(grid_column(u_low.x), grid_column(u_low.y), grid_slice(grid, near));
    box->last = (int3)(grid_column(u_high.x), grid_column(u_high.y), grid_slice(grid, far));
    return true;
}

#else

#define GRID_REGIONS 1
#define GRID_CELLS (GRID_X * GRID_Y * GRID_Z)

inline int3 grid_coordinates(__global const float *grid, float3 position)
{
    const int3 at = convert_int3_sat(floor((position - load3(grid, 0)) * grid[4]));
    return clamp(at, (int3)(0), (int3)(GRID_X - 1, GRID_Y - 1, GRID_Z - 1));
}

inline GridBox grid_region(int region)
{
    GridBox box;
    box.columns = GRID_X;
    box.rows = GRID_Y;
    box.base = 0;
    return box;
}

inline int grid_cell(__global const float *grid, float3 position)
{
    const GridBox box = grid_region(0);
    return grid_index(&box, grid_coordinates(grid, position));
}

inline bool grid_box(__global const float *grid, int region, float3 position, float3 extent,
                     GridBox *box)
{
    *box = grid_region(region);
#if ALL_NEIGHBOURS
    const int3 at = grid_coordinates(grid, position);
    box->first = max(at - 1, (int3)(0));
    box->last = min(at + 1, (int3)(GRID_X - 1, GRID_Y - 1, GRID_Z - 1));
#else
    box->first = grid_coordinates(grid, position - extent);
    box->last = grid_coordinates(grid, position + extent);
#endif
    return true;
}

#endif

// Runs `statement` with `cell` set to every cell a surfel goes into, always in the same order.
//
// Of the cells in the box of the surfel's ellipsoid only those are taken that the ellipsoid's slab
// along its normal reaches: in a row of cubes along x these are neighbours, from one bound to the
// other. Cells at the border are taken always, since all that lies outside belongs to them, and so
// are those of the pyramids.
#define GRID_FOR_EACH(grid, position, normal, radius, cell, statement)                         \
    for (int region_ = 0; region_ < GRID_REGIONS; ++region_) {                                 \
        GridBox box_;                                                                          \
        const float3 extent_ = grid_extent(normal, radius);                                    \
        if (!grid_box(grid, region_, position, extent_, &box_))                                \
            continue;                                                                          \
        const GridSlab slab_ = grid_slab(grid, region_, position, normal, radius);             \
        for (int z_ = box_.first.z; z_ <= box_.last.z; ++z_)                                   \
            for (int y_ = box_.first.y; y_ <= box_.last.y; ++y_) {                             \
                const int2 row_ = grid_row(&slab_, &box_, y_, z_);                             \
                const int first_ = box_.base + (z_ * box_.rows + y_) * box_.columns;           \
                for (int cell = first_ + row_.x; cell <= first_ + row_.y; ++cell) {            \
                    statement;                                                                 \
                }                                                                              \
            }                                                                                  \
    }

// Half the box around what a surfel reaches, widened against rounding.
inline float3 grid_extent(float3 normal, float radius)
{
#if ALL_NEIGHBOURS
    return (float3)(radius);
#else
    const float3 along = (radius / NORMAL_STRETCH) * normal;
    return sqrt(fmax(radius * radius * (1.0f - normal * normal), 0.0f) + along * along) * 1.0001f;
#endif
}

// The slab in units of a region's cubes: cube (x, y, z) is reached when |at + dot(step, (x, y, z))|
// <= reach.
typedef struct {
    float3 step;
    float at, reach, inverse;
} GridSlab;

inline GridSlab grid_slab(__global const float *grid, int region, float3 position, float3 normal,
                          float radius)
{
    GridSlab slab;
    slab.step = normal;
#if ALL_NEIGHBOURS
    slab.reach = INFINITY;
    slab.at = 0.0f;
#else
#if GRID_PERSPECTIVE
    const float3 corner = load3(grid, 0) - grid[3];
#else
    const float3 corner = load3(grid, 0);
#endif
    const float3 n = fabs(normal);
    const float reach = radius / NORMAL_STRETCH * grid[4] + 0.5f * (n.x + n.y + n.z);
    slab.reach = region == 0 ? reach * 1.0001f + 1e-4f : INFINITY;
    slab.at = dot((corner - position) * grid[4] + 0.5f, normal);
#endif
    slab.inverse = 1.0f / copysign(fmax(fabs(normal.x), 1e-6f), normal.x);
    return slab;
}

// The first and the last x of the cells taken in a row; none when the first lies behind the last.
inline int2 grid_row(const GridSlab *slab, const GridBox *box, int y, int z)
{
#if !ALL_NEIGHBOURS
    const bool border = y == 0 || z == 0 || y == box->rows - 1 ||
#if GRID_PERSPECTIVE
                        z == GRID_N - 1;
#else
                        z == GRID_Z - 1;
#endif
    if (!border && slab->reach < INFINITY && box->first.x > 0 && box->last.x < box->columns - 1) {
        const float at = slab->at + y * slab->step.y + z * slab->step.z;
        const float a = (-slab->reach - at) * slab->inverse;
        const float b = (slab->reach - at) * slab->inverse;
        // The box's first and last x lie inside of 0 and columns - 1 here.
        return (int2)(max(box->first.x, grid_rounded(ceil(fmin(a, b)), box->columns + 1)),
                      min(box->last.x, grid_rounded(fmax(a, b), box->columns + 1)));
    }
#endif
    return (int2)(box->first.x, box->last.x);
}

#endif
