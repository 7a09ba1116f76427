// What changes with the frame, and the counters of the surfels' life.
#ifndef GIBENCH_GIBS_FRAME
#define GIBENCH_GIBS_FRAME

#include "common/random.cl"
#include "parts/surfels.cl"

// frame: words written by gibench.techniques.gibs.technique before every frame: those of
// parts/surfels.cl, then FRAME_NUMBER, FRAME_RAYS, FRAME_SEED.
// counters: words that only the device writes, COUNT_ALIVE, COUNT_FREE, ...
// All macros of kernels_cl/gibs that are given: gibench.techniques.gibs.macros.

#endif
