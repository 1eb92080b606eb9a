/* What people do to jobs: every verb in every state, every edge of the diagram, and over restarts. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "common/system/file.h"
#include "coordinator/farm/closing.h"
#include "coordinator/farm/scheduler.h"
#include "coordinator/farm/waiting.h"
#include "tests/support/sim_farm.h"
#include "tests/support/sim_states.h"
#include "tests/support/steering.h"

/* Cancelled when its last picture was being made. */
static struct job *make_cancelled_late(struct sim_stored *f)
{
    struct job *job = sim_submit(f->sim, 16, 16, 4, 1, 1, 0);
    struct sim_worker *worker = sim_stored_connect(f, 4);

    while (sim_grant(f->sim, worker, 16) > 0) {
        for (size_t k = 0; k < worker->unit_count; k++)
            (void)sim_send(f->sim, worker, k, 100);
        sim_commit(f->sim);
    }
    sim_stored_tick(f);
    farm_cancel(&f->sim->farm, job, 0, f->sim->now_ns);
    assert_int_equal(job->state, JOB_STATE_CANCELLING);
    return job;
}

/* ---- the diagram ----------------------------------------------------------------------------- */

static int has_edge(enum job_state from, enum job_state to)
{
    for (size_t i = 0; i < job_edge_count; i++)
        if (job_edges[i].from == from && job_edges[i].to == to)
            return 1;
    return 0;
}

/* Do what leads to that state. */
static void act(struct sim_stored *f, struct job *job, enum job_state to)
{
    struct farm *farm = &f->sim->farm;
    uint64_t now_ns = f->sim->now_ns;
    struct error err = {0};

    switch (to) {
    case JOB_STATE_QUEUED:
        if (do_verb(farm, job, VERB_RESUME, "ana@desk", now_ns, &err) != STATUS_OK) {
            const uint32_t frame = 1;
            (void)!do_verb_with(farm, job, VERB_RETRY_FRAMES, frame, "ana@desk", f->sim->now_ns, &err);
        }
        return;
    case JOB_STATE_RUNNING: sim_grant(f->sim, sim_stored_connect(f, 1), 1); return;
    case JOB_STATE_DONE:
        if (job->state == JOB_STATE_FINISHING || job->state == JOB_STATE_RUNNING)
            sim_stored_render(f);
        else if (job->state == JOB_STATE_CANCELLING)
            sim_develop(f->sim);
        return;
    case JOB_STATE_FAILED: farm_fail(farm, job, now_ns, "a broken scene"); return;
    case JOB_STATE_CANCELLED: farm_cancel(farm, job, 1, now_ns); return;
    case JOB_STATE_CANCELLING: farm_cancel(farm, job, 0, now_ns); return;
    case JOB_STATE_PARKED: sim_job_park(f, job); return;
    case JOB_STATE_PAUSED: (void)!do_verb(farm, job, VERB_PAUSE, "ana@desk", now_ns, &err); return;
    case JOB_STATE_FINISHING: (void)!do_verb(farm, job, VERB_FINISH, "ana@desk", now_ns, &err); return;
    default: return;
    }
}

/* Each edge can be walked, and nothing leads where there is none; a restart changes nothing. */
static void every_edge(void **state)
{
    struct sim_stored *f = *state;
    size_t walked = 0;

    for (int from = 0; from < JOB_STATE_COUNT; from++)
        for (int to = 0; to < JOB_STATE_COUNT; to++) {
            struct job *job;

            if (from == to)
                continue;
            job = from == JOB_STATE_CANCELLING && to == JOB_STATE_DONE ? make_cancelled_late(f)
                                                                       : sim_job_in(f, (enum job_state)from);
            act(f, job, (enum job_state)to);
            if ((int)job->state != (has_edge((enum job_state)from, (enum job_state)to) ? to : from))
                fail_msg("from %s to %s: it is %s", job_state_word((enum job_state)from),
                         job_state_word((enum job_state)to), job_state_word(job->state));
            walked += (int)job->state == to;
            sim_stored_tear_down(state);
            sim_stored_set_up(state);
            f = *state;
        }
    assert_int_equal(walked, job_edge_count);
}

/* ---- the verbs ------------------------------------------------------------------------------- */

static status do_it(struct sim_stored *f, struct job *job, enum job_verb_name verb, struct error *err)
{
    if (verb == VERB_START) {
        job->needs.not_before = INT64_MAX;
        job->needs.after[job->needs.after_count++] = 1;
        farm_job_save(&f->sim->farm, job, f->sim->now_ns);
    }
    return do_verb_with(&f->sim->farm, job, verb,
                        verb == VERB_PRIORITY ? 7 : verb == VERB_RETRY_FRAMES ? 2 : verb == VERB_EXTEND ? 64
                                                                                 : verb == VERB_DISCARD,
                        "ana@desk", f->sim->now_ns, err);
}

/* What every verb of verbs.h does. "-": refused; "=": taken, and the state stays; "0": gone. */
static const char *const table[VERB_COUNT] = {
    /*                     q    r    d    f    c    k    g    p    n       (enum job_state's numbers) */
    [VERB_PAUSE] =        "p" "p" "-" "-" "-" "-" "-" "=" "-",
    [VERB_RESUME] =       "-" "-" "-" "-" "-" "q" "-" "q" "-",
    [VERB_FINISH] =       "n" "n" "-" "-" "-" "-" "-" "n" "=",
    [VERB_START] =        "=" "=" "-" "-" "-" "=" "=" "=" "=",
    [VERB_PRIORITY] =     "=" "=" "-" "-" "-" "=" "=" "=" "=",
    [VERB_RETRY] =        "-" "-" "-" "q" "q" "-" "-" "-" "-",
    [VERB_RETRY_FRAMES] = "-" "-" "q" "q" "q" "-" "-" "-" "-",
    [VERB_EXTEND] =       "=" "=" "q" "-" "-" "=" "-" "=" "-",
    [VERB_DEVELOP] =      "=" "=" "=" "=" "=" "=" "=" "=" "=",
    [VERB_COMMENT] =      "=" "=" "=" "=" "=" "=" "=" "=" "=",
    [VERB_CANCEL] =       "g" "g" "=" "=" "=" "g" "=" "g" "g",
    [VERB_DISCARD] =      "c" "c" "=" "=" "=" "c" "c" "c" "c",
    [VERB_REMOVE] =       "-" "-" "0" "0" "0" "-" "-" "-" "-",
};
static const char letters[] = "qrdfckgpn";

/* At the command line. */
static const char *words_of(int verb)
{
    return verb == VERB_RETRY_FRAMES ? "retry --frames" : verb == VERB_DISCARD ? "cancel --discard" : job_verbs[verb].name;
}

/* Does a verb lead from that state to the other? */
static int verb_leads(enum job_state from, enum job_state to)
{
    for (int verb = 0; verb < VERB_COUNT; verb++)
        if (table[verb][from] == letters[to])
            return 1;
    return 0;
}

/* The end of the state's row in docs/JOBS.md: where it goes by itself, and what each verb does. */
static void make_row(enum job_state from, char *out, size_t size)
{
    size_t used = 0;
    int any = 0;

    for (int to = 0; to < JOB_STATE_COUNT; to++)
        if (has_edge(from, (enum job_state)to) &&
            (from == JOB_STATE_CANCELLING || !verb_leads(from, (enum job_state)to)))
            used += (size_t)snprintf(out + used, size - used, "%s%s", any++ ? ", " : "",
                                     job_state_word((enum job_state)to));
    used += (size_t)snprintf(out + used, size - used, "%s | ", any ? "" : "-");
    any = 0;
    for (int verb = 0; verb < VERB_COUNT; verb++) {
        char outcome = table[verb][from];
        const char *to = strchr(letters, outcome) ? job_state_word((enum job_state)(strchr(letters, outcome) - letters))
                                                  : outcome == '0' ? "gone" : NULL;

        if (outcome == '-' || verb == VERB_DEVELOP || verb == VERB_COMMENT || (outcome == '=' && job_state_ended(from)))
            continue;
        used += (size_t)snprintf(out + used, size - used, "%s`%s`%s%s", any++ ? ", " : "", words_of(verb),
                                 to ? " → " : "", to ? to : "");
    }
    snprintf(out + used, size - used, " |\n");
}

/* The table of states that people read has the diagram's edges and what every_verb_in_every_state proves. */
static void the_documents_have_the_table(void **state)
{
    struct buffer text = BUFFER_INIT;
    struct error err = {0};
    char row[1024], begin[64];

    (void)state;
    assert_int_equal(file_read("docs/JOBS.md", 1 << 20, &text, &err), STATUS_OK);
    for (int s = 0; s < JOB_STATE_COUNT; s++) {
        const char *at, *end;

        make_row((enum job_state)s, row, sizeof row);
        snprintf(begin, sizeof begin, "\n| **%s** |", job_state_word((enum job_state)s));
        at = strstr(buffer_text(&text), begin);
        end = at ? strchr(at + 1, '\n') : NULL;
        if (!end || (size_t)(end + 1 - at) < strlen(row) || memcmp(end + 1 - strlen(row), row, strlen(row)) != 0)
            fail_msg("docs/JOBS.md: the row of '%s' must end with: %s", job_state_word((enum job_state)s), row);
        assert_null(strstr(end, begin)); /* one row */
    }
    buffer_release(&text);
}

static void check_after(struct sim_stored *f, enum job_verb_name verb, enum job_state expected)
{
    struct job *job;

    if (table[verb][0] && expected == JOB_STATE_COUNT) {
        assert_int_equal(f->sim->farm.queue.count, 0);
        return;
    }
    job = sim_stored_job(f);
    if (job->state != expected)
        fail_msg("verb %d: it is %s, not %s", verb, job_state_word(job->state), job_state_word(expected));
    if (verb == VERB_PRIORITY && !job_state_ended(expected))
        assert_int_equal(job->priority, 7);
    if (verb == VERB_COMMENT)
        assert_string_equal(job->comment, "words");
    if (verb == VERB_EXTEND && table[verb][expected] == '=')
        assert_int_equal(job->settings.spp, 64);
    if (verb == VERB_START && !job_state_ended(expected))
        assert_true(job->needs.not_before == 0 && job->needs.after_count == 0);
}

static void every_verb_in_every_state(void **state)
{
    struct sim_stored *f = *state;

    for (int from = 0; from < JOB_STATE_COUNT; from++)
        for (int verb = 0; verb < VERB_COUNT; verb++) {
            struct job *job = sim_job_in(f, (enum job_state)from);
            char outcome = table[verb][from];
            enum job_state expected = outcome == '-' || outcome == '='
                                          ? (enum job_state)from
                                          : (enum job_state)(strchr(letters, outcome) - letters);
            struct error err = {0};
            int offered = steer_offers(job, (enum job_verb_name)verb);
            status s = do_it(f, job, (enum job_verb_name)verb, &err);

            /* What changes the state is offered; what is refused is not. */
            if (offered ? outcome == '-' : outcome != '-' && outcome != '=')
                fail_msg("%s is%s offered in state %s", job_verbs[verb].name, offered ? "" : " not", job_state_word(from));
            if ((s == STATUS_ERR_REFUSED) != (outcome == '-'))
                fail_msg("verb %d in state %s: %d (%s)", verb, job_state_word(job->state), s, err.text);
            store_settle(f->store); /* its answer waits for that */
            if (s == STATUS_OK && outcome != '=')
                assert_false(store_job_unsaved(f->store, 1));
            if (outcome == '-')
                assert_true(strstr(err.text, "job 1 is ") && strchr(err.text, ':'));
            if (outcome == '0')
                expected = JOB_STATE_COUNT;
            check_after(f, (enum job_verb_name)verb, expected);
            sim_stored_restart(f); /* killed after the answer */
            check_after(f, (enum job_verb_name)verb, expected);
            sim_stored_tear_down(state);
            sim_stored_set_up(state);
            f = *state;
        }
}

/* ---- what continues -------------------------------------------------------------------------- */

static void check_whole(struct sim_stored *f)
{
    struct job *job = sim_stored_job(f);

    sim_stored_render(f);
    assert_int_equal(job->state, JOB_STATE_DONE);
    assert_int_equal(job->frames_done_count, 2);
    assert_int_equal(job->cut_count, 0);
    assert_int_equal(job->samples_done, 2 * job_frame_samples(job));
    assert_int_equal(f->sim->wrong_frames, 0); /* the same bits */
    assert_false(job->marks & JOB_MARK_EARLY);
}

static void a_paused_job_stays_paused(void **state)
{
    struct sim_stored *f = *state;
    struct job *job = sim_job_in(f, JOB_STATE_PAUSED);

    assert_string_equal(job->state_text, "paused by ana@desk");
    sim_stored_render(f);
    assert_int_equal(job->state, JOB_STATE_PAUSED);
    assert_null(job->frames); /* its film is on disk */
    for (int i = 0; i < 2; i++)
        sim_stored_restart(f);
    sim_stored_render(f);
    job = sim_stored_job(f);
    assert_int_equal(job->state, JOB_STATE_PAUSED);
    assert_string_equal(job->state_text, "paused by ana@desk");
    assert_int_equal(job->samples_done, 0);
    assert_int_equal(do_verb(&f->sim->farm, job, VERB_RESUME, "ben@desk", f->sim->now_ns, NULL), STATUS_OK);
    sim_stored_restart(f);
    assert_int_equal(sim_stored_job(f)->state, JOB_STATE_QUEUED);
    check_whole(f);
}

static void a_finished_job_has_its_first_pass(void **state)
{
    struct sim_stored *f = *state;
    struct job *job = sim_job_in(f, JOB_STATE_FINISHING);

    for (int i = 0; i < 2; i++) { /* killed in the middle of it */
        sim_stored_tick(f);
        assert_int_equal(sim_stored_job(f)->frames->end, FRAME_END_NONE); /* two tiles have no sample */
        sim_stored_restart(f);
        job = sim_stored_job(f);
        assert_int_equal(job->state, JOB_STATE_FINISHING);
        assert_non_null(job->frames);
    }
    sim_stored_render(f);
    assert_int_equal(job->state, JOB_STATE_DONE);
    assert_true(job->marks & JOB_MARK_EARLY);
    assert_string_equal(job->state_text, "finished early");
    assert_int_equal(job->frames_done_count, 1); /* frame 2 was not begun */
    assert_int_equal(job->cut_count, 1);
    assert_int_equal(job->cuts[0].end, FRAME_END_FINISH);
    assert_in_range(job->cuts[0].coverage.least, 2, 4); /* one pass of one group, or of both */
    assert_in_range(job->cuts[0].coverage.most, 2, 4);
    assert_int_equal(job->cuts[0].coverage.tiles_empty, 0);
    assert_true(job_frame_is_left(job, 2) && job_frames_left(job) == 1);
    sim_stored_restart(f);
    job = sim_stored_job(f);
    assert_int_equal(job->state, JOB_STATE_DONE);
    assert_true(job_frame_is_left(job, 2) && job_frames_left(job) == 1);
    assert_int_equal(do_verb(&f->sim->farm, job, VERB_RETRY, "ana@desk", f->sim->now_ns, NULL), STATUS_OK);
    sim_stored_restart(f);
    assert_int_equal(sim_stored_job(f)->frames_done_count, 0);
    check_whole(f);
}

/* A frame that has its first pass ends at once. */
static void a_covered_frame_ends_now(void **state)
{
    struct sim_stored *f = *state;
    struct job *job = sim_submit(f->sim, 32, 32, 32, 1, 1, 0);
    struct sim_worker *worker = sim_stored_connect(f, 16);
    size_t count = sim_grant(f->sim, worker, 12), sent = 0;

    for (size_t i = 0; i < count; i++)
        if (worker->units[i].name.pass == 0 || worker->units[i].name.tile == 3) {
            (void)sim_send(f->sim, worker, i, 100);
            sent++;
        }
    assert_in_range(sent, 8, count - 1);
    assert_int_equal(do_verb(&f->sim->farm, job, VERB_FINISH, "ana@desk", f->sim->now_ns, NULL), STATUS_OK);
    assert_int_equal(worker->worker.held.units, 0);
    assert_int_equal(sim_grant(f->sim, worker, 12), 0);
    sim_stored_tick(f);
    sim_develop(f->sim);
    assert_int_equal(job->state, JOB_STATE_DONE);
    assert_true(job->marks & JOB_MARK_EARLY);
    assert_int_equal(job->cuts[0].coverage.least, 4);
}

static void nothing_in_work_cannot_be_finished(void **state)
{
    struct sim_stored *f = *state;
    struct job *job = sim_submit(f->sim, 32, 32, 32, 1, 2, 0);
    struct error err = {0};

    assert_int_equal(do_verb(&f->sim->farm, job, VERB_FINISH, "ana@desk", f->sim->now_ns, &err), STATUS_ERR_REFUSED);
    assert_non_null(strstr(err.text, "no frame in work"));
    assert_null(strstr(err.text, "remove")); /* which is refused until the job has ended */
    assert_int_equal(job->state, JOB_STATE_QUEUED);
}

static void failed_and_cancelled_jobs_go_on(void **state)
{
    static const enum job_state ends[] = {JOB_STATE_FAILED, JOB_STATE_CANCELLED};
    struct sim_stored *f = *state;

    for (size_t i = 0; i < 2; i++) {
        struct job *job = sim_job_running(f);

        sim_stored_tick(f);
        if (ends[i] == JOB_STATE_FAILED)
            farm_fail(&f->sim->farm, job, f->sim->now_ns, "a broken scene");
        else
            farm_cancel(&f->sim->farm, job, 0, f->sim->now_ns);
        sim_develop(f->sim);
        sim_stored_tick(f);
        assert_int_equal(job->state, ends[i]);
        sim_stored_restart(f);
        job = sim_stored_job(f);
        assert_int_equal(job->state, ends[i]);
        assert_true(store_film_exists(f->store, job->id, 1));
        assert_int_equal(do_verb(&f->sim->farm, job, VERB_RETRY, "ana@desk", f->sim->now_ns, NULL), STATUS_OK);
        sim_stored_restart(f);
        job = sim_stored_job(f);
        assert_non_null(farm_frame_open(&f->sim->farm, job, 1, f->sim->now_ns));
        assert_true(film_samples(job->frames->film) > 0); /* from its film */
        check_whole(f);
        sim_stored_tear_down(state);
        sim_stored_set_up(state);
        f = *state;
    }
}

static void retry_takes_only_the_named_frames(void **state)
{
    struct sim_stored *f = *state;
    struct job *job = sim_job_in(f, JOB_STATE_FAILED);
    const uint32_t second = 2, none = 3;

    assert_int_equal(do_verb_with(&f->sim->farm, job, VERB_RETRY_FRAMES, none, "ana@desk", f->sim->now_ns, NULL), STATUS_ERR_INPUT);
    assert_int_equal(job->state, JOB_STATE_FAILED);
    assert_int_equal(do_verb_with(&f->sim->farm, job, VERB_RETRY_FRAMES, second, "ana@desk", f->sim->now_ns, NULL), STATUS_OK);
    sim_stored_restart(f);
    sim_stored_render(f);
    job = sim_stored_job(f);
    assert_int_equal(job->state, JOB_STATE_DONE);
    assert_true(job_frame_is_done(job, 2) && job_frame_is_left(job, 1));
    assert_int_equal(f->sim->wrong_frames, 0);
}

static void priority_changes_the_order(void **state)
{
    struct sim_stored *f = *state;
    struct queue *queue = &f->sim->farm.queue;
    struct job *first = sim_submit(f->sim, 32, 32, 32, 1, 1, 0);
    struct job *second = sim_submit(f->sim, 32, 32, 32, 1, 1, 0);
    struct job *parked = sim_submit(f->sim, 32, 32, 32, 1, 1, 0);

    assert_int_equal(do_verb(&f->sim->farm, parked, VERB_PAUSE, "ana@desk", f->sim->now_ns, NULL), STATUS_OK);
    assert_ptr_equal(queue->active[0], first);
    assert_int_equal(do_verb_with(&f->sim->farm, second, VERB_PRIORITY, 1, "ana@desk", 0, NULL), STATUS_OK);
    assert_ptr_equal(queue->active[0], second);
    assert_int_equal(do_verb_with(&f->sim->farm, parked, VERB_PRIORITY, 2, "ana@desk", 0, NULL), STATUS_OK);
    assert_ptr_equal(queue->active[0], parked);
    assert_int_equal(waiting_order(&f->sim->farm, f->sim->now_ns)->count, 2);
    assert_int_equal(second->place.before, 0);
    assert_int_equal(first->place.before, 1);
    sim_stored_restart(f);
    assert_int_equal(queue->active[0]->id, 3);
    assert_int_equal(queue->active[1]->priority, 1);
    assert_int_equal(do_verb_with(&f->sim->farm, queue->active[1], VERB_PRIORITY, (uint32_t)-1, "ana@desk", 0, NULL), STATUS_OK);
    assert_int_equal(queue->active[1]->priority, 0);
}

/* ---- remove ---------------------------------------------------------------------------------- */

static int exists(const struct sim_stored *f, const char *name)
{
    char path[128];

    snprintf(path, sizeof path, "%s/%s", f->folder, name);
    return access(path, F_OK) == 0;
}

static void removing_leaves_nothing(void **state)
{
    struct sim_stored *f = *state;
    struct job *job = sim_job_in(f, JOB_STATE_FAILED), *other;
    struct buffer picture = BUFFER_INIT;

    buffer_puts(&picture, "pixels");
    assert_int_equal(store_output_write(f->store, job->id, 1, "png", &picture, NULL), STATUS_OK);
    buffer_release(&picture);
    assert_true(exists(f, "outputs/1") && exists(f, "films/1"));
    assert_int_equal(do_verb(&f->sim->farm, job, VERB_REMOVE, "ana@desk", f->sim->now_ns, NULL), STATUS_OK);
    store_settle(f->store);
    assert_false(exists(f, "outputs/1") || exists(f, "films/1"));
    sim_stored_restart(f);
    assert_int_equal(f->sim->farm.queue.count, 0);
    other = sim_submit(f->sim, 32, 32, 32, 1, 1, 0);
    assert_int_equal(other->id, 2); /* numbers are not used again */
}

/* Killed between the rows and the files. */
static void removing_is_completed_at_the_start(void **state)
{
    struct sim_stored *f = *state;

    sim_job_in(f, JOB_STATE_FAILED);
    assert_int_equal(store_job_remove(f->store, 1, NULL), STATUS_OK);
    assert_true(exists(f, "films/1"));
    sim_stored_restart(f);
    assert_int_equal(f->sim->farm.queue.count, 0);
    store_settle(f->store);
    assert_false(exists(f, "films/1"));
}

static void a_job_that_is_held_is_freed_later(void **state)
{
    struct sim_stored *f = *state;
    struct job *job = sim_job_running(f);

    sim_stored_tick(f);
    farm_cancel(&f->sim->farm, job, 0, f->sim->now_ns);
    assert_int_equal(f->sim->developing_count, 1);
    farm_cancel(&f->sim->farm, job, 1, f->sim->now_ns);
    assert_int_equal(job->closing_frames, 1);
    assert_int_equal(do_verb(&f->sim->farm, job, VERB_REMOVE, "ana@desk", f->sim->now_ns, NULL), STATUS_OK);
    assert_int_equal(f->sim->farm.queue.count, 0);
    assert_int_equal(job->removed, 1); /* still there for the develop */
    sim_develop(f->sim);
    store_settle(f->store);
    assert_false(exists(f, "films/1"));
}

/* A develop that was under way keeps its film after the others were removed. */
static void discarded_films_do_not_come_back(void **state)
{
    struct sim_stored *f = *state;
    struct job *job = sim_job_running(f);
    char path[128];

    sim_stored_tick(f);
    farm_cancel(&f->sim->farm, job, 0, f->sim->now_ns);
    farm_cancel(&f->sim->farm, job, 1, f->sim->now_ns);
    store_settle(f->store);
    assert_false(exists(f, "films/1"));
    snprintf(path, sizeof path, "%s/films/1", f->folder);
    assert_int_equal(mkdir(path, 0700), 0);
    snprintf(path, sizeof path, "%s/films/1/frame-0001.kept", f->folder);
    assert_int_equal(file_write_atomic(path, "means", 5, NULL), STATUS_OK);
    sim_develop(f->sim);
    sim_stored_tick(f);
    store_settle(f->store);
    assert_false(exists(f, "films/1"));
}

/* ---- the log --------------------------------------------------------------------------------- */

struct lines {
    size_t count, from_workers;
    uint64_t first, last;
    char text[4096];
};

static status take_line(void *user, const struct job_event *event, struct error *err)
{
    struct lines *lines = user;
    size_t used = strlen(lines->text);

    (void)err;
    if (lines->count++ == 0)
        lines->first = event->seq;
    assert_true(event->seq > lines->last);
    lines->last = event->seq;
    lines->from_workers += (size_t)event->from_worker;
    if (lines->count < 20)
        snprintf(lines->text + used, sizeof lines->text - used, "%s: %s\n", event->who, event->text);
    return STATUS_OK;
}

static void the_log_names_people(void **state)
{
    struct sim_stored *f = *state;
    struct job *job = sim_job_in(f, JOB_STATE_PAUSED);
    struct lines lines = {0};

    sim_stored_restart(f);
    job = sim_stored_job(f);
    assert_int_equal(do_verb(&f->sim->farm, job, VERB_RESUME, "ben@desk", f->sim->now_ns, NULL), STATUS_OK);
    assert_int_equal(do_verb_with(&f->sim->farm, job, VERB_PRIORITY, 3, "ben@desk", f->sim->now_ns, NULL), STATUS_OK);
    assert_int_equal(do_verb(&f->sim->farm, job, VERB_DISCARD, "cy@desk", f->sim->now_ns, NULL), STATUS_OK);
    assert_int_equal(store_events_load(f->store, job->id, 0, take_line, &lines, NULL), STATUS_OK);
    assert_string_equal(lines.text, "coordinator: submitted as simulated\n"
                                    "coordinator: runs, first on \n"
                                    "ana@desk: paused\n"
                                    "ben@desk: resumed\n"
                                    "ben@desk: priority 3, was 0\n"
                                    "cy@desk: cancel, discarding unfinished frames\n"
                                    "coordinator: cancelled, unfinished frames discarded: 0 of 2 "
                                    "frames have a picture\n");
}

static void the_log_is_bounded(void **state)
{
    struct sim_stored *f = *state;
    struct job_event event = {.job = 5, .who = "ana@desk"};
    struct lines lines = {0}, rest = {0};

    for (int i = 0; i < JOB_EVENTS_MAX + 50; i++) {
        snprintf(event.text, sizeof event.text, "event %d", i);
        event.from_worker = 0;
        store_event_later(f->store, &event);
        event.from_worker = i < JOB_WORKER_LINES_MAX + 10;
        if (event.from_worker)
            store_event_later(f->store, &event);
    }
    store_settle(f->store);
    assert_int_equal(store_events_load(f->store, 5, 0, take_line, &lines, NULL), STATUS_OK);
    assert_int_equal(lines.from_workers, JOB_WORKER_LINES_MAX);
    assert_int_equal(lines.count, JOB_EVENTS_MAX + JOB_WORKER_LINES_MAX);
    assert_int_equal(store_events_load(f->store, 5, lines.last - 1, take_line, &rest, NULL), STATUS_OK);
    assert_int_equal(rest.count, 1);
    assert_string_equal(rest.text, "ana@desk: event 1049\n");
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, sim_stored_set_up, sim_stored_tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(every_edge),
        TEST(every_verb_in_every_state),
        TEST(the_documents_have_the_table),
        TEST(a_paused_job_stays_paused),
        TEST(a_finished_job_has_its_first_pass),
        TEST(a_covered_frame_ends_now),
        TEST(nothing_in_work_cannot_be_finished),
        TEST(failed_and_cancelled_jobs_go_on),
        TEST(retry_takes_only_the_named_frames),
        TEST(priority_changes_the_order),
        TEST(removing_leaves_nothing),
        TEST(removing_is_completed_at_the_start),
        TEST(a_job_that_is_held_is_freed_later),
        TEST(discarded_films_do_not_come_back),
        TEST(the_log_names_people),
        TEST(the_log_is_bounded),
    };
    return cmocka_run_group_tests_name("steer", tests, NULL, NULL);
}
