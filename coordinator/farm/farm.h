/* farm: the coordinator's logic without sockets: the queue, the open frames, the leases and
 * the workers, driven by events and by a clock that is passed in.
 *
 * It requests outside work through `struct farm_events`. Those callbacks must not call back into
 * the farm, except farm_frame_developed from a later turn.
 *
 * The farm owns the queue, the frames and the leases; a worker belongs to its session, which
 * must remove it (farm_worker_remove) before it frees it. One thread.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"
#include "coordinator/farm/counts.h"
#include "coordinator/frame/credit.h"
#include "coordinator/frame/lease.h"
#include "coordinator/job/queue.h"
#include "coordinator/frame/trace.h"
#include "coordinator/farm/workforce.h"
#include "coordinator/store/store.h"

enum {
    FRAMES_OPEN_MAX = 16,        /* films in memory */
    FRAMES_OPEN_PER_JOB = 3,     /* of those, of one job; also counts frames being developed */
    WORKERS_MAX = 20000,
    WORKER_NAME_MAX = 191,
    DELIVERER_TEXT_MAX = 256,
    PROGRESS_SAVE_MS = 2000,     /* how often a running job's counters go to the store */
    WORKER_SAVE_MS = 10000,      /* and what a worker did */
    ROSTER_BUCKETS = 4096,
    ROSTER_MARKS_MAX = 10000,    /* names that are drained or blocked */
};
/* Films in memory; a single frame may exceed it. */
#define FRAMES_OPEN_BYTES ((uint64_t)16 << 30)

/* What a person did to a worker (roster.h). */
enum worker_hold { WORKER_FREE, WORKER_DRAINED, WORKER_BLOCKED };
/* What it does by itself; the numbers are the wire's WorkerMode. */
enum worker_mode { WORKER_MODE_WORKING, WORKER_MODE_PAUSED, WORKER_MODE_LEAVING };

struct farm_worker {
    struct lease_holder held; /* first: a lease's holder is its worker (farm_worker_of) */
    struct workforce_place place;
    uint32_t threads;     /* that it claims; >= 1 */
    struct credit credit; /* the number of them that it is trusted with */
    uint64_t machine;     /* machine_identity */
    uint32_t isa_mask;
    char ray_tracer[RAY_TRACER_NAME_MAX + 1];
    char name[WORKER_NAME_MAX + 1]; /* for people: "host, process 123" */
    struct deliverer deliverer;     /* gets its number in the films' logs with its first result */
    uint32_t room;                  /* units it asked for and did not get yet */
    uint64_t cost_job;              /* the job that `cost_ns` was measured on */
    double cost_ns;                 /* CPU time of one pixel sample on one thread; 0: not known */
    uint64_t delivered_job;         /* whose result it delivered last; 0: none yet */
    uint64_t counted;               /* when its threads were counted for a job (farm->counting) */
    uint64_t units_done, samples_done;
    struct rate rate;
    uint64_t noticed_job;  /* the newest job for which it was sent a refusal */
    uint64_t deferred_job; /* it keeps a result of this job that could not be taken; 0: none */
    char note[256];        /* why it gets no work; "" otherwise */
    char tags[TAGS_TEXT_MAX + 1];
    uint64_t memory; /* bytes; 0: not known */

    char label[WORKER_LABEL_MAX + 1]; /* its name on the farm (roster.h) */
    struct farm_worker *same_bucket;
    int is_named;      /* the name is its own */
    int is_auditing;   /* it was asked to render another one's unit again; */
    uint64_t audit_ns; /* so long did it that in all */
    int is_doubted;    /* its results differed from another's, and no third one has decided */
    int is_replaced;   /* its process has a newer connection */
    uint64_t instance; /* of its process; not 0 */
    enum worker_hold hold;
    char held_by[JOB_WHO_MAX + 1]; /* who did that */
    enum worker_mode mode;
    char mode_reason[128];
    char hang_note[256]; /* a unit hangs there; "" otherwise (hang.h): */
    uint64_t hang_job;   /* this one */
    uint32_t hang_frame;
    struct unit_name hang_unit;
    char address[64];
    int64_t joined_at; /* seconds since 1970, UTC */
    uint64_t cpu_ns;   /* of its results */
    struct {
        int stored;                      /* the store knows of the connection, */
        uint64_t units, samples, cpu_ns; /* and of these */
    } saved;
    uint64_t saved_ns;
    uint32_t line_count;
    struct worker_line lines[WORKER_LINES_MAX];
};

struct roster {
    struct farm_worker *by_name[ROSTER_BUCKETS];
    char taken_base[WORKER_LABEL_MAX + 1]; /* of this base, numbers up to taken_to were taken */
    uint32_t taken_to;                     /* 0: not known */
    struct worker_mark *marks;
    size_t mark_count, mark_capacity;
    int (*is_key)(const void *keys, const char *name); /* Has a worker used a key of that name? NULL: none has. */
    const void *keys;
};

struct freezing;
struct again {
    uint64_t job;
    uint32_t frame;
};

struct farm_events {
    void (*revoke)(void *user, uint32_t session, uint64_t lease, const char *reason);
    void (*ack)(void *user, uint32_t session, const struct job *job, uint32_t frame, struct unit_name unit);
    void (*notice)(void *user, uint32_t session, const char *text);
    void (*job_changed)(void *user, struct job *job);
    /* Turn the frame's complete film into files, note it as done in the store, keep the film or remove its file, then
     * call farm_frame_developed. If it cannot begin (out of memory), it is called again later. */
    status (*develop)(void *user, struct job_frame *frame);
    /* Make the pictures of a done frame again from its stored one, then call farm_pictures_made. If
     * it cannot begin, it is called again at the next tick. */
    status (*redevelop)(void *user, struct job *job, uint32_t frame);
    /* Compute the figures of the frame as it stands, keep them in the store at frame->history's next place, then call
     * figures_measured. NULL: no figures are computed. If it cannot begin, it is called again later. */
    status (*measure)(void *user, struct job_frame *frame);
    /* Call freezing_run, then freezing_end (freeze.h). If it cannot begin, it is called again later
     * with another freezing. NULL: the farm runs it itself. */
    status (*freeze)(void *user, struct freezing *freezing, struct error *err);
    void *user;
    /* For the page; each may be NULL. */
    void (*job_removed)(void *user, uint64_t job);
    void (*job_event)(void *user, const struct job_event *event);
    void (*workers_changed)(void *user);                  /* one joined, left, was steered, or changed its mode */
    void (*job_state)(void *user, const struct job *job); /* it has another one */
};

struct farm {
    struct queue queue;
    struct order order; /* of its jobs: ask waiting_order */
    int64_t ready_at_s; /* the first moment that a job waits for */
    uint64_t shares_saved_ns;
    struct lease_table leases;
    uint64_t counting;   /* how often threads were counted */
    struct store *store; /* NULL: nothing is kept (tests) */
    struct farm_events events;
    struct farm_worker *workers[WORKERS_MAX];
    uint32_t worker_count;
    struct workforce workforce;
    struct roster roster;
    uint64_t shortage_ns; /* the next moment when a machine that was short of something is asked again */
    uint64_t hang_ns;     /* a unit is rendered for this long, at least, before it hangs */
    uint32_t last_deliverer;
    struct distrusted *distrusted; /* distrusted.h */
    size_t distrusted_count, distrusted_capacity;
    struct again *again; /* frames that are rendered again (coordinator/steering/distrust.h) */
    size_t again_count, again_capacity;
    int again_known; /* those of earlier runs are among them */
    uint32_t open_frames;
    uint64_t open_bytes;
    uint32_t leaving; /* open frames that make room for others */
    uint64_t conflicts;
    struct farm_counts counts;
    int64_t wall_s;                   /* set by the owner as time passes */
    int pump_wanted;                  /* by farm_wake */
    int overdue_wanted;               /* units may have become overdue: ask for hungry workers */
    struct {                          /* the last walk over these lanes found no frame to begin, */
        unsigned lanes;               /* 0: not known */
        uint64_t changes, open_bytes; /* and since then nothing has changed */
    } barren;
    struct job *to_develop; /* jobs with pictures to be made again, a list */
    struct job *developing; /* one of this job is being made */
    struct trouble trouble; /* the store cannot be used */
    uint64_t told;          /* of the last message about a job (azulejo.proto, JobInfo) */
    uint64_t sync_ns;       /* what the last sync of films took */
    int resume_wanted;      /* films on disk are to be opened */
    int unsaved;            /* some job is `unsaved` */
    struct trace trace;
    int64_t begun_s;       /* when this run began, and with it the trace */
    uint64_t last_old_job; /* of those that are older than this run; 0: none */
    int discards_films;    /* no films of done frames are kept: the store will soon be deleted
                                    */
};

/* There may be something to lend, to any worker. The owner of the connections asks for it, and clears the flag. */
static inline void farm_wake(struct farm *farm) { farm->pump_wanted = 1; }

/* Loads the jobs of the store. The store stays the caller's. ERR_IO, ERR_NO_MEMORY. */
status farm_init(struct farm *farm, struct store *store, uint64_t lease_ns, const struct farm_events *events,
                 int64_t wall_s, struct error *err) MUST_CHECK;
void farm_release(struct farm *farm, uint64_t now_ns);
/* Once, after farm_init: end the jobs that had nothing left to render, open the films that are on disk. */
void farm_resume(struct farm *farm, uint64_t now_ns);

/* Take a new job: gives it an id, stores and queues it. On failure the caller still owns it. */
status farm_submit(struct farm *farm, struct job *job, struct error *err) MUST_CHECK;
/* The same in three steps, so that the one in the middle, store_job_insert, can be run in another thread. */
status farm_prepare(const struct farm *farm, struct job *job, struct error *err) MUST_CHECK;
status farm_adopt(struct farm *farm, struct job *job, struct error *err) MUST_CHECK;
/* End the job. Unless `discard`, pictures are first made of what its open frames hold: the job is CANCELLING until they
 * are on disk. Of a job that has ended, `discard` removes the kept films; else no effect on it. */
void farm_cancel(struct farm *farm, struct job *job, int discard, uint64_t now_ns);
void farm_fail(struct farm *farm, struct job *job, uint64_t now_ns, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

status farm_worker_add(struct farm *farm, struct farm_worker *worker, struct error *err) MUST_CHECK;
/* `died`: its connection was lost. Jobs that it held leases of may be parked for that (suspicion.h). */
void farm_worker_remove(struct farm *farm, struct farm_worker *worker, int died, uint64_t now_ns);
/* The worker that holds the lease. */
struct farm_worker *farm_worker_of(const struct lease *lease);
/* Give the worker its number in the films' logs, if it has none. */
void farm_deliverer_begin(struct farm *farm, struct farm_worker *worker);
/* The worker with this deliverer number, in words. */
void farm_deliverer_text(const struct farm *farm, uint32_t deliverer, char out[DELIVERER_TEXT_MAX]);
/* A worker reports that it cannot render this job, for the reason `code`: a shortage of its own passes (refusal.h), and
 * only a damaged scene fails the job. Counts once per machine, and only while the worker holds a lease of the job. */
void farm_job_broken(struct farm *farm, struct job *job, struct farm_worker *worker, status code, const char *text,
                     uint64_t now_ns);
/* What machines were short of may be there now (a blob): they are asked again at once. */
void farm_shortages_hurry(struct farm *farm, uint64_t now_ns);
/* Can this worker serve the job? If not, `why` says so, for people. */
int farm_can_serve(const struct job *job, const struct farm_worker *worker, char *why, size_t why_size);

/* The job's open frame of this number; NULL: none. */
struct job_frame *farm_frame_find(const struct job *job, uint32_t number);
/* Open the frame if the limits allow (else NULL without an error). While the store is in trouble, only films that are
 * on disk are opened. A failure is noted as the job's trouble, and leaves the job waiting. */
struct job_frame *farm_frame_open(struct farm *farm, struct job *job, uint32_t number, uint64_t now_ns);
/* Note what the films have that are on disk only, for the job's progress. */
void farm_note_closed(struct farm *farm, struct job *job);
/* Could the frame of some job be opened, as far as the limits of all jobs go? */
int farm_may_begin(const struct farm *farm);
/* The next frame of the job that is neither done nor open, opened; NULL: none, or limits. */
struct job_frame *farm_frame_open_next(struct farm *farm, struct job *job, uint64_t now_ns);
/* Close a frame that makes room for others, or returns, once what was merged is on disk. */
void farm_frame_leave(struct farm *farm, struct job_frame *frame, uint64_t now_ns);
/* Its job has other rules: the frame is closed like that, and opened again with them from its film. Pictures
 * that are being made of it do not count. */
void farm_frame_renew(struct farm *farm, struct job_frame *frame, uint64_t now_ns);
/* The frame leaves its job: its leases are revoked and unacknowledged results disowned, for
 * `reason`. It is freed now, or when its last commit or develop ends. */
void farm_frame_close(struct farm *farm, struct job_frame *frame, const char *reason);
/* Acknowledge the results that need not wait any longer. */
void farm_frame_send_acks(struct farm *farm, struct job_frame *frame);
/* End the frame: from RENDERING to COMPLETE; its leases are revoked. No effect on one that has
 * ended. Call farm_frame_advance afterwards. */
void farm_frame_end(struct farm *farm, struct job_frame *frame, enum frame_end end);
/* The memory of a film when it is full. */
uint64_t farm_film_bytes(uint32_t width, uint32_t height, uint32_t aovs);
/* Revoke every lease of the frame. */
void farm_frame_revoke(struct farm *farm, const struct job_frame *frame, const char *reason);
/* Revoke every lease of the job. */
void farm_job_revoke(struct farm *farm, const struct job *job, const char *reason);
/* Change the job's state, store it and notify its watchers. Ending a job closes its frames and removes its films. */
void farm_job_change(struct farm *farm, struct job *job, enum job_state state, const char *text, uint64_t now_ns);
/* Take the decisions for which the statistics are complete (rounds.h). Call after something was folded. */
void farm_frame_decide(struct farm *farm, struct job_frame *frame, uint64_t now_ns);
/* Advance the frame from its end, by rounds or by farm_frame_end, to its pictures. */
void farm_frame_advance(struct farm *farm, struct job_frame *frame, uint64_t now_ns);
/* The end of events.develop. When `result` is OK the frame is in the store as done already, and its
 * pictures follow that revision of the job's output settings (-1: none was made). */
void farm_frame_developed(struct farm *farm, struct job_frame *frame, int64_t revision, status result,
                          const struct error *why, uint64_t now_ns);
/* Make the job's present and future pictures with other output settings. The choice of an EXR and
 * its kind do not change. ERR_IO: nothing changed. */
status farm_develop(struct farm *farm, struct job *job, const struct output_settings *output,
                    struct error *err) MUST_CHECK;
/* Put the job among those whose pictures are to be made, if any are. */
void farm_pictures_wanted(struct farm *farm, struct job *job);
/* Begin the next picture that can be made. Only one is made at a time: the other threads render. */
void farm_pictures_next(struct farm *farm, uint64_t now_ns);
/* End the job if all its frames are done and have their pictures. */
void farm_job_end_when_done(struct farm *farm, struct job *job, uint64_t now_ns);
/* The end of events.redevelop. */
void farm_pictures_made(struct farm *farm, struct job *job, uint32_t frame, int64_t revision, status result,
                        const struct error *why, uint64_t now_ns);
/* A failure of the environment stopped some work on a job's frame. Checks whether the store is the cause, notes it in
 * `trouble`, which says when to try again, and logs its beginning. `what` follows "frame N"; it may be empty. */
void farm_trouble(struct farm *farm, const struct job *job, uint32_t frame, struct trouble *trouble, const char *what,
                  const struct error *why, uint64_t now_ns);
/* The work succeeded; no effect without trouble. */
void farm_trouble_over(struct farm *farm, struct job *job, struct trouble *trouble, uint64_t now_ns);
/* The store refused what was to be on disk at once: say so from now on, not only after the next look. */
void farm_store_failed(struct farm *farm, const struct error *why, uint64_t now_ns);
/* May new jobs and blobs be taken? ERR_IO: the text says why not. */
status farm_store_usable(const struct farm *farm, struct error *err) MUST_CHECK;
/* May units of the frame be lent? While it cannot be written: up to TROUBLE_RESULTS_MAX. */
int farm_may_lease(const struct farm *farm, const struct job_frame *frame);
/* May deferred results of that job be delivered again? */
int farm_takes_again(const struct farm *farm, uint64_t job);
/* Look at the store where something failed, and while it is in trouble. */
void farm_store_check(struct farm *farm, uint64_t now_ns);
/* Hand the job's state to the store; farm_tick repeats it if that fails. */
void farm_job_save(struct farm *farm, struct job *job, uint64_t now_ns);
/* Note a line of a job's log. */
void farm_event(struct farm *farm, const struct job_event *event);
void farm_workers_changed(const struct farm *farm);
/* Note an event in the job's log; `who` is NULL for the coordinator itself. */
void farm_note(struct farm *farm, const struct job *job, const char *who, const char *format, ...)
    __attribute__((format(printf, 4, 5)));
/* Free a removed job and remove its files, if nothing holds it any more. */
void farm_job_dispose(struct farm *farm, struct job *job);
/* Take the job out of the list of those whose pictures are to be made. */
void farm_pictures_unwanted(struct farm *farm, struct job *job);
/* Hold the frame: it is not freed. */
void farm_frame_pin(struct job_frame *frame);
/* Hold it no longer; frees it if its job has ended. */
void farm_frame_unpin(struct farm *farm, struct job_frame *frame);

/* The first units were sent: the job is RUNNING. */
void farm_job_started(struct farm *farm, struct job *job, const struct farm_worker *worker, uint64_t now_ns);

/* Store what workers did, now and then. */
void farm_workers_tick(struct farm *farm, uint64_t now_ns);
/* A thread of the worker has been rendering the unit for running_ns. 1: it hangs, and `hang_note` says so. */
int farm_worker_renders_long(struct farm *farm, struct farm_worker *worker, uint64_t job, uint32_t frame,
                             struct unit_name name, uint64_t running_ns, uint64_t now_ns);

/* The coordinator was suspended for this long: leases are extended by it. */
void farm_pause(struct farm *farm, uint64_t paused_ns);
/* End lapsed leases, store counters. Call a few times a second. */
void farm_tick(struct farm *farm, uint64_t now_ns);
