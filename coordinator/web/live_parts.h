/* live_parts: the inside of live, private to its files.
 *
 * live.c         clients, what they say, the timer
 * live_feed.c    the events that are made, at most so often
 * live_watch.c   the frame that a client watches
 * live_stored.c  a frame that is done, read in the thread pool
 */
#ifndef AZULEJO_COORDINATOR_WEB_LIVE_PARTS_H
#define AZULEJO_COORDINATOR_WEB_LIVE_PARTS_H

#include <uv.h>

#include "coordinator/farm/linear.h"
#include "coordinator/farm/report.h"
#include "coordinator/farm/stored_tiles.h"
#include "coordinator/net/server.h"
#include "coordinator/web/events.h"
#include "coordinator/web/live.h"
#include "coordinator/web/picture.h"

enum {
    LIVE_TURN_MS = 40,           /* changed tiles are looked for this often, */
    LIVE_AGAIN_MS = 1,           /* or, when there were too many for one turn, */
    LIVE_TURN_NS = 2000000,      /* which takes this long at most, all clients together, */
    LIVE_SHARE = 1000,           /* and in the long run this part of the threads that render; not counting a frame's first tiles and
                                  * its last ones, nor the kernel's part */
    LIVE_SHARE_CORE = 20,        /* but at most this part of a processor */
    LIVE_SHARE_MAX_NS = 4000000, /* of which so much may be saved up */
    LIVE_STILL_MS = 300,         /* without a result: then tiles with a few new samples are sent, too */
    LIVE_SLICE_TILES = 16,       /* of one client, then it is the next one's turn */
    LIVE_MESSAGE_BYTES = 1 << 16,/* of tiles, about */
    LIVE_MESSAGE_HEADER = 12,
    LIVE_CACHE_TILES = 256,      /* encoded, for clients that watch the same */
    LIVE_TEXT_MAX = 4096,        /* bytes of a client's message */
    LIVE_LINGER_MS = 30000,      /* events are made for so long after the last listener went: it may come back */
    LIVE_STORED_BYTES = 1 << 18, /* read at once of a frame that is done */
    LIVE_STORED_STALL_MS = 10000,/* a client that takes nothing for so long makes room for one that waits */
    LIVE_COMMENT_MS = 15000,     /* a stream of events without any gets a comment */
};

struct live_client;
struct live_stored;

/* ---- events ---------------------------------------------------------------------------------- */

struct feed_job {
    uint64_t id, made_ns;
    uint64_t hash;               /* of the JSON made last; 0: it is to be made whatever it is */
    uint64_t samples;            /* that it had then */
    int changed;
};
struct feed {
    struct feed_job *jobs;       /* ascending ids */
    size_t count, capacity;
    size_t turn;                 /* the active job whose waiting is looked at next */
    uint64_t samples_ns, workers_ns, farm_ns, workers_hash, farm_hash;
    int workers_changed;
    struct buffer json;
    struct job_report report;
};
void feed_release(struct feed *feed);
/* A listener came: what it has loaded is not known. */
void feed_begin(struct feed *feed);
void feed_job_changed(struct live *live, uint64_t job);
void feed_job_removed(struct live *live, uint64_t job);
void feed_job_event(struct live *live, const struct job_event *event);
void feed_tick(struct live *live, uint64_t now_ns);

/* ---- a watched frame ------------------------------------------------------------------------- */

enum watch_state {
    WATCH_NONE,
    WATCH_FRAME,                 /* one in work, or not begun */
    WATCH_STORED,                /* one that is not open is being sent, from the store */
    WATCH_DONE,                  /* all of it was sent */
};
struct live_watch {
    enum watch_state state;
    uint32_t serial;             /* the client's */
    uint64_t job;
    uint32_t asked;              /* frame; 0: the one in work */
    int layer;
    uint32_t frame;              /* that is shown */
    uint32_t frames_done;        /* the job's, when the newest of them was looked for */
    uint64_t epoch;              /* of the job when it was begun (struct job, epoch_floor) */
    struct picture picture;
    uint64_t samples;            /* of the film when all of its tiles had been sent */
    uint64_t changed_ns;         /* when it was found with other samples last */
    int in_turn;                 /* the last turn did not look at all tiles */
    int is_final;                /* all of a film that ended was sent */
    int is_read;                 /* a film that is not open was read, and nothing came since */
    struct live_stored *stored;  /* in WATCH_STORED; NULL: it waits for its turn */
    struct buffer message;       /* tiles that are not sent yet */
    uint32_t message_tiles;
};
struct tile_cache_entry {
    uint64_t job, epoch;
    uint32_t frame, tile, samples;
    int32_t layer;
    uint32_t size;               /* 0: empty */
    uint8_t record[LINEAR_RECORD_MAX];
};
void watch_begin(struct live_client *client, uint32_t serial, uint64_t job, uint32_t frame, const char *layer);
void watch_end(struct live_client *client);
/* Look which frame it is. Once in a turn. */
void watch_follow(struct live_client *client, uint64_t now_ns);
/* Send some tiles. 1: there are more. */
int watch_slice(struct live_client *client, uint64_t now_ns, int begins_turn);
/* Append a record, of the tile and these samples, if the client has not seen it; sends full messages. */
void watch_add(struct live_watch *w, const uint8_t *record, size_t size);
void watch_flush(struct live_client *client);
/* Tell the client that all of it was sent, or why not. */
void watch_done(struct live_client *client, const struct error *why);

/* ---- live_stored.c --------------------------------------------------------------------------- */

/* Send tiles of the done frame that the client watches, or have more of them read. */
void stored_turn(struct live_client *client, const struct job *job, uint64_t now_ns);
void stored_end(struct live_client *client);

/* ---- clients --------------------------------------------------------------------------------- */

struct live_client {
    struct live_client *next, *previous;
    struct live *live;
    struct web_socket *socket;   /* or */
    struct web_request *request; /* a stream of server-sent events */
    int listens;
    uint64_t seq;                /* of the last event that it got */
    uint64_t sent_ns;
    struct live_watch watch;
};

struct live {
    struct server *server;
    uv_timer_t timer;
    int is_stopped;
    struct events events;
    uint64_t listened_ns;        /* somebody listened last; 0: never */
    struct feed feed;
    struct live_client *clients;
    uint32_t watching, stored;   /* clients; frames that are being read */
    int timer_runs;              /* 1: to the next turn; 2: it comes at once */
    uint64_t turn_ns;            /* begin of the last turn */
    int64_t share_ns;            /* that may be spent on tiles that clients saw before */
    struct tile_cache_entry *cache; /* [LIVE_CACHE_TILES]; NULL: nobody watches */
    struct buffer text;
};

size_t client_queued(const struct live_client *client);
static inline int client_has_room(const struct live_client *client)
{
    return client_queued(client) < WEB_QUEUE_HIGH;
}
/* Send {"event": name, "data": live->text}. */
void client_tell(struct live_client *client, const char *name, const struct buffer *data);
/* Look for tiles at once, or at the next turn. */
void live_wake(struct live *live, int at_once);
int live_is_heard(const struct live *live, uint64_t now_ns);

#endif
