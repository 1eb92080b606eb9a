/* azulejo accuracy: a page that shows what accuracy costs. */
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "client/commands/command.h"
#include "client/views/effects_auto.h"
#include "client/link/child.h"
#include "client/link/local.h"
#include "client/link/signals.h"
#include "client/study/run.h"
#include "client/study/study_files.h"
#include "client/farm/submission.h"
#include "client/terminal/must.h"
#include "common/system/file.h"
#include "common/base/memory.h"
#include "common/image/image.h"

enum { QUICK_S = 95, USUAL_MINUTES = 10, LEVELS_QUICK = 2 };

struct accuracy {
    struct job_options options;
    struct connection_options where;
    struct local_options local;
    struct local_farm *usual_farm, *double_farm;
    const char *from, *again, *out, *target, *currency, *double_worker, *reference_path;
    struct image reference;
    double minutes, price; /* 0: not given */
    int64_t workers, threads;
    int farm, quick, page_only, quiet;
    struct buffer page, data; /* paths: PAGE.html and PAGE.json */
    struct job_request request;
    struct import_result scene;
    char *name;
    struct study study;
    struct study_run run;
};

static status study_load(struct study *s, const char *path, struct error *err)
{
    struct buffer text = BUFFER_INIT;
    status result = file_read(path, STUDY_FILE_BYTES_MAX, &text, err);

    THEN(result, study_read(s, buffer_text(&text), text.size, path, err));
    buffer_release(&text);
    return result;
}

/* The size is checked with the first pictures' (against.h); a file that is no picture is refused at once. */
static status load_reference(struct accuracy *a, struct error *err)
{
    struct image_repairs repairs = {0};
    struct buffer data = BUFFER_INIT;
    const struct render_settings *r = &a->request.settings;
    status result = file_read(a->reference_path, IMAGE_BYTES_MAX, &data, err);

    THEN(result, image_decode_hdr(&a->reference, data.data, data.size, a->reference_path, &repairs, err));
    buffer_release(&data);
    if (result == STATUS_OK && (a->reference.width != r->width || a->reference.height != r->height))
        return error_set(err, STATUS_ERR_INPUT,
                         "--reference %s has %ux%u pixels, and the study's pictures have %ux%u; give --size %ux%u",
                         a->reference_path, a->reference.width, a->reference.height, r->width, r->height,
                         a->reference.width, a->reference.height);
    if (result == STATUS_OK) {
        a->run.reference = &a->reference;
        study_text_set(&a->study.reference, file_basename(a->reference_path));
    }
    return result;
}

/* The page's path: as given, or named after the study or scene, in this folder. The data file is beside it. */
static status choose_paths(struct accuracy *a, const char *from, struct error *err)
{
    const char *extension;

    if (a->out && strcasecmp(file_extension(a->out), "html") != 0)
        return error_set(err, STATUS_ERR_USAGE, "-o %s: the page's name must end in .html", a->out);
    if (a->out) {
        buffer_puts(&a->page, a->out);
    } else {
        const char *base = file_basename(from);
        size_t length;
        extension = file_extension(from);
        length = strlen(base) - (*extension ? strlen(extension) + 1 : 0);
        /* Not to collide with the scene's pictures, which have the scene's name. */
        buffer_printf(&a->page, "%.*s%s.html", (int)length, base, a->from || a->again ? "" : "-accuracy");
    }
    buffer_printf(&a->data, "%.*sjson", (int)(a->page.size - strlen("html")), buffer_text(&a->page));
    must_hold(&a->data);
    return STATUS_OK;
}

static status save(void *user, struct error *err)
{
    struct accuracy *a = user;
    struct buffer text = BUFFER_INIT;
    status result = study_write(&text, &a->study, err);

    THEN(result, file_write_atomic(buffer_text(&a->data), text.data, text.size, err));
    buffer_release(&text);
    return result;
}

static void set_command(struct study *s, int argc, char *const *argv)
{
    struct buffer text = BUFFER_INIT;

    buffer_puts(&text, "azulejo");
    for (int i = 0; i < argc; i++)
        buffer_printf(&text, " %s", argv[i]);
    must_hold(&text);
    study_text_set(&s->command, buffer_text(&text));
    buffer_release(&text);
}

static status prepare(struct accuracy *a, const char *scene, int argc, char *const *argv, struct error *err)
{
    struct study *s = &a->study;
    const int spp_given = a->options.stop.spp > 0;
    status result = job_options_check(&a->options, &a->request, err);

    THEN(result, job_request_one_range(&a->request, err));
    a->name = submission_name(scene);
    if (result == STATUS_OK && a->again)
        result = study_load(s, a->again, err);
    if (result == STATUS_OK && a->target)
        result = parse_target_codes(a->target, &s->target_codes, err);
    if (!(s->target_codes > 0))
        s->target_codes = 3;
    if (a->price > 0)
        s->price_core_hour = a->price;
    if (a->currency)
        study_text_set(&s->currency, a->currency);
    THEN(result, submission_prepare(scene, &a->options, a->quiet, &a->request, &a->scene, err));
    if (result == STATUS_OK && a->again)
        result = study_run_check(s, &a->request, file_basename(scene), err);
    study_text_set(&s->scene, file_basename(scene));
    set_command(s, argc, argv);
    a->run = (struct study_run){
        .study = s, .scene = &a->scene, .request = &a->request, .name = a->name,
        .spp_most = spp_given ? (uint32_t)a->options.stop.spp : RUN_SPP_MAX,
        .budget_s = a->minutes > 0 ? 60 * a->minutes : a->quick ? QUICK_S : 60 * USUAL_MINUTES,
        .levels = a->quick ? LEVELS_QUICK : RUN_LEVELS_MAX, .local = !a->farm, .quiet = a->quiet,
        .save = save, .user = a};
    if (result == STATUS_OK && a->reference_path)
        result = load_reference(a, err);
    return result;
}

/* Does the program say that it computes in double? An ordinary worker would be refused, and the study would wait. */
static int says_double(const char *path)
{
    char command[4096], line[256] = "";
    FILE *said;

    if (strchr(path, '\'') || snprintf(command, sizeof command, "'%s' --version", path) >= (int)sizeof command)
        return 0;
    said = popen(command, "r");
    if (!said)
        return 0;
    if (!fgets(line, sizeof line, said))
        line[0] = 0;
    pclose(said);
    return strstr(line, " double") != NULL;
}

/* A worker that computes in double: as given, or as `make install` of that build calls it. */
static status find_double_worker(struct accuracy *a, struct buffer *path, struct error *err)
{
    struct error none = {0};

    if (a->double_worker) {
        if (access(a->double_worker, X_OK) != 0)
            return error_set(err, STATUS_ERR_USAGE,
                             "--double-worker %s: %s; 'make DOUBLE=1' builds it as build/double/bin/azulejo-worker",
                             a->double_worker, strerror(errno));
        buffer_puts(path, strchr(a->double_worker, '/') ? "" : "./");
        buffer_puts(path, a->double_worker);
    } else if (a->farm || child_find_program("azulejo-worker-double", path, &none) != STATUS_OK) {
        if (!a->quiet && !a->farm)
            fprintf(stderr, "the study leaves out the question of precision: give --double-worker PATH "
                            "('make DOUBLE=1' builds build/double/bin/azulejo-worker)\n");
        return STATUS_OK;
    }
    must_hold(path);
    return says_double(buffer_text(path))
               ? STATUS_OK
               : error_set(err, STATUS_ERR_USAGE,
                           "%s does not compute in double ('--version' tells); 'make DOUBLE=1' builds "
                           "build/double/bin/azulejo-worker", buffer_text(path));
}

static status open_connection(struct accuracy *a, struct local_farm *farm, struct error *err)
{
    status result = connection_open(&a->run.connection, farm ? local_farm_address(farm) : &a->where, err);

    if (result == STATUS_OK)
        connection_set_watch(a->run.connection, farm ? local_farm_check : trial_interrupted, farm);
    return result;
}

/* One connection at a time: a coordinator drops one that is silent for long. */
static status change_farm(void *user, int precise, struct error *err)
{
    struct accuracy *a = user;

    connection_close(a->run.connection);
    a->run.connection = NULL;
    return open_connection(a, precise ? a->double_farm : a->usual_farm, err);
}

/* Workers of both kinds do not mix, so each kind has a farm. */
static status start_farms(struct accuracy *a, struct error *err)
{
    struct buffer worker = BUFFER_INIT;
    struct local_options local = a->local;
    status result = find_double_worker(a, &worker, err);

    if (result == STATUS_OK && !a->farm)
        result = local_farm_start(&a->usual_farm, &a->local, err);
    if (result == STATUS_OK && worker.size) {
        local.double_worker = buffer_text(&worker);
        a->run.connect = change_farm;
        result = local_farm_start(&a->double_farm, &local, err);
    }
    buffer_release(&worker);
    return result;
}

static status measure(struct accuracy *a, struct error *err)
{
    status result = signals_catch(err);

    a->local.workers = (unsigned)a->workers;
    a->local.threads = (unsigned)a->threads;
    THEN(result, start_farms(a, err));
    THEN(result, open_connection(a, a->usual_farm, err));
    THEN(result, study_run(&a->run, err));
    if (a->usual_farm && result != STATUS_OK)
        result = local_farm_explain(a->usual_farm, result, err);
    if (a->double_farm && result != STATUS_OK)
        result = local_farm_explain(a->double_farm, result, err);
    connection_close(a->run.connection);
    local_farm_stop(a->double_farm);
    local_farm_stop(a->usual_farm);
    return result;
}

/* Write the page and its files, and print the ten lines. */
static status show(struct accuracy *a, struct error *err)
{
    status result = study_files_write(&a->study, buffer_text(&a->page), a->page_only, err);

    if ((result == STATUS_OK || result == STATUS_ERR_INCOMPLETE) && !a->quiet) {
        study_print(&a->study);
        printf("%s\n", buffer_text(&a->page));
    }
    return result;
}

/* Show what was measured, even after a failure. */
static status measure_and_show(struct accuracy *a, struct error *err)
{
    struct error later = {0};
    status result = measure(a, err), shown;

    if (a->study.points.count == 0)
        return result;
    shown = save(a, result == STATUS_OK ? err : &later);
    THEN(shown, show(a, result == STATUS_OK ? err : &later));
    if (!a->quiet && !a->study.complete && (result == STATUS_OK || signals_stop()))
        fprintf(stderr, "the study is not complete; continue it with --continue %s\n", buffer_text(&a->data));
    return result == STATUS_OK ? shown : result;
}

static status check_arguments(const struct accuracy *a, const struct positionals *rest, const struct command *command,
                              struct error *err)
{
    if (a->from && rest->count)
        return error_set(err, STATUS_ERR_USAGE,
                         "--from draws an existing study; to continue measuring, give --continue %s", a->from);
    if (!a->from && !rest->count)
        return error_set(err, STATUS_ERR_USAGE, "a scene, or --from FILE.json, is missing; usage: %s", command->usage);
    if (!a->farm && (a->where.coordinator || a->where.key_path))
        return error_set(err, STATUS_ERR_USAGE, "--coordinator and --key belong to a farm: give --farm, too");
    if (a->farm && a->double_worker)
        return error_set(err, STATUS_ERR_USAGE, "--double-worker is for studies on this machine: leave out --farm");
    if (a->currency && !(a->price > 0))
        return error_set(err, STATUS_ERR_USAGE, "--currency: give --price, too");
    if (a->from && a->reference_path)
        return error_set(err, STATUS_ERR_USAGE, "--reference: a study has it while it measures; leave out --from");
    if (a->page_only && !a->from)
        return error_set(err, STATUS_ERR_USAGE, "--page-only: only with --from; a study keeps its data");
    return STATUS_OK;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct accuracy a = {.options = JOB_OPTIONS_INIT, .where = CONNECTION_OPTIONS_INIT, .workers = 1};
    int done;
    const struct option table[] = {
        {"from", 0, OPTION_STRING, &a.from, "FILE.json", "draw the study in this file", 0, 0, NULL},
        {"continue", 0, OPTION_STRING, &a.again, "FILE.json", "continue the study in this file", 0,
         0, NULL},
        {"out", 'o', OPTION_STRING, &a.out, "PAGE.html",
         "the page's path (default: named after FILE or SCENE, in this folder)", 0, 0, NULL},
        {"quick", 0, OPTION_FLAG, &a.quick, NULL,
         "measure less: under two minutes for a small scene", 0, 0, NULL},
        {"minutes", 0, OPTION_REAL, &a.minutes, "N",
         "measure for about this long (default 10; --quick: 1.6)", 0.01, 100000, NULL},
        {"target-error", 0, OPTION_STRING, &a.target, "N/255",
         "the error that the page's sentences are about (default 3/255)", 0, 0, NULL},
        {"reference", 0, OPTION_STRING, &a.reference_path, "FILE",
         "an EXR or HDR picture of the same frame and size: shows relMSE and FLIP against it", 0, 0, NULL},
        {"price", 0, OPTION_REAL, &a.price, "X", "what a core-hour costs", 1e-9, 1e9, NULL},
        {"currency", 0, OPTION_STRING, &a.currency, "NAME", "of --price, as in EUR", 0, 0, NULL},
        {"page-only", 0, OPTION_FLAG, &a.page_only, NULL,
         "write only the page: no CSV, no JSON, no plots", 0, 0, NULL},
        {"quiet", 'q', OPTION_FLAG, &a.quiet, NULL, "no progress, no warnings, no summary", 0, 0,
         NULL},
        {"workers", 'w', OPTION_INT, &a.workers, "N", "worker processes (default 1)", 1,
         LOCAL_WORKERS_MAX, NULL},
        {"threads", 'j', OPTION_INT, &a.threads, "N",
         "threads of each worker (default: the processors, divided among the workers)", 1, 1024,
         NULL},
        {"double-worker", 0, OPTION_STRING, &a.double_worker, "PATH",
         "an azulejo-worker built with DOUBLE=1: shows what float's rounding costs (default: "
         "azulejo-worker-double)", 0, 0, NULL},
        {"farm", 0, OPTION_FLAG, &a.farm, NULL, "measure on the farm instead of this machine", 0, 0,
         NULL},
        CONNECTION_OPTION_ROWS(a.where),
        JOB_STUDY_ROWS(a.options),
        {0},
    };
    struct option rows[TONEMAP_ROWS_MAX];
    struct positionals rest;
    status result = command_parse(command, tonemap_options_table(&a.options.output.tone, table, rows), argc, argv, 0, 1,
                                  &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    study_init(&a.study);
    result = check_arguments(&a, &rest, command, err);
    THEN(result, choose_paths(&a, a.from ? a.from : a.again ? a.again : rest.items[0], err));
    if (result == STATUS_OK && a.from) {
        result = study_load(&a.study, a.from, err);
        THEN(result, show(&a, err));
    } else if (result == STATUS_OK) {
        result = prepare(&a, rest.items[0], argc, argv, err);
        THEN(result, measure_and_show(&a, err));
    }
    image_release(&a.reference);
    study_release(&a.study);
    import_result_release(&a.scene);
    job_request_release(&a.request);
    mem_free(a.name);
    buffer_release(&a.data);
    buffer_release(&a.page);
    return result;
}

const struct command command_accuracy = {
    .name = "accuracy",
    .group = COMMAND_RENDER,
    .usage = "azulejo accuracy SCENE [OPTION]... | azulejo accuracy --from FILE.json [OPTION]...",
    .summary = "show what accuracy costs, on one page",
    .description =
        "Render a scene in many ways and show what each error of the picture costs in processor time, what\n"
        "other ways of rendering would cost and never get right, and what each effect is worth. Writes one HTML\n"
        "page that needs nothing else, the points as CSV, the study as JSON, and the plots as SVG and PNG\n"
        "beside it. Ctrl-C keeps what is measured; --continue resumes it.",
    .run = run,
};
