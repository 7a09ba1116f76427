// What changes with the frame, and the counters of the surfels' life.
#ifndef GIBENCH_GIBS_FRAME
#define GIBENCH_GIBS_FRAME

#include "common/random.cl"
#include "parts/surfels.cl"

// frame: words written by gibench.techniques.gibs.technique before every frame: those of
// parts/surfels.cl, then
#define FRAME_NUMBER (SURFEL_WORDS)   // frames begun so far, from 1
#define FRAME_RAYS (SURFEL_WORDS + 1) // rays to trace in this frame
#define FRAME_SEED (SURFEL_WORDS + 2) // of every random choice
#define FRAME_WORDS (SURFEL_WORDS + 3)

// counters: words that only the device writes.
#define COUNT_ALIVE 0     // surfels alive
#define COUNT_FREE 1      // height of the stack of free IDs
#define COUNT_PLACED 2    // placed in this frame
#define COUNT_RECYCLED 3  // recycled in this frame
#define COUNT_SURVIVORS 4 // alive after this frame
#define COUNT_WORDS 5

#endif
