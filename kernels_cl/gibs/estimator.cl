// The multi-scale mean estimator (Barre-Brisebois et al. 2019, "Hybrid Rendering for Real-Time Ray
// Tracing", Ray Tracing Gems chapter 25; Ekberg 2022, section 4.3).
//
// Its long window follows the samples: a bright ray raises the variance and so lowers the weight of
// that very ray, while a row of dark ones lowers the variance and raises theirs. Where light comes
// from few directions the mean is too dark, and the clamp takes what is left (one ray in 10 bright:
// 11 % too dark; one in 20: 38 %; one in 50: 99 %). Built with FLOORED 1 every ray has at least the
// weight 1 / LONGEST_WINDOW, and the first ones more, as FIRST_RAYS says; short mean and variance
// begin so too, and nothing is clamped: 0 %, 2 % and 7 %.
// FLOORED 0 is the chapter's own.
#ifndef GIBENCH_GIBS_ESTIMATOR
#define GIBENCH_GIBS_ESTIMATOR

// estimator: twelve rows of CAPACITY floats: mean 0-2, short mean 3-5, variance 6-8, blend
// factor 9, inconsistency 10, rays taken in, as many as make a difference, 11.
#define ROW_MEAN 0
#define ROW_SHORT_MEAN 3
#define ROW_VARIANCE 6
#define ROW_BLEND 9
#define ROW_INCONSISTENCY 10
#define ROW_RAYS 11

// The estimator's constants, all of the chapter's listing.
#define SHORT_WINDOW 0.08f
#define SMALLEST_VARIANCE 1e-5f
// A ray counts as much as so many before it: the first ones find surfels dark that have had no rays
// themselves, and a plain mean would keep that for as long as it goes on. Ours.
#define FIRST_RAYS 4.0f

typedef struct {
    float3 mean, short_mean, variance;
    float blend, inconsistency, rays;
} Estimator;

inline float luma(float3 c)
{
    return dot(c, (float3)(0.299f, 0.587f, 0.114f));
}

inline Estimator estimator_load(__global const float *estimator, uint id)
{
    Estimator e;
    e.mean = surfel_load3(estimator + ROW_MEAN * CAPACITY, id);
    e.short_mean = surfel_load3(estimator + ROW_SHORT_MEAN * CAPACITY, id);
    e.variance = surfel_load3(estimator + ROW_VARIANCE * CAPACITY, id);
    e.blend = estimator[ROW_BLEND * CAPACITY + id];
    e.inconsistency = estimator[ROW_INCONSISTENCY * CAPACITY + id];
    e.rays = estimator[ROW_RAYS * CAPACITY + id];
    return e;
}

inline void estimator_store(__global float *estimator, uint id, Estimator e)
{
    surfel_store3(estimator + ROW_MEAN * CAPACITY, id, e.mean);
    surfel_store3(estimator + ROW_SHORT_MEAN * CAPACITY, id, e.short_mean);
    surfel_store3(estimator + ROW_VARIANCE * CAPACITY, id, e.variance);
    estimator[ROW_BLEND * CAPACITY + id] = e.blend;
    estimator[ROW_INCONSISTENCY * CAPACITY + id] = e.inconsistency;
    estimator[ROW_RAYS * CAPACITY + id] = e.rays;
}

// A surfel that has seen nothing yet: fully inconsistent, so that its first rays count.
inline Estimator estimator_new(void)
{
    Estimator e;
    e.mean = e.short_mean = e.variance = (float3)(0.0f);
    e.blend = e.rays = 0.0f;
    e.inconsistency = 1.0f;
    return e;
}

// Take in one sample y.
inline void estimator_add(Estimator *e, float3 y)
{
#if FLOORED
    e->rays = fmin(e->rays + 1.0f, FIRST_RAYS * (LONGEST_WINDOW - 1.0f) + 1.0f);
    const float least = FIRST_RAYS / (e->rays + (FIRST_RAYS - 1.0f));
    // Nothing to compare the first ray with.
    e->mean = e->rays == 1.0f ? y : e->mean;
#else
    e->rays = fmin(e->rays + 1.0f, LONGEST_WINDOW);
    const float least = 0.0f;
    // Against fireflies.
    y = fmin(y, 0.1f + e->short_mean + 8.0f * sqrt(fmax(e->variance, SMALLEST_VARIANCE)));
#endif
    const float3 before = y - e->short_mean;
    e->short_mean += fmax(SHORT_WINDOW, least) * before;
    const float3 after = y - e->short_mean;
    // A longer window than the short mean's, so that the variance does not shrink with it.
    e->variance += fmax(0.5f * SHORT_WINDOW, least) * (before * after - e->variance);
    const float3 deviation = sqrt(fmax(e->variance, SMALLEST_VARIANCE));
    const float difference = luma(fabs(e->mean - e->short_mean) / deviation);
    e->inconsistency += 0.08f * (difference - e->inconsistency);
    const float reduction = clamp(luma(0.5f * e->short_mean / deviation), 1.0f / 32.0f, 1.0f);
    const float step = smoothstep(0.0f, 1.0f, difference * fmax(0.02f, e->inconsistency - 0.2f));
    const float catch_up = e->blend * clamp(step, 1.0f / 256.0f, 1.0f);
    e->blend += 0.1f * (reduction - e->blend);
    e->mean += fmax(catch_up, least) * (y - e->mean);
}

#endif
