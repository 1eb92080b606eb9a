/* azulejo effects: the effects that a scene needs, and what each of them costs. */
#include <stdio.h>
#include <string.h>

#include "client/commands/command.h"
#include "client/study/effects_measure.h"
#include "client/views/effects_view.h"
#include "client/follow/job_info.h"
#include "client/link/local.h"
#include "client/link/signals.h"
#include "client/farm/submission.h"
#include "client/terminal/table.h"
#include "common/scene/scene_effects.h"
#include "common/scene/kernel_sets.h"

struct effects {
    struct job_options options;
    struct job_request request;
    struct import_result scene;
    uint64_t set;
    struct effect_cause causes[EFFECT_COUNT];
    unsigned rounds; /* measured; 0: nothing was measured */
    struct effects_measure measure;
    struct effects_price prices[EFFECT_COUNT]; /* of those that have a trial */
};

static int has_price(const struct effects *e, int bit)
{
    return e->rounds && effects_measure_find(&e->measure, bit) > 0;
}

static void add_codes(struct table *table, const struct study_interval *v)
{
    table_add(table, "%.2f", v->value);
    table_add(table, "%.2f to %.2f", v->low, v->high);
}

static void print_table(const struct effects *e)
{
    static const char *const plain[] = {"EFFECT", "CALLED FOR BY"};
    static const char *const priced[] = {"EFFECT", ">TIME", ">+-", ">BIAS", ">95 %", ">RMS", ">MEAN",
                                         "CALLED FOR BY"};
    struct table table;

    if (e->rounds)
        table_init(&table, priced, 8);
    else
        table_init(&table, plain, 2);
    for (int bit = 0; bit < EFFECT_COUNT; bit++) {
        const struct effects_price *price = &e->prices[bit];
        char cause[CAUSE_TEXT_SIZE];
        if (!(e->set >> bit & 1))
            continue;
        cause_text(&e->causes[bit], cause);
        table_add(&table, "%s", effect_name((enum effect_bit)bit));
        if (has_price(e, bit)) {
            table_add(&table, "%.1f %%", 100 * price->saved.value);
            table_add(&table, "%.1f", 100 * (price->saved.high - price->saved.value));
            add_codes(&table, &price->bias.codes);
            table_add(&table, "%.2f", price->bias.rms_codes.value);
            table_add(&table, "%+.2f %%", 100 * price->bias.mean_change);
        } else if (e->rounds) {
            for (int i = 0; i < 6; i++)
                table_add(&table, "-");
        }
        table_add(&table, "%s", cause);
    }
    table_print(&table);
    table_release(&table);
}

static void print_list(const char *title, uint64_t set)
{
    struct name_list list = NAME_LIST_INIT(title);

    for (int bit = 0; bit < EFFECT_COUNT; bit++)
        if (set >> bit & 1)
            name_list_add(&list, effect_name((enum effect_bit)bit));
    name_list_end(&list);
}

/* Consecutive frames with the same effects as the first of them. */
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

    while (r.last < e->request.last_frame && scene_effects(&e->scene.scene, settings, r.last + 1, NULL) == r.set)
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

static void print_text(const struct effects *e)
{
    uint64_t without = e->request.settings.without;

    printf("frame %u is rendered by the \"%s\" kernel, with %d of %d effects:\n\n", e->request.first_frame,
           kernel_set_name(e->set), __builtin_popcountll(e->set), EFFECT_COUNT);
    print_table(e);
    print_list("switched off", without);
    print_list("not called for, so not simulated", EFFECTS_ALL & ~e->set & ~without);
    if (!e->rounds)
        print_frames(e);
    if (e->rounds)
        printf("\nTIME is the share of the render that leaving the effect out saves, +- half its "
               "95 %% interval.\n"
               "BIAS is the change that remains without noise, in steps of 255 of a screen: 95 %% "
               "of the\n"
               "pixels are within so many of the whole picture. RMS is its root mean square, MEAN "
               "the change\n"
               "of the picture's mean (%ux%u pixels, %u rounds of %u samples each, %.2f "
               "core-seconds in all).\n",
               e->request.settings.width, e->request.settings.height, e->rounds, e->request.settings.spp,
               e->measure.core_s);
}

static json_t *caller_json(const char *kind, const char *name, uint32_t index)
{
    return json_pack("{s:s, s:o, s:I}", "kind", kind, "name", json_text(name), "index", (json_int_t)index);
}

static json_t *cause_json(const struct effect_cause *cause)
{
    json_t *row = caller_json(cause->kind, cause->name, cause->index), *also = json_array();

    json_object_set_new(row, "count", json_integer(cause->count));
    for (int i = 0; i < EFFECT_CAUSES_ALSO && cause->also[i].kind; i++)
        json_array_append_new(also, caller_json(cause->also[i].kind, cause->also[i].name, cause->also[i].index));
    if (json_array_size(also) > 0)
        json_object_set(row, "also", also);
    json_decref(also);
    return row;
}

static json_t *interval_json(const struct study_interval *v)
{
    return json_pack("[o, o, o]", json_number(v->value), json_number(v->low), json_number(v->high));
}

static json_t *effect_json(const struct effects *e, int bit)
{
    const struct effect_cause *cause = &e->causes[bit];
    json_t *row = json_pack("{s:s, s:b, s:b}", "effect", effect_name((enum effect_bit)bit), "runs",
                            (int)(e->set >> bit & 1), "switched_off", (int)(e->request.settings.without >> bit & 1));

    if (row && cause->kind)
        json_object_set_new(row, "cause", cause_json(cause));
    if (row && has_price(e, bit)) {
        const struct effects_price *price = &e->prices[bit];
        json_object_set_new(row, "time_share", interval_json(&price->saved));
        json_object_set_new(row, "bias_codes", interval_json(&price->bias.codes));
        json_object_set_new(row, "bias_rms_codes", interval_json(&price->bias.rms_codes));
        json_object_set_new(row, "mean_change", json_number(price->bias.mean_change));
        json_object_set_new(row, "differs", json_boolean(!price->bias.same));
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
        json_array_append_new(rows, json_pack("{s:i, s:i, s:s, s:o}", "first", (int)r.first, "last", (int)r.last,
                                              "kernel", kernel_set_name(r.set), "effects", names));
    }
    return rows;
}

static status print_json(const struct effects *e, struct error *err)
{
    json_t *rows = json_array(), *out;

    for (int bit = 0; bit < EFFECT_COUNT; bit++)
        json_array_append_new(rows, effect_json(e, bit));
    out = json_pack("{s:i, s:s, s:o, s:o}", "frame", (int)e->request.first_frame, "kernel", kernel_set_name(e->set),
                    "effects", rows, "frames", frames_json(e));
    if (e->rounds)
        json_object_set_new(out, "measured",
                            json_pack("{s:i, s:i, s:i, s:i, s:o}", "width", (int)e->request.settings.width, "height",
                                      (int)e->request.settings.height, "samples", (int)e->request.settings.spp,
                                      "rounds", (int)e->rounds, "core_seconds", json_number(e->measure.core_s)));
    return json_print(out, err);
}

static status find_prices(struct effects *e, struct error *err)
{
    status result = STATUS_OK;

    for (int bit = 0; bit < EFFECT_COUNT && result == STATUS_OK; bit++)
        if (has_price(e, bit))
            result = effects_measure_price(&e->measure, effects_measure_find(&e->measure, bit), &e->prices[bit], err);
    return result;
}

/* An interruption keeps the complete rounds: the table is printed, then the error. */
static status measure(struct effects *e, struct local_options *local, int quiet, struct error *err)
{
    struct local_farm *farm;
    struct error ignored = {0};
    status result = signals_catch(err);

    THEN(result, local_farm_start(&farm, local, err));
    if (result != STATUS_OK)
        return result;
    e->measure.scene = &e->scene;
    e->measure.request = &e->request;
    e->measure.quiet = quiet;
    result = connection_open(&e->measure.connection, local_farm_address(farm), err);
    if (result == STATUS_OK) {
        connection_set_watch(e->measure.connection, local_farm_check, farm);
        result = effects_measure_run(&e->measure, e->set, err);
    }
    if (result != STATUS_OK)
        result = local_farm_explain(farm, result, err);
    connection_close(e->measure.connection);
    local_farm_stop(farm);
    if (result == STATUS_OK || signals_stop())
        e->rounds = effects_measure_rounds(&e->measure);
    if (e->rounds) {
        status priced = find_prices(e, result == STATUS_OK ? err : &ignored);
        result = result == STATUS_OK ? priced : result;
    }
    return result;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct effects e = {.options = JOB_OPTIONS_INIT};
    struct local_options local = {.workers = 1};
    int64_t threads = 0;
    int wanted = 0, json = 0, quiet = 0, done;
    const struct option table[] = {
        {"measure", 'm', OPTION_FLAG, &wanted, NULL,
         "render small pilots and print what each effect costs, and what leaving it out changes "
         "apart from noise; Ctrl-C keeps the complete rounds",
         0, 0, NULL},
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        {"threads", 'j', OPTION_INT, &threads, "N", "threads of the pilots (default: all)", 1, 1024,
         NULL},
        {"quiet", 'q', OPTION_FLAG, &quiet, NULL, "no warnings and no progress", 0, 0, NULL},
        JOB_STUDY_ROWS(e.options),
        {0},
    };
    struct option rows[TONEMAP_ROWS_MAX];
    struct positionals rest;
    status result;

    e.options.stop.spp = 0;
    result = command_parse(command, tonemap_options_table(&e.options.output.tone, table, rows), argc, argv, 1, 1, &rest,
                           &done, err);
    if (result != STATUS_OK || done)
        return result;
    {
        int spp_given = e.options.stop.spp > 0;
        local.threads = (unsigned)threads;
        if (!spp_given)
            e.options.stop.spp = SETTINGS_SPP_DEFAULT;
        result = job_options_check(&e.options, &e.request, err);
        THEN(result, job_request_one_range(&e.request, err));
        THEN(result, submission_prepare(rest.items[0], &e.options, quiet, &e.request, &e.scene, err));
        if (result == STATUS_OK) {
            e.set = scene_effects(&e.scene.scene, &e.request.settings, e.request.first_frame, e.causes);
            if (wanted) {
                effects_measure_shrink(&e.request.settings, e.options.size != NULL, spp_given);
                e.request.last_frame = e.request.first_frame;
                result = measure(&e, &local, quiet, err);
            }
        }
    }
    if ((result == STATUS_OK || e.rounds) && json) {
        struct error again = {0};
        status printed = print_json(&e, &again);
        if (result == STATUS_OK && printed != STATUS_OK)
            result = error_set(err, printed, "%s", again.text);
    } else if (result == STATUS_OK || e.rounds) {
        print_text(&e);
    }
    effects_measure_release(&e.measure);
    import_result_release(&e.scene);
    job_request_release(&e.request);
    return result;
}

const struct command command_effects = {
    .name = "effects",
    .group = COMMAND_RENDER,
    .usage = "azulejo effects SCENE [OPTION]...",
    .summary = "list the effects that a frame needs, and what each of them costs",
    .description =
        "Tell which effects rendering a frame calls for, who calls for them, which are left out, and which\n"
        "kernel will run. With --measure, render small pilots of the frame, whole and without each effect,\n"
        "and table the time saved and the bias. What you can do without, leave out: --without EFFECT,...",
    .run = run,
};
