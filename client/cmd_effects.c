/* azulejo effects: what a scene calls for, and what each of it costs. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/command.h"
#include "client/compare.h"
#include "client/effects_view.h"
#include "client/job_info.h"
#include "client/local.h"
#include "client/pilot.h"
#include "client/signals.h"
#include "client/submission.h"
#include "client/table.h"
#include "common/scene/effects.h"
#include "common/scene/kernel_sets.h"

enum { PILOT_ROWS = 160, PILOT_SPP = 64, PILOT_RUNS = 2 };

struct effects {
    struct job_options options;
    struct job_request request;
    struct import_result scene;
    uint64_t set;
    struct effect_cause causes[EFFECT_COUNT];
    int measured;
    struct pilot_trial trials[EFFECT_COUNT + 1]; /* the first leaves out nothing more */
    int bit_of_trial[EFFECT_COUNT + 1];
    size_t trial_count;
};

/* What one effect does to time and picture. */
struct effect_price {
    double time_share;   /* of the whole, 0..1; negative: the picture is slower without it */
    double mean_change;  /* of the picture's mean when it is left out */
    double rms_change;   /* root of the relative mean squared difference */
    int differs;
};

static struct effect_price price_of(const struct effects *e, size_t trial)
{
    const struct pilot_trial *whole = &e->trials[0], *less = &e->trials[trial];
    struct effect_price price = {0};
    struct comparison c;

    image_compare(&less->picture, &whole->picture, &c);
    price.time_share = whole->cpu_s > 0 ? 1 - less->cpu_s / whole->cpu_s : 0;
    price.mean_change = (c.mean_relative[0] + c.mean_relative[1] + c.mean_relative[2]) / 3;
    price.rms_change = sqrt(c.relative_mse);
    price.differs = c.same_size && !c.identical;
    return price;
}

static int trial_of(const struct effects *e, int bit)
{
    for (size_t i = 1; i < e->trial_count; i++)
        if (e->bit_of_trial[i] == bit)
            return (int)i;
    return -1;
}

static status print_table(const struct effects *e, struct error *err)
{
    static const char *const plain[] = {"EFFECT", "CALLED FOR BY"};
    static const char *const priced[] = {"EFFECT", ">TIME", ">MEAN", ">RMS", "CALLED FOR BY"};
    struct table table;
    status result;

    if (e->measured)
        table_init(&table, priced, 5);
    else
        table_init(&table, plain, 2);
    for (int bit = 0; bit < EFFECT_COUNT; bit++) {
        int trial = trial_of(e, bit);
        const struct effect_cause *who = &e->causes[bit];
        char cause[CAUSE_TEXT_SIZE];
        if (!(e->set >> bit & 1))
            continue;
        cause_text(who, cause);
        table_add(&table, "%s", effect_name((enum effect_bit)bit));
        if (e->measured && trial > 0) {
            struct effect_price price = price_of(e, (size_t)trial);
            table_add(&table, "%.1f %%", 100 * price.time_share);
            table_add(&table, "%+.2f %%", 100 * price.mean_change);
            table_add(&table, "%.2f %%", 100 * price.rms_change);
        } else if (e->measured) {
            for (int i = 0; i < 3; i++)
                table_add(&table, "-");
        }
        table_add(&table, "%s", cause);
    }
    result = table_print(&table, err);
    table_release(&table);
    return result;
}

static void print_list(const char *title, uint64_t set)
{
    struct name_list list = NAME_LIST_INIT(title);

    for (int bit = 0; bit < EFFECT_COUNT; bit++)
        if (set >> bit & 1)
            name_list_add(&list, effect_name((enum effect_bit)bit));
    name_list_end(&list);
}

/* Frames after the first that call for the same, one after the other. */
struct effects_run {
    uint32_t first, last;
    uint64_t set;
};

/* The run that begins at `first`; the job's last frame bounds it. */
static struct effects_run run_from(const struct effects *e, uint32_t first)
{
    const struct render_settings *settings = &e->request.settings;
    struct effects_run r = {first, first,
                            scene_effects(&e->scene.scene, settings, first, NULL)};

    while (r.last < e->request.last_frame &&
           scene_effects(&e->scene.scene, settings, r.last + 1, NULL) == r.set)
        r.last++;
    return r;
}

static void print_frames(const struct effects *e)
{
    struct effects_run r = run_from(e, e->request.first_frame);

    if (r.last == e->request.last_frame && r.last > r.first)
        printf("\nso are all frames to %u\n", r.last);
    while (r.last < e->request.last_frame) {
        uint64_t more, less;
        r = run_from(e, r.last + 1);
        more = r.set & ~e->set;
        less = e->set & ~r.set;
        printf("\nframes %u to %u: \"%s\" kernel%s", r.first, r.last, kernel_set_name(r.set),
               more | less ? "" : ", the same effects\n");
        if (more)
            print_list("  more", more);
        if (less)
            print_list("  less", less);
    }
}

static status print_text(const struct effects *e, struct error *err)
{
    uint64_t without = e->request.settings.without;
    status result;

    printf("frame %u is rendered by the \"%s\" kernel, with %d of %d effects:\n\n",
           e->request.first_frame, kernel_set_name(e->set), __builtin_popcountll(e->set),
           EFFECT_COUNT);
    result = print_table(e, err);
    if (result != STATUS_OK)
        return result;
    print_list("switched off", without);
    print_list("not called for, so not simulated", EFFECTS_ALL & ~e->set & ~without);
    if (!e->measured)
        print_frames(e);
    if (e->measured)
        printf("\nTIME is the share of the render that leaving the effect out saves, MEAN and RMS how the\n"
               "picture's mean and its pixels change (%ux%u pixels, %u samples each, %.2f CPU-s in all).\n",
               e->request.settings.width, e->request.settings.height, e->request.settings.spp,
               e->trials[0].cpu_s);
    return STATUS_OK;
}

static json_t *caller_json(const char *kind, const char *name, uint32_t index)
{
    return json_pack("{s:s, s:o, s:I}", "kind", kind, "name", json_text(name), "index",
                     (json_int_t)index);
}

static json_t *cause_json(const struct effect_cause *cause)
{
    json_t *row = caller_json(cause->kind, cause->name, cause->index), *also = json_array();

    json_object_set_new(row, "count", json_integer(cause->count));
    for (int i = 0; i < EFFECT_CAUSES_ALSO && cause->also[i].kind; i++)
        json_array_append_new(also, caller_json(cause->also[i].kind, cause->also[i].name,
                                                cause->also[i].index));
    if (json_array_size(also) > 0)
        json_object_set(row, "also", also);
    json_decref(also);
    return row;
}

static json_t *effect_json(const struct effects *e, int bit)
{
    const struct effect_cause *cause = &e->causes[bit];
    int trial = trial_of(e, bit);
    json_t *row = json_pack("{s:s, s:b, s:b}", "effect", effect_name((enum effect_bit)bit), "runs",
                            (int)(e->set >> bit & 1), "switched_off",
                            (int)(e->request.settings.without >> bit & 1));

    if (row && cause->kind)
        json_object_set_new(row, "cause", cause_json(cause));
    if (row && trial > 0) {
        struct effect_price price = price_of(e, (size_t)trial);
        json_object_set_new(row, "time_share", json_number(price.time_share));
        json_object_set_new(row, "mean_change", json_number(price.mean_change));
        json_object_set_new(row, "rms_change", json_number(price.rms_change));
        json_object_set_new(row, "differs", json_boolean(price.differs));
    }
    return row;
}

static json_t *frames_json(const struct effects *e)
{
    json_t *rows = json_array();
    struct effects_run r = {.last = e->request.first_frame};

    for (int begun = 0; !begun || r.last < e->request.last_frame; begun = 1) {
        json_t *names = json_array();
        r = run_from(e, begun ? r.last + 1 : r.last);
        for (int bit = 0; bit < EFFECT_COUNT; bit++)
            if (r.set >> bit & 1)
                json_array_append_new(names, json_string(effect_name((enum effect_bit)bit)));
        json_array_append_new(rows, json_pack("{s:i, s:i, s:s, s:o}", "first", (int)r.first, "last",
                                              (int)r.last, "kernel", kernel_set_name(r.set),
                                              "effects", names));
    }
    return rows;
}

static status print_json(const struct effects *e, struct error *err)
{
    json_t *rows = json_array();

    for (int bit = 0; bit < EFFECT_COUNT; bit++)
        json_array_append_new(rows, effect_json(e, bit));
    return json_print(json_pack("{s:i, s:s, s:o, s:o}", "frame", (int)e->request.first_frame,
                                "kernel", kernel_set_name(e->set), "effects", rows, "frames",
                                frames_json(e)),
                      err);
}

/* A trial for each effect that runs and can be switched off. */
static void plan_trials(struct effects *e)
{
    e->trial_count = 1;
    for (int bit = 0; bit < EFFECT_COUNT; bit++)
        if (e->set & EFFECTS_SWITCHABLE & (uint64_t)1 << bit) {
            e->bit_of_trial[e->trial_count] = bit;
            e->trials[e->trial_count++].without = (uint64_t)1 << bit;
        }
}

static status measure(struct effects *e, struct local_options *local, struct error *err)
{
    struct connection *connection = NULL;
    struct local_farm *farm;
    status result = signals_catch(err);

    if (result == STATUS_OK)
        result = local_farm_start(&farm, local, err);
    if (result != STATUS_OK)
        return result;
    plan_trials(e);
    result = connection_open(&connection, local_farm_address(farm), err);
    if (result == STATUS_OK) {
        connection_set_watch(connection, local_farm_check, farm);
        result = pilot_run(connection, &e->scene, &e->request, e->trials, e->trial_count,
                           PILOT_RUNS, err);
    }
    if (result != STATUS_OK)
        result = local_farm_explain(farm, result, err);
    connection_close(connection);
    local_farm_stop(farm);
    e->measured = result == STATUS_OK;
    return result;
}

/* A pilot is small unless the user says otherwise. */
static void shrink(struct effects *e, int size_given, int spp_given)
{
    struct render_settings *s = &e->request.settings;

    if (!size_given) {
        s->width = (uint32_t)fmax(1, (double)s->width * PILOT_ROWS / (double)s->height + 0.5);
        s->height = PILOT_ROWS;
    }
    if (!spp_given)
        s->spp = PILOT_SPP;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    struct effects e = {.options = JOB_OPTIONS_INIT};
    struct local_options local = {.workers = 1};
    int64_t threads = 0;
    int wanted = 0, json = 0, quiet = 0, done;
    const struct option table[] = {
        {"measure", 'm', OPTION_FLAG, &wanted, NULL,
         "render small pilots and tell what each effect costs and changes", 0, 0, NULL},
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        {"threads", 'j', OPTION_INT, &threads, "N", "threads of the pilots (default: all)", 1, 1024,
         NULL},
        {"quiet", 'q', OPTION_FLAG, &quiet, NULL, "no warnings", 0, 0, NULL},
        JOB_OPTION_ROWS(e.options),
        {0},
    };
    struct option rows[TONEMAP_ROWS_MAX];
    struct positionals rest;
    status result;

    e.options.stop.spp = 0;
    result = command_parse(command, tonemap_options_table(&e.options.output.tone, table, rows),
                           argc, argv, 1, 1, &rest, &done, err);
    (void)exit_code;
    if (result != STATUS_OK || done)
        return result;
    {
        int spp_given = e.options.stop.spp > 0;
        local.threads = (unsigned)threads;
        if (!spp_given)
            e.options.stop.spp = SETTINGS_SPP_DEFAULT;
        result = job_options_check(&e.options, &e.request, err);
        if (result == STATUS_OK)
            result = submission_prepare(rest.items[0], &e.options, quiet, &e.request, &e.scene,
                                        err);
        if (result == STATUS_OK) {
            e.set = scene_effects(&e.scene.scene, &e.request.settings, e.request.first_frame,
                                  e.causes);
            if (wanted) {
                shrink(&e, e.options.size != NULL, spp_given);
                e.request.last_frame = e.request.first_frame;
                result = measure(&e, &local, err);
            }
        }
    }
    if (result == STATUS_OK)
        result = json ? print_json(&e, err) : print_text(&e, err);
    for (size_t i = 0; i < e.trial_count; i++)
        image_release(&e.trials[i].picture);
    import_result_release(&e.scene);
    job_request_release(&e.request);
    return result;
}

const struct command command_effects = {
    .name = "effects",
    .group = COMMAND_RENDER,
    .usage = "azulejo effects SCENE [OPTION]...",
    .summary = "tell what a frame calls for, and what each effect costs",
    .description =
        "Tell which effects rendering a frame calls for, who calls for them, which are left out, and which\n"
        "kernel will run. With --measure, render a small pilot of the frame, once whole and once without each\n"
        "effect, and table the time and the difference. What you can do without, leave out: --without EFFECT,...",
    .run = run,
};
