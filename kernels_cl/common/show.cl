// Which light a camera image shows: a sum of these.
#ifndef GIBENCH_SHOW
#define GIBENCH_SHOW

#define SHOW_DIRECT 1   // direct light, emission and environment
#define SHOW_INDIRECT 2 // indirect light from the lightmap

#endif
