/* model_parts: what the files that make and vary a model share. Private to tests/support/model*.c. */
#pragma once

#include <stdio.h>
#include <stdlib.h>

#include "tests/support/model.h"

/* p; aborts the program if it is NULL. */
static inline void *need(void *p)
{
    if (!p) {
        fprintf(stderr, "model: out of memory\n");
        abort();
    }
    return p;
}

/* A zeroed array in the model's arena. */
#define NEW(m, count, type) ((type *)need(arena_alloc(&(m)->arena, (count), sizeof(type))))
typedef double point[3];
typedef double point2[2];
typedef uint32_t corners[3];
