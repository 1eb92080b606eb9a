/* tev: a job's pictures, as they become right, in a window of the viewer tev, by its TCP protocol.
 *
 * The viewer need not be there: it is tried again at each picture, and gets the whole one when it comes.
 */
#pragma once

#include "client/follow/watch.h"
#include "common/image/image.h"

enum { TEV_PORT_DEFAULT = 14158 };

struct tev;

/* `address`: HOST[:PORT]; nothing is connected yet. ERR_USAGE. */
status tev_new(struct tev **out, const char *address, int quiet, struct error *err) MUST_CHECK;
void tev_free(struct tev *tev);

/* Show a picture of linear values under a name: the parts that differ from what is shown under it, or all of it. */
void tev_show(struct tev *tev, const char *name, const struct image *image);

/* A watch_update_fn, with a struct tev: fetch the frame in work, at most once a second and for a tenth of the time, and
 * each frame that is done, and show them. */
status tev_update(void *tev, struct connection *c, const Azulejo__Wire__JobInfo *info, struct error *err) MUST_CHECK;

#define TEV_OPTION_ROW(address)                                                                                        \
    {"tev", 0, OPTION_STRING, &(address), "HOST[:PORT]",                                                               \
     "show the pictures as they become right in the viewer tev that runs there (port 14158 if none is given)", 0, 0,   \
     NULL}
