/* parallel: a loop run by several threads. Which thread runs which part is left to chance, so what the body computes
 * for an index must depend on that index alone; the result is then the same for any number of threads. */
#pragma once

#include <stddef.h>
#include <stdint.h>

enum { PARALLEL_THREADS_MAX = 256 };

/* The processors that this process may use, 1 to PARALLEL_THREADS_MAX. */
unsigned parallel_processors(void);

/* Call body(user, begin, end) for pieces of 0..count-1, each index once, and return when all are
 * done. `threads` includes the caller; 0 means parallel_processors(). A piece has `grain` indices
 * (at least 1); the last one may have fewer. Fewer threads run if some cannot be started. */
void parallel_for(unsigned threads, size_t count, size_t grain, void (*body)(void *user, size_t begin, size_t end),
                  void *user);

/* 0, or the number of the error for which so many threads with stacks of so many bytes cannot be there at once.
 * `threads` is at most PARALLEL_THREADS_MAX. */
int parallel_try(unsigned threads, size_t stack_bytes);

/* The processor time of the calling thread, and of those that worked for it in parallel_for. */
uint64_t parallel_cpu_ns(void);
