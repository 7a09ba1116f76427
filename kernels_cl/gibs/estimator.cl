// The multi-scale mean estimator (Barre-Brisebois et al. 2019, "Hybrid Rendering for Real-Time Ray
// Tracing", Ray Tracing Gems chapter 25; paper 004, section 4.3).
#ifndef GIBENCH_GIBS_ESTIMATOR
#define GIBENCH_GIBS_ESTIMATOR

// estimator: ESTIMATOR_ROWS rows of CAPACITY floats: mean 0-2, short mean 3-5, variance 6-8, blend
// factor 9, inconsistency 10.
#define ESTIMATOR_ROWS 11
#define ROW_MEAN 0
#define ROW_SHORT_MEAN 3
#define ROW_VARIANCE 6
#define ROW_BLEND 9
#define ROW_INCONSISTENCY 10

// The estimator's constants, all of the chapter's listing.
#define SHORT_WINDOW 0.08f
#define SMALLEST_VARIANCE 1e-5f

typedef struct {
    float3 mean, short_mean, variance;
    float blend, inconsistency;
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
    return e;
}

inline void estimator_store(__global float *estimator, uint id, Estimator e)
{
    surfel_store3(estimator + ROW_MEAN * CAPACITY, id, e.mean);
    surfel_store3(estimator + ROW_SHORT_MEAN * CAPACITY, id, e.short_mean);
    surfel_store3(estimator + ROW_VARIANCE * CAPACITY, id, e.variance);
    estimator[ROW_BLEND * CAPACITY + id] = e.blend;
    estimator[ROW_INCONSISTENCY * CAPACITY + id] = e.inconsistency;
}

// A surfel that has seen nothing yet: fully inconsistent, so that its first rays count.
inline Estimator estimator_new(void)
{
    Estimator e;
    e.mean = e.short_mean = e.variance = (float3)(0.0f);
    e.blend = 0.0f;
    e.inconsistency = 1.0f;
    return e;
}

// Take in one sample y.
inline void estimator_add(Estimator *e, float3 y)
{
    float3 deviation = sqrt(fmax(e->variance, SMALLEST_VARIANCE));
    // Against fireflies.
    y = fmin(y, 0.1f + e->short_mean + 8.0f * deviation);
    const float3 before = y - e->short_mean;
    e->short_mean += SHORT_WINDOW * before;
    const float3 after = y - e->short_mean;
    // A longer window than the short mean's, so that the variance does not shrink with it.
    e->variance += 0.5f * SHORT_WINDOW * (before * after - e->variance);
    deviation = sqrt(fmax(e->variance, SMALLEST_VARIANCE));
    const float difference = luma(fabs(e->mean - e->short_mean) / deviation);
    e->inconsistency += 0.08f * (difference - e->inconsistency);
    const float reduction = clamp(luma(0.5f * e->short_mean / deviation), 1.0f / 32.0f, 1.0f);
    const float step = smoothstep(0.0f, 1.0f, difference * fmax(0.02f, e->inconsistency - 0.2f));
    const float catch_up = e->blend * clamp(step, 1.0f / 256.0f, 1.0f);
    e->blend += 0.1f * (reduction - e->blend);
    e->mean += clamp(catch_up, 0.0f, 1.0f) * (y - e->mean);
}

#endif
