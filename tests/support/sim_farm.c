#include "tests/support/sim_farm.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "common/system/clock.h"
#include "common/system/file.h"
#include "coordinator/pictures/measured.h"
#include "coordinator/farm/freeze.h"
#include "coordinator/farm/scheduler.h"
#include "coordinator/film/store_film.h"
#include "tests/support/film_data.h"

static void on_revoke(void *user, uint32_t session, uint64_t lease, const char *reason)
{
    struct sim *sim = user;

    (void)reason;
    sim->revokes++;
    for (unsigned w = 0; w < SIM_WORKERS_MAX; w++) {
        struct sim_worker *worker = &sim->workers[w];
        if (!worker->connected || worker->worker.held.session != session)
            continue;
        for (size_t i = worker->unit_count; i-- > 0;)
            if (worker->units[i].lease == lease)
                sim_forget(worker, i);
    }
}

static void on_ack(void *user, uint32_t session, const struct job *job, uint32_t frame, struct unit_name unit)
{
    struct sim *sim = user;

    sim->acks++;
    for (unsigned w = 0; w < SIM_WORKERS_MAX; w++) {
        struct sim_worker *worker = &sim->workers[w];
        if (worker->worker.held.session != session)
            continue;
        for (size_t i = worker->unit_count; i-- > 0;) {
            const struct sim_unit *u = &worker->units[i];
            if (u->sent && u->job == job->id && u->frame == frame && u->name.tile == unit.tile &&
                u->name.group == unit.group && u->name.pass == unit.pass)
                sim_forget(worker, i);
        }
    }
}

static void on_notice(void *user, uint32_t session, const char *text)
{
    struct sim *sim = user;

    sim->notices++;
    sim->notice_session = session;
    snprintf(sim->notice, sizeof sim->notice, "%s", text);
}

static void on_job_changed(void *user, struct job *job)
{
    struct sim *sim = user;

    (void)job;
    sim->changes++;
}

static status on_develop(void *user, struct job_frame *frame)
{
    struct sim *sim = user;

    assert_true(sim->developing_count < FRAMES_OPEN_MAX);
    sim->developing_epoch[sim->developing_count] = frame->job->epoch_floor;
    sim->developing[sim->developing_count++] = frame;
    return STATUS_OK;
}

static status on_redevelop(void *user, struct job *job, uint32_t frame)
{
    struct sim *sim = user;

    assert_null(sim->picture_job); /* one at a time */
    assert_true(job_frame_is_done(job, frame) && !job_frame_is_developed(job, frame));
    sim->picture_job = job;
    sim->picture_frame = frame;
    return STATUS_OK;
}

static status on_freeze(void *user, struct freezing *freezing, struct error *err)
{
    struct sim *sim = user;

    (void)err;
    assert_true(sim->freezing_count < SIM_FREEZINGS_MAX);
    sim->freezing[sim->freezing_count++] = freezing;
    return STATUS_OK;
}

void sim_freeze(struct sim *sim)
{
    while (sim->freezing_count > 0) {
        struct freezing *freezing = sim->freezing[--sim->freezing_count];
        freezing_run(freezing);
        freezing_end(&sim->farm, freezing, sim->now_ns);
    }
}

struct store *sim_store(const char *folder)
{
    struct store *store;
    struct error err = {0};

    if (store_open(&store, folder, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    return store;
}

void sim_init(struct sim *sim, struct store *store, uint64_t seed)
{
    struct farm_events events = {on_revoke, on_ack, on_notice, on_job_changed, on_develop,
                                 on_redevelop, NULL, on_freeze, sim, NULL, NULL, NULL, NULL};
    struct error err = {0};
    uint64_t now_ns = sim->now_ns;

    memset(sim, 0, offsetof(struct sim, workers));
    sim->developing_count = sim->freezing_count = 0;
    sim->tonemap = NULL;
    sim->picture_job = NULL;
    sim->acks = sim->revokes = sim->notices = sim->changes = sim->developed = 0;
    sim->wrong_frames = 0;
    sim->now_ns = now_ns ? now_ns : 5 * NS_PER_SECOND;
    sim->random = seed * 2 + 1;
    sim->store = store;
    if (farm_init(&sim->farm, store, 10 * NS_PER_SECOND, &events, 1000, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    farm_resume(&sim->farm, sim->now_ns);
}

void sim_release(struct sim *sim)
{
    for (unsigned i = 0; i < SIM_WORKERS_MAX; i++)
        sim_disconnect(sim, i);
    /* A development that was begun ends unsuccessfully, as in a crash. */
    for (size_t i = 0; i < sim->developing_count; i++)
        farm_frame_unpin(&sim->farm, sim->developing[i]); /* frees a frame that was closed meanwhile */
    sim->developing_count = 0;
    /* So does a measurement; its note may have been written. */
    for (size_t i = 0; i < sim->freezing_count; i++) {
        if (sim_random(sim, 2))
            freezing_run(sim->freezing[i]);
        freezing_abandon(&sim->farm, sim->freezing[i]);
    }
    sim->freezing_count = 0;
    farm_release(&sim->farm, sim->now_ns);
}

struct sim *sim_new(struct store *store, uint64_t seed)
{
    struct sim *sim = calloc(1, sizeof *sim);

    assert_non_null(sim);
    sim_init(sim, store, seed);
    return sim;
}

void sim_free(struct sim *sim)
{
    sim_release(sim);
    free(sim);
}

int sim_set_up(void **state)
{
    *state = sim_new(NULL, 1);
    return 0;
}

int sim_tear_down(void **state)
{
    sim_free(*state);
    return 0;
}

static void begin(struct sim_stored *f)
{
    f->store = sim_store(f->folder);
    sim_init(f->sim, f->store, 1);
    f->workers = 0;
}

void sim_stored_restart(struct sim_stored *f)
{
    sim_release(f->sim);
    store_close(f->store);
    begin(f);
}

int sim_stored_set_up(void **state)
{
    struct sim_stored *f = calloc(1, sizeof *f);

    assert_non_null(f);
    scratch_folder(f->folder);
    f->sim = calloc(1, sizeof *f->sim);
    assert_non_null(f->sim);
    begin(f);
    *state = f;
    return 0;
}

int sim_stored_tear_down(void **state)
{
    struct sim_stored *f = *state;

    film_file_fault(-1);
    sim_release(f->sim);
    store_close(f->store);
    file_remove_tree(f->folder);
    free(f->sim);
    free(f);
    return 0;
}

uint32_t sim_random(struct sim *sim, uint32_t limit)
{
    sim->random = sim->random * 6364136223846793005ull + 1442695040888963407ull;
    return (uint32_t)((sim->random >> 33) % limit);
}

struct job *sim_job(uint32_t width, uint32_t height, uint32_t spp, uint32_t first_frame, uint32_t last_frame,
                    int32_t priority)
{
    struct job *job = job_new(first_frame, last_frame);
    size_t count;

    assert_non_null(job);
    render_settings_default(&job->settings);
    job->settings.width = width;
    job->settings.height = height;
    job->settings.spp = spp;
    job->priority = priority;
    job->output.exr = job->output.png = 1;
    snprintf(job->name, sizeof job->name, "simulated");
    assert_int_equal(tonemap_settings_init(&job->output.tonemap, tonemap_operators(&count)[0]->name, NULL), STATUS_OK);
    return job;
}

struct job *sim_submit(struct sim *sim, uint32_t width, uint32_t height, uint32_t spp, uint32_t first_frame,
                       uint32_t last_frame, int32_t priority)
{
    struct job *job = sim_job(width, height, spp, first_frame, last_frame, priority);
    struct error err = {0};

    assert_int_equal(tonemap_settings_init(&job->output.tonemap, sim->tonemap ? sim->tonemap : "linear", NULL),
                     STATUS_OK);
    if (farm_submit(&sim->farm, job, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    return job;
}

struct sim_worker *sim_connect(struct sim *sim, unsigned index, uint32_t threads)
{
    struct sim_worker *worker = &sim->workers[index];

    assert_false(worker->connected);
    memset(&worker->worker, 0, sizeof worker->worker);
    worker->connected = 1;
    worker->worker.held.session = ++sim->last_session;
    snprintf(worker->worker.deliverer.host, sizeof worker->worker.deliverer.host, "node-%u", index);
    worker->worker.deliverer.process = worker->worker.held.session;
    worker->worker.threads = threads;
    worker->worker.machine = index + 1;
    worker->worker.isa_mask = 7;
    snprintf(worker->worker.ray_tracer, sizeof worker->worker.ray_tracer, "tracer 1");
    assert_int_equal(farm_worker_add(&sim->farm, &worker->worker, NULL), STATUS_OK);
    worker->worker.credit.threads = threads; /* as if it had shown what it can do */
    return worker;
}

void sim_disconnect(struct sim *sim, unsigned index)
{
    if (!sim->workers[index].connected)
        return;
    farm_worker_remove(&sim->farm, &sim->workers[index].worker, 0, sim->now_ns);
    sim->workers[index].connected = 0;
}

void sim_die(struct sim *sim, unsigned index)
{
    struct sim_worker *worker = &sim->workers[index];

    assert_true(worker->connected);
    farm_worker_remove(&sim->farm, &worker->worker, 1, sim->now_ns);
    worker->connected = 0;
    worker->unit_count = 0;
}

size_t sim_grant(struct sim *sim, struct sim_worker *worker, uint32_t room)
{
    struct lease *lease;
    size_t before = worker->unit_count;

    worker->worker.room = room;
    while ((lease = scheduler_grant(&sim->farm, &worker->worker, sim->now_ns))) {
        for (uint32_t i = 0; i < lease->unit_count; i++) {
            assert_true(worker->unit_count < SIM_UNITS_MAX);
            worker->units[worker->unit_count++] = (struct sim_unit){
                lease->id, lease->epoch, lease->frame->job->id, lease->frame->number, lease->units[i], 0};
        }
    }
    return worker->unit_count - before;
}

size_t sim_sums(uint32_t width, uint32_t height, uint32_t frame, struct unit_name name, float *out)
{
    struct tile_rect rect = tile_rect_of(width, height, name.tile);
    size_t count = (size_t)PIXEL_FLOATS * rect.width * rect.height;

    for (size_t i = 0; i < count; i++) {
        out[i] = film_data_spread((uint32_t)i * 2654435761u ^ name.tile * 40503u ^
                                  (name.pass * GROUPS + name.group + 1) * 2246822519u ^ frame * 97u);
    }
    return count;
}

struct delivery sim_result(const struct sim *sim, const struct sim_unit *unit, float sums[TILE_FLOATS_MAX])
{
    const struct job *job = queue_find(&sim->farm.queue, unit->job);
    struct delivery result = {.lease = unit->lease, .epoch = unit->epoch, .job = unit->job, .frame = unit->frame,
                              .unit = {.name = unit->name, .sums = sums}};
    struct tile_rect rect;
    uint32_t begin, end;

    assert_non_null(job);
    rect = tile_rect_of(job->settings.width, job->settings.height, unit->name.tile);
    pass_range(job->settings.spp, unit->name.group, unit->name.pass, &begin, &end);
    result.unit.work.samples = (uint64_t)rect.width * rect.height * (end - begin);
    result.unit.count = sim_sums(job->settings.width, job->settings.height, unit->frame, unit->name, sums);
    return result;
}

enum merge_outcome sim_send(struct sim *sim, struct sim_worker *worker, size_t i, uint64_t cost_ns)
{
    static float sums[TILE_FLOATS_MAX];
    struct delivery result = sim_result(sim, &worker->units[i], sums);
    enum merge_outcome outcome = MERGE_PENDING;
    struct error err = {0};

    result.stats.cpu_ns = result.unit.work.samples * cost_ns;
    worker->units[i].sent = 1;
    if (merge_result(&sim->farm, &worker->worker, &result, sim->now_ns, &outcome, NULL, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    return outcome;
}

void sim_forget(struct sim_worker *worker, size_t i) { worker->units[i] = worker->units[--worker->unit_count]; }

void sim_commit(struct sim *sim)
{
    struct commit *commit = merge_commit_begin(&sim->farm, sim->now_ns);

    if (!commit)
        return;
    merge_commit_run(commit);
    merge_commit_end(&sim->farm, commit, sim->now_ns);
}

/* What development_revision says of a frame's first development. */
static int64_t sim_revision(const struct job *job)
{
    return job->output.tonemap.temporal > 1 ? -1 : (int64_t)job->revision;
}

void sim_develop(struct sim *sim)
{
    while (sim->developing_count > 0) {
        struct job_frame *frame = sim->developing[--sim->developing_count];
        struct frame_makers makers = {.deliverers = BUFFER_INIT, .done_at = sim->farm.wall_s};
        struct film_coverage coverage;
        struct unit_work work;
        struct error err = {0};
        status s = STATUS_OK;

        if (!frame->closing) {
            sim->developed++;
            sim->wrong_frames += !sim_frame_is_right(frame->job, frame->number, frame->film);
            coverage = film_coverage(frame->film);
            work = film_work(frame->film);
            s = measured_deliverers(frame->film, &makers.deliverers, &err);
            if (sim->store && s == STATUS_OK)
                s = store_frame_done(
                    sim->store,
                    &(struct frame_done){.job = frame->job->id, .epoch_floor = sim->developing_epoch[sim->developing_count],
                                         .frame = frame->number, .revision = sim_revision(frame->job), .end = frame->end,
                                         .cut = coverage.samples < job_frame_samples(frame->job) ? &coverage : NULL,
                                         .work = &work, .makers = &makers},
                    &err);
            buffer_release(&makers.deliverers);
        }
        farm_frame_developed(&sim->farm, frame, sim_revision(frame->job), s, &err, sim->now_ns);
    }
}

int sim_make_picture(struct sim *sim)
{
    struct job *job = sim->picture_job;
    struct error err = {0};
    status s = STATUS_OK;

    if (!job)
        return 0;
    sim->picture_job = NULL;
    if (sim->store)
        s = store_frame_developed(sim->store, job->id, sim->picture_frame, job->revision, &err);
    farm_pictures_made(&sim->farm, job, sim->picture_frame, job->revision, s, &err, sim->now_ns);
    return 1;
}

static void show(void *user, const float *rgb, uint32_t count, float *codes)
{
    tonemap_pixels_codes(user, rgb, count, codes);
}

/* Merge what the film has of a tile's group into `reference`, in order. */
static void merge_in_order(struct film *reference, const struct film *film, uint32_t number, struct unit_name name)
{
    static float sums[TILE_FLOATS_MAX];

    /* A frame that was cut short holds fewer. */
    for (; name.pass < film_tile_passes(film, name.tile, name.group); name.pass++) {
        struct unit_result unit = {.name = name, .sums = sums};
        struct tile_rect rect = tile_rect_of(film_width(film), film_height(film), name.tile);
        enum film_merge_result result;
        uint32_t begin, end, thread;
        uint64_t cpu_ns;

        unit.count = sim_sums(film_width(film), film_height(film), number, name, sums);
        pass_range(film_spp(film), name.group, name.pass, &begin, &end);
        unit.work.samples = (uint64_t)rect.width * rect.height * (end - begin);
        assert_int_equal(film_merge(reference, &unit, film_deliverer(film, name.tile, name.group, name.pass), &result,
                                    NULL),
                         STATUS_OK);
        film_cost(film, name.tile, name.group, name.pass, &thread, &cpu_ns);
        film_note_cost(reference, name.tile, name.group, name.pass, thread, cpu_ns);
    }
}

/* Freeze the film's group as the coordinator shall: by what its level 0 shows. */
static struct tonemap_pixels *freeze_in_order(struct film *film, uint32_t group, const struct job *job)
{
    static struct tonemap_state state;
    struct tonemap_settings settings;
    struct tonemap_pixels *pixels;
    struct image image;

    tonemap_stand_in(&settings, &job->output.tonemap);
    assert_int_equal(image_init(&image, film_width(film), film_height(film), 3, NULL), STATUS_OK);
    film_develop_group(film, group, image.pixels);
    assert_int_equal(image_smooth(&image, FREEZE_RADIUS, NULL), STATUS_OK);
    assert_int_equal(tonemap_measure(&state, &image, &settings, NULL, NULL), STATUS_OK);
    assert_int_equal(tonemap_pixels_new(&pixels, &settings, &state, NULL, NULL), STATUS_OK);
    film_freeze(film, group, &(struct film_codes){show, pixels});
    image_release(&image);
    return pixels;
}

int sim_frame_is_right(const struct job *job, uint32_t number, const struct film *film)
{
    const struct render_settings *s = &job->settings;
    struct film *reference = film_new(s->width, s->height, s->spp);
    struct film *full = film_new(s->width, s->height, s->spp); /* the film, with the levels that it left out */
    int same = film_complete(film) || job->state == JOB_STATE_CANCELLING || job->state == JOB_STATE_FINISHING;
    struct tonemap_pixels *pixels[GROUPS] = {NULL};

    assert_non_null(reference);
    assert_non_null(full);
    film_want_all(reference);
    for (uint32_t g = 0; g < GROUPS; g++) {
        if (tonemap_reach(&job->output.tonemap) == TONEMAP_REACH_PIXEL) /* known at the start */
            pixels[g] = freeze_in_order(reference, g, job);
        for (uint32_t t = 0; t < film_tile_count(reference); t++)
            merge_in_order(reference, film, number, (struct unit_name){t, g, 0});
        if (film_wants_freeze(reference, g))
            pixels[g] = freeze_in_order(reference, g, job);
    }
    for (uint32_t t = 0; t < film_tile_count(reference) && same; t++) {
        size_t size = film_tile_state_size(reference, t);
        uint8_t *a = malloc(size), *b = malloc(size);
        assert_non_null(a);
        assert_non_null(b);
        assert_int_equal(film_tile_state_size(film, t), size);
        film_tile_save(reference, t, a);
        film_tile_save(film, t, b);
        assert_int_equal(film_tile_load(full, t, b, size, NULL), STATUS_OK);
        film_take_levels(full, reference);
        film_tile_save(full, t, b);
        same = memcmp(a, b, size) == 0;
        free(a);
        free(b);
    }
    film_free(full);
    film_free(reference);
    for (uint32_t g = 0; g < GROUPS; g++)
        tonemap_pixels_free(pixels[g]);
    return same;
}
