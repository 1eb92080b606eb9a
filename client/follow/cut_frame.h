/* cut_frame: a finished frame with fewer samples than requested, for people. */
#pragma once

#include <stddef.h>

#include "protocol/azulejo.pb-c.h"

enum { CUT_FRAME_TEXT_SIZE = 192 };

/* "frame 3 holds 12.4 of 64 samples a pixel (8 to 16); 5 of 96 tiles have none and are black". */
int cut_frame_is_cancelled(const Azulejo__Wire__CutFrame *cut);
const char *cut_frame_text(char out[CUT_FRAME_TEXT_SIZE], const Azulejo__Wire__JobInfo *job,
                           const Azulejo__Wire__CutFrame *cut);
