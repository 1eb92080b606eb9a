/* Two verbs, one after the other, on a job in each state, and the coordinator killed before, between and after their
 * writes: what is on disk is the job before the first, after it, or after both, and nothing else; what was answered is
 * on disk; and the second verb, given after the restart, leads where both lead undisturbed. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <errno.h>
#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/base/memory.h"
#include "common/system/clock.h"
#include "common/system/file.h"
#include "coordinator/store/store_parts.h"
#include "tests/support/sim_states.h"
#include "tests/support/steering.h"

/* ---- the writer thread, stopped ---------------------------------------------------------------- */

/* Where SQLite calls us, in the store's thread. */
static struct {
    pthread_mutex_t lock;
    pthread_cond_t moved;
    int passes;   /* transactions that may still be committed; -1: all */
    int fails;    /* the others are not held, but fail */
    int held;     /* one is: it is made, and not committed */
    int files;    /* hold it when it is committed, before files are removed */
    int answered; /* who waited for the disk and was told that it is written, */
    int refused;  /* or not */
} gate = {.lock = PTHREAD_MUTEX_INITIALIZER, .moved = PTHREAD_COND_INITIALIZER, .passes = -1};

static int is_shut(void) { return gate.passes == 0 && !gate.fails; }

static int is_before_files(void) { return gate.files; }

static void hold_while(int (*shut)(void))
{
    while (shut()) {
        gate.held = 1;
        pthread_cond_broadcast(&gate.moved);
        pthread_cond_wait(&gate.moved, &gate.lock);
    }
    gate.held = 0;
    pthread_cond_broadcast(&gate.moved);
}

static int at_commit(void *user)
{
    int fails;

    (void)user;
    pthread_mutex_lock(&gate.lock);
    hold_while(is_shut);
    fails = gate.passes == 0 && gate.fails;
    gate.passes -= gate.passes > 0;
    pthread_mutex_unlock(&gate.lock);
    return fails;
}

/* After a commit. */
static int at_log(void *user, sqlite3 *db, const char *name, int pages)
{
    (void)user;
    (void)db;
    (void)name;
    (void)pages;
    pthread_mutex_lock(&gate.lock);
    hold_while(is_before_files);
    pthread_mutex_unlock(&gate.lock);
    return SQLITE_OK;
}

static void set_gate(int passes, int fails, int files)
{
    pthread_mutex_lock(&gate.lock);
    gate.passes = passes;
    gate.fails = fails;
    gate.files = files;
    pthread_cond_broadcast(&gate.moved);
    while (gate.held && !is_shut() && !is_before_files())
        pthread_cond_wait(&gate.moved, &gate.lock);
    pthread_mutex_unlock(&gate.lock);
}

static int has_work(struct store *store)
{
    int has;

    pthread_mutex_lock(&store->lock);
    has = store->busy || store->saves || store->changes.first || store->clears.first || store->events.first ||
          store->workers.first || store->shares || store->waits;
    pthread_mutex_unlock(&store->lock);
    return has;
}

/* Wait until the writer is held, or has nothing to write. 0: it has nothing. */
static int await_writer(struct store *store)
{
    for (;;) {
        int held;
        pthread_mutex_lock(&gate.lock);
        held = gate.held;
        pthread_mutex_unlock(&gate.lock);
        if (held || !has_work(store))
            return held;
        usleep(50);
    }
}

static int saves_failed(struct store *store)
{
    int failed;

    pthread_mutex_lock(&store->lock);
    failed = store->failing && !store->busy && !store->retry;
    pthread_mutex_unlock(&store->lock);
    return failed;
}

static void on_saved(void *user, status result, const struct error *why)
{
    (void)user;
    (void)why;
    gate.answered += result == STATUS_OK;
    gate.refused += result != STATUS_OK;
}

/* ---- folders ------------------------------------------------------------------------------------ */

static const char *copy_from, *copy_to;

static int copy_entry(const char *path, const struct stat *info, int kind, struct FTW *where)
{
    struct buffer bytes = BUFFER_INIT;
    char to[512];

    (void)where;
    snprintf(to, sizeof to, "%s%s", copy_to, path + strlen(copy_from));
    if (kind == FTW_D)
        return strcmp(path, copy_from) != 0 && mkdir(to, info->st_mode & 0777) != 0;
    if (kind == FTW_F && !strstr(path, "-shm") && file_read(path, 1 << 28, &bytes, NULL) == STATUS_OK) {
        FILE *out = fopen(to, "wb");
        assert_non_null(out);
        assert_int_equal(fwrite(bytes.data, 1, bytes.size, out), bytes.size);
        assert_int_equal(fclose(out), 0);
    }
    buffer_release(&bytes);
    return 0;
}

static void copy_tree(const char *from, const char *to)
{
    copy_from = from;
    copy_to = to;
    while (nftw(from, copy_entry, 16, FTW_PHYS) != 0) {
        assert_int_equal(errno, ENOENT); /* the trash is being emptied */
        file_remove_tree(to);
        assert_int_equal(mkdir(to, 0700), 0);
    }
}

/* What a kill would leave at this moment, in a farm that starts with it. */
static struct sim_stored *start_with_copy(const char *folder)
{
    struct sim_stored *f = calloc(1, sizeof *f);

    assert_non_null(f);
    f->sim = calloc(1, sizeof *f->sim);
    assert_non_null(f->sim);
    scratch_folder(f->folder);
    copy_tree(folder, f->folder);
    f->store = sim_store(f->folder);
    sim_init(f->sim, f->store, 1);
    f->workers = 0;
    return f;
}

static void end_quietly(struct sim_stored *f)
{
    void *state = f;

    sim_stored_tear_down(&state);
}

static void end(struct sim_stored *f)
{
    set_gate(-1, 0, 0);
    end_quietly(f);
}

/* ---- what a job is ------------------------------------------------------------------------------ */

/* A store with a job in that state. */
struct begin {
    enum job_state state;
    char folder[SCRATCH_PATH];
};

struct pair {
    const struct begin *begin;
    enum job_verb_name verb[2];
    struct buffer after[3]; /* what a restart finds after none of them, one, both */
    struct buffer at_end;   /* the same, after both, when all is rendered */
    char text[128];
};

/* A discard that a retry follows before it is on disk may leave a film, whose samples are good. */
static int films_count(const struct pair *p)
{
    return p->verb[0] != VERB_DISCARD || (p->verb[1] != VERB_RETRY && p->verb[1] != VERB_RETRY_FRAMES);
}

static void describe(const struct pair *p, struct sim_stored *f, struct buffer *out)
{
    struct job *job = f->sim->farm.queue.count ? sim_stored_job(f) : NULL;
    char rules[STOP_RULES_TEXT_SIZE], after[NEEDS_AFTER_TEXT_SIZE];

    buffer_clear(out);
    if (!job) {
        buffer_printf(out, "gone%s", store_film_exists(f->store, 1, 1) ? " film" : "");
        return;
    }
    stop_rules_text(rules, &job->stop, job->settings.spp);
    needs_after_text(after, &job->needs);
    buffer_printf(out, "%s (%s), marks %x, priority %d, comment '%s', after '%s', not before %d, %s, %s;",
                  job_state_word(job->state == JOB_STATE_RUNNING ? JOB_STATE_QUEUED : job->state), job->state_text,
                  job->marks, job->priority, job->comment, after, job->needs.not_before != 0, rules,
                  job->output.tonemap.op->name);
    for (uint32_t frame = job->first_frame; frame <= job->last_frame; frame++)
        buffer_printf(out, " frame %u%s%s%s%s%s", frame, job_frame_is_done(job, frame) ? " done" : "",
                      job_frame_is_developed(job, frame) ? " developed" : "",
                      job_frame_is_cut(job, frame) ? " cut" : "", job_frame_is_resting(job, frame) ? " resting" : "",
                      films_count(p) && store_film_exists(f->store, job->id, frame) ? " film" : "");
}

static void expect(const struct pair *p, struct sim_stored *f, const struct buffer *right, const char *what)
{
    struct buffer is = BUFFER_INIT;

    describe(p, f, &is);
    if (strcmp(buffer_text(&is), buffer_text((struct buffer *)right)) != 0)
        fail_msg("%s\n  is        %s\n  should be %s", what, buffer_text(&is), buffer_text((struct buffer *)right));
    buffer_release(&is);
}

/* ---- the verbs ---------------------------------------------------------------------------------- */

static uint32_t argument(enum job_verb_name verb, int second)
{
    switch (verb) {
    case VERB_PRIORITY: return second ? 9 : 7;
    case VERB_RETRY_FRAMES: return second ? 1 : 2;
    case VERB_EXTEND: return second ? 128 : 64;
    case VERB_COMMENT: return second;
    case VERB_DISCARD: return 1;
    default: return 0;
    }
}

static status do_it(struct sim_stored *f, enum job_verb_name verb, int second)
{
    struct error err = {0};

    if (f->sim->farm.queue.count == 0)
        return STATUS_ERR_NOT_FOUND;
    return do_verb_with(&f->sim->farm, sim_stored_job(f), verb, argument(verb, second), "ana@desk", f->sim->now_ns, &err);
}

/* A farm that has just started with it. */
static struct sim_stored *start(const struct pair *p)
{
    struct sim_stored *f = start_with_copy(p->begin->folder);
    struct job *job = sim_stored_job(f);

    if (p->begin->state == JOB_STATE_RUNNING)
        assert_true(sim_grant(f->sim, sim_stored_connect(f, 4), 4) > 0);
    if (p->verb[0] == VERB_START || p->verb[1] == VERB_START) {
        job->needs.not_before = INT64_MAX;
        job->needs.after[job->needs.after_count++] = 1;
        farm_job_save(&f->sim->farm, job, f->sim->now_ns);
    }
    store_settle(f->store);
    sqlite3_commit_hook(f->store->db, at_commit, NULL);
    sqlite3_wal_hook(f->store->db, at_log, NULL);
    gate.answered = gate.refused = 0;
    return f;
}

static void render_to_end(const struct pair *p, struct sim_stored *f, struct buffer *out)
{
    store_settle(f->store);
    sim_stored_render(f);
    store_settle(f->store);
    if (p->verb[0] != VERB_DEVELOP && p->verb[1] != VERB_DEVELOP) /* an operator that others froze is none of the check's */
        assert_int_equal(f->sim->wrong_frames, 0);
    describe(p, f, out);
}

/* Undisturbed, with an orderly restart. 0: a verb was refused. */
static int find_right(struct pair *p, int count)
{
    struct sim_stored *f = start(p);
    int taken = 1;

    for (int i = 0; i < count && taken; i++) {
        taken = do_it(f, p->verb[i], i) == STATUS_OK;
        store_settle(f->store);
    }
    if (taken) {
        sim_stored_restart(f);
        store_settle(f->store);
        describe(p, f, &p->after[count]);
        if (count > 0 && p->verb[count - 1] == VERB_DISCARD && strstr(buffer_text(&p->after[count]), "film"))
            fail_msg("discarded, and there is a film: %s", buffer_text(&p->after[count]));
    }
    if (taken && count == 2)
        render_to_end(p, f, &p->at_end);
    end(f);
    return taken;
}

/* Killed now, with so many of the verbs on disk: what the next start finds. With `go_on` the others are given then, and all
 * is rendered. */
static void kill_here(struct pair *p, const struct sim_stored *f, int count, int go_on, const char *when)
{
    struct sim_stored *g = start_with_copy(f->folder);
    struct buffer last = BUFFER_INIT;
    char what[256];

    snprintf(what, sizeof what, "%s, killed %s", p->text, when);
    store_settle(g->store);
    expect(p, g, &p->after[count], what);
    if (go_on) {
        for (int i = count; i < 2; i++) {
            (void)do_it(g, p->verb[i], i);
            store_settle(g->store);
        }
        sim_stored_restart(g);
        store_settle(g->store);
        snprintf(what, sizeof what, "%s, killed %s, then what was missing", p->text, when);
        expect(p, g, &p->after[2], what);
        render_to_end(p, g, &last);
        if (strcmp(buffer_text(&last), buffer_text(&p->at_end)) != 0)
            fail_msg("%s, at the end\n  is        %s\n  should be %s", what, buffer_text(&last), buffer_text(&p->at_end));
    }
    buffer_release(&last);
    end_quietly(g);
}

/* The verb's changes in one transaction, which is held where the gate says. */
static void do_at_once(struct sim_stored *f, struct pair *p, int first, int count)
{
    pthread_mutex_lock(&f->store->order);
    for (int i = first; i < first + count; i++)
        (void)do_it(f, p->verb[i], i);
    assert_int_equal(store_when_saved(f->store, on_saved, NULL, NULL), STATUS_OK);
    pthread_mutex_unlock(&f->store->order);
}

static void both_at_once(struct pair *p) /* in one transaction */
{
    struct sim_stored *f = start(p);

    set_gate(0, 0, 0);
    do_at_once(f, p, 0, 2);
    await_writer(f->store);
    kill_here(p, f, 0, 1, "before both are written");
    set_gate(-1, 0, 0);
    store_settle(f->store);
    kill_here(p, f, 2, 0, "after both are written");
    end(f);
}

static void one_by_one(struct pair *p)
{
    struct sim_stored *f = start(p);
    int held;

    set_gate(0, 0, 0);
    do_at_once(f, p, 0, 1);
    held = await_writer(f->store);
    store_deliver(f->store);
    assert_int_equal(gate.answered, !held);
    (void)do_it(f, p->verb[1], 1);
    set_gate(held, 0, 0);
    await_writer(f->store);
    kill_here(p, f, 1, 1, "between both");
    store_deliver(f->store);
    assert_int_equal(gate.answered, 1);
    end(f);
}

static void before_the_files(struct pair *p)
{
    struct sim_stored *f = start(p);

    set_gate(-1, 0, 1);
    do_at_once(f, p, 0, 1);
    await_writer(f->store);
    kill_here(p, f, 1, 0, "when the first is written, and no file is removed");
    end(f);
}

/* The disk hangs on the first, gets the second, fails, and works again. */
static void the_disk_fails(struct pair *p)
{
    struct sim_stored *f = start(p);
    struct error err = {0};
    char what[256];

    set_gate(0, 0, 0);
    do_at_once(f, p, 0, 1);
    await_writer(f->store);
    (void)do_it(f, p->verb[1], 1);
    set_gate(0, 1, 0);
    while (has_work(f->store) && !gate.refused && !saves_failed(f->store)) {
        store_deliver(f->store);
        usleep(50);
    }
    kill_here(p, f, 0, 0, "while the disk fails");
    set_gate(-1, 0, 0);
    while (store_check(f->store, &err) != STATUS_OK)
        usleep(50); /* it says so until it is written */
    store_settle(f->store);
    snprintf(what, sizeof what, "%s, alive when the disk works again", p->text);
    expect(p, f, &p->after[2], what);
    kill_here(p, f, 2, 0, "when the disk works again");
    end(f);
}

/* Lent after the second, while the first is being written: what is rendered is in a film that a restart finds. */
static void lent_meanwhile(struct pair *p)
{
    struct sim_stored *f = start(p);
    struct sim_worker *worker = sim_stored_connect(f, 4);

    set_gate(0, 0, 0);
    do_at_once(f, p, 0, 1);
    await_writer(f->store);
    (void)do_it(f, p->verb[1], 1);
    if (sim_grant(f->sim, worker, 4) > 0) {
        const uint32_t frame = worker->units[0].frame;
        set_gate(-1, 0, 0);
        store_settle(f->store);
        (void)sim_send(f->sim, worker, 0, 100);
        sim_commit(f->sim);
        store_settle(f->store);
        sim_stored_restart(f);
        if (!store_film_exists(f->store, sim_stored_job(f)->id, frame))
            fail_msg("%s: frame %u was rendered meanwhile, and its film is gone", p->text, frame);
    }
    end(f);
}

/* ---- all of them -------------------------------------------------------------------------------- */

static void make_begin(struct begin *out, enum job_state state)
{
    struct sim_stored *f;
    void *made;

    sim_stored_set_up(&made);
    f = made;
    out->state = state;
    (void)sim_job_in(f, state);
    store_settle(f->store);
    scratch_folder(out->folder);
    copy_tree(f->folder, out->folder);
    sim_stored_tear_down(&made);
}

static void (*const moments[])(struct pair *p) = {both_at_once, one_by_one, the_disk_fails};
enum { MOMENTS = sizeof moments / sizeof moments[0] };

/* At one of the moments, or with `moment` < 0 at all. 0: a verb is refused. */
static int try_pair(struct pair *p, int moment)
{
    int tried;

    snprintf(p->text, sizeof p->text, "%s, then %s, of a job that is %s", job_verbs[p->verb[0]].name,
             job_verbs[p->verb[1]].name, job_state_word(p->begin->state));
    tried = find_right(p, 2) && (moment == 1 || find_right(p, 0)) && ((moment >= 0 && moment != 1) || find_right(p, 1));
    for (int i = 0; i < MOMENTS && tried; i++)
        if (moment < 0 || i == moment)
            moments[i](p);
    if (tried && (moment < 0 || p->verb[0] == VERB_DISCARD)) /* which removes films */
        lent_meanwhile(p);
    for (int i = 0; i < 3; i++)
        buffer_release(&p->after[i]);
    buffer_release(&p->at_end);
    return tried;
}

static size_t try_verbs(const struct begin begins[JOB_STATE_COUNT], int a, int b, int all)
{
    size_t tried = 0;

    for (int s = 0; s < JOB_STATE_COUNT && (all || !tried); s++) {
        const struct begin *begin = &begins[(a + b + s) % JOB_STATE_COUNT];
        struct pair p = {.begin = begin, .verb = {(enum job_verb_name)a, (enum job_verb_name)b}};

        if (!((job_verbs[a].states | job_verbs[a].accepted) >> begin->state & 1))
            continue;
        if (b == 0 && find_right(&p, 1)) {
            snprintf(p.text, sizeof p.text, "%s, of a job that is %s", job_verbs[a].name, job_state_word(begin->state));
            before_the_files(&p);
            buffer_release(&p.after[1]);
        }
        tried += (size_t)try_pair(&p, all ? -1 : (a + b) % MOMENTS);
    }
    return tried;
}

/* In each state that takes both, at each moment; without TWO_VERBS=all in one state, at one moment. */
static void every_two(void **state)
{
    struct begin begins[JOB_STATE_COUNT];
    const char *which = getenv("TWO_VERBS");
    const int all = which && strcmp(which, "all") == 0;
    size_t tried = 0;

    (void)state;
    for (int s = 0; s < JOB_STATE_COUNT; s++)
        make_begin(&begins[s], (enum job_state)s);
    for (int a = 0; a < VERB_COUNT; a++)
        for (int b = 0; b < VERB_COUNT; b++)
            tried += try_verbs(begins, a, b, all);
    for (int s = 0; s < JOB_STATE_COUNT; s++)
        file_remove_tree(begins[s].folder);
    print_message("%zu pairs\n", tried);
    assert_true(tried >= (all ? 500 : 110));
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_two)};

    return cmocka_run_group_tests_name("two_verbs", tests, NULL, NULL);
}
