/* watch_parts: the inside of watch, private to its files.
 *
 * watching.c      watchers, what they ask, the timer
 * watch.c         the frame that one watches
 * watch_stored.c  a frame that is done, read in the thread pool
 */
#pragma once

#include <uv.h>

#include "common/base/buffer.h"
#include "coordinator/pictures/linear.h"
#include "coordinator/pictures/stored_tiles.h"
#include "coordinator/net/server.h"
#include "coordinator/page/picture.h"
#include "coordinator/page/watching.h"

enum {
    TILES_TURN_MS = 40,           /* changed tiles are looked for this often, */
    TILES_AGAIN_MS = 1,           /* or, when there were too many for one turn, */
    TILES_TURN_NS = 2000000,      /* which takes this long at most, all watchers together, */
    TILES_SHARE = 1000,           /* and in the long run this part of the threads that render; not counting a frame's first tiles and
                                   * its last ones, nor the kernel's part */
    TILES_SHARE_CORE = 20,        /* but at most this part of a processor */
    TILES_SHARE_MAX_NS = 4000000, /* of which so much may be saved up */
    TILES_STILL_MS = 300,         /* without a result: then tiles with a few new samples are sent, too */
    TILES_SLICE_TILES = 16,       /* of one watcher, then it is the next one's turn */
    TILES_MESSAGE_BYTES = 1 << 16,/* of tiles, about */
    TILES_CACHE = 256,            /* encoded, for watchers of the same */
    TILES_STORED_BYTES = 1 << 18, /* read at once of a frame that is done */
    TILES_STORED_STALL_MS = 1000, /* a watcher that takes nothing for so long makes room for one that waits */
};

struct watcher;
struct stored_watch;

enum watch_state {
    WATCH_NONE,
    WATCH_FRAME,                 /* one in work, or not begun */
    WATCH_STORED,                /* one that is not open is being sent, from the store */
    WATCH_DONE,                  /* all of it was sent */
};
struct tile_watch {
    enum watch_state state;
    uint64_t request; /* that began it, and that answers name */
    uint64_t job;
    uint32_t asked; /* frame; 0: the one in work */
    int layer;
    uint32_t frame;       /* that is shown */
    uint32_t frames_done; /* the job's, when the newest of them was looked for */
    uint64_t epoch;       /* of the job when it was begun (struct job, epoch_floor) */
    struct picture picture;
    uint64_t samples;            /* of the film when all of its tiles had been sent */
    uint64_t changed_ns;         /* when it was found with other samples last */
    int in_turn;                 /* the last turn did not look at all tiles */
    int is_final;                /* all of a film that ended was sent */
    int is_read;                 /* a film that is not open was read, and nothing came since */
    struct stored_watch *stored; /* in WATCH_STORED; NULL: it waits for its turn */
    struct buffer message;       /* tiles that are not sent yet */
    uint32_t message_tiles;
};
struct tile_cache_entry {
    uint64_t job, epoch;
    uint32_t frame, tile, samples;
    int32_t layer;
    uint32_t size; /* 0: empty */
    uint8_t record[LINEAR_RECORD_MAX];
};
void watch_begin(struct watcher *client, uint64_t request, uint64_t job, uint32_t frame, const char *layer);
void watch_end(struct watcher *client);
/* Look which frame it is. Once in a turn. */
void watch_follow(struct watcher *client, uint64_t now_ns);
/* Send some tiles. 1: there are more. */
int watch_slice(struct watcher *client, uint64_t now_ns, int begins_turn);
/* Append a record. */
void watch_add(struct tile_watch *w, const uint8_t *record, size_t size);
void watch_flush(struct watcher *client);
/* Tell the watcher that all of it was sent, or why not. */
void watch_done(struct watcher *client, const struct error *why);

/* Send tiles of the done frame that it watches, or have more of them read. */
void stored_turn(struct watcher *client, const struct job *job, uint64_t now_ns);
void stored_end(struct watcher *client);

struct watcher {
    struct watcher *next, *previous;
    struct watching *all;
    struct session *session;
    uint64_t unread; /* bytes of records that it has not taken yet */
    struct tile_watch watch;
};

struct watching {
    struct server *server;
    uv_timer_t timer;
    int is_stopped;
    struct watcher *clients;
    uint32_t watching, stored;      /* watchers; frames that are being read, */
    uint32_t stored_pictures;       /* of them without a film, as far as is known */
    int timer_runs;                 /* 1: to the next turn; 2: it comes at once */
    uint64_t turn_ns;               /* begin of the last turn */
    int64_t share_ns;               /* that may be spent on tiles that watchers saw before */
    struct tile_cache_entry *cache; /* [TILES_CACHE]; NULL: without watchers */
};

static inline int client_has_room(const struct watcher *client) { return client->unread < WATCH_UNREAD_MAX; }
/* Look for tiles at once, or at the next turn. */
void watching_wake(struct watching *all, int at_once);
